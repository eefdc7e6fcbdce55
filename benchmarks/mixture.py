"""Speed of fitting and conditioning, side by side with scikit-learn in the same run.

Run as ``python -m benchmarks.mixture``. Other work on the machine slows both sides alike, so the
ratios mean more than the seconds; both sides have one thread. scikit-learn fits the same rows
without bounds.
"""

import sys
import time
import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from harness.model.interaction import load_model
from harness.model.mixture.climbing import start
from harness.model.mixture.distribution import TruncatedGaussianMixture
from harness.model.mixture.em import Problem
from harness.model.mixture.fitting import fit_mixture
from harness.model.sample import Sample
from harness.studies.fitting import Settings, fit, processes

Array = NDArray[np.float64]

COMPONENTS = 10


def seconds(
    function: Callable[[], object], repeats: int, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Median time of one call, by the clock on the wall or another."""
    times = []
    for _ in range(repeats):
        began = clock()
        function()
        times.append(clock() - began)
    return float(np.median(times))


def truth(components: int = COMPONENTS) -> TruncatedGaussianMixture:
    """Components spread over a two-sided box in four variables, some of them mostly outside."""
    rng = np.random.default_rng(5)
    factors = rng.normal(size=(components, 4, 4)) * 0.15 + 0.15 * np.eye(4)
    scales = factors @ np.swapaxes(factors, 1, 2) + 0.003 * np.eye(4)
    locations = rng.uniform(-0.1, 1.0, (components, 4))
    weights = rng.dirichlet(np.full(components, 5.0))
    return TruncatedGaussianMixture(weights, locations, scales, np.zeros(4), np.ones(4))


def line(what: str, value: str, goal: str = "") -> None:
    print(f"{what:<58} {value:>22}   {goal}", flush=True)


def iterations(known: TruncatedGaussianMixture, n: int, goal: str) -> None:
    """One EM iteration from the same start."""
    from sklearn.mixture import GaussianMixture

    rows = known.sample(n, np.random.default_rng(n))
    standard = (rows - rows.mean(axis=0)) / rows.std(axis=0)
    bounds = [(b - rows.mean(axis=0)) / rows.std(axis=0) for b in (known.lower, known.upper)]
    problem = Problem(standard, np.ones(n), bounds[0], bounds[1], 1.0, 1e-4)
    parameters = start(standard, np.ones(n), COMPONENTS, np.random.default_rng(1))

    def ours() -> None:
        at = problem.evaluate(parameters)
        assert at is not None
        problem.step(at)

    other = GaussianMixture(COMPONENTS, warm_start=True, max_iter=5, tol=0.0, random_state=1)
    other.fit(standard)
    repeats = 21 if n < 100_000 else 5
    theirs = seconds(lambda: other.fit(standard), repeats) / 5.0
    mine = seconds(ours, repeats)
    text = f"{mine * 1e3:.2f} / {theirs * 1e3:.2f} ms = {mine / theirs:.2f}x"
    line(f"EM iteration, n = {n}", text, goal)


def whole_fits(known: TruncatedGaussianMixture, n: int, starts: int, goal: str) -> None:
    """One start to its end, in turns, summed over seeds: how long one takes depends on it."""
    from sklearn.mixture import GaussianMixture

    rows = known.sample(n, np.random.default_rng(n))
    mine = theirs = 0.0
    ours, other = [], []
    for seed in range(1, starts + 1):
        began = time.process_time()
        found = fit_mixture(rows, COMPONENTS, known.lower, known.upper, seed=seed, n_init=1)
        between = time.process_time()
        fitted = GaussianMixture(COMPONENTS, tol=1e-6, max_iter=2000, random_state=seed).fit(rows)
        theirs += time.process_time() - between
        mine += between - began
        ours.append(found.n_iter)
        other.append(fitted.n_iter_)
    steps = f"{np.mean(ours):.0f} / {np.mean(other):.0f} steps"
    text = f"{mine / starts:.2f} / {theirs / starts:.2f} s = {mine / theirs:.2f}x"
    line(f"one start to its end, n = {n}, {starts} starts ({steps})", text, goal)


def sweep(known: TruncatedGaussianMixture) -> None:
    """Every K as `harness fit` does it, in two worker processes."""
    n = 8_000
    sample = Sample(
        data=known.sample(n, np.random.default_rng(8)),
        weights=np.ones(n),
        row=np.arange(n),
        vehicle=None,
        encounter=None,
        named_vehicles=None,
        lower=known.lower,
        upper=known.upper,
    )
    settings = Settings(tuple(range(1, 21)), "bic", starts=3, folds=0, seed=1)
    began = time.perf_counter()
    with processes(2) as executor:
        found = fit(sample, settings, executor)
    text = f"{time.perf_counter() - began:.1f} s, picks {found.chosen.components}"
    line("BIC for K = 1 to 20, 3 starts, 8,000 rows, two workers", text, "< 60 s")


def conditionals(known: TruncatedGaussianMixture) -> None:
    rng = np.random.default_rng(3)
    y = known.sample(5_000, rng)[:, [0, 1, 3]]
    three = known.conditional(2, (0, 1, 3))
    two = known.conditional(2, (0, 1))
    marginal = known.conditional(2, ())
    nothing = np.empty((1, 0))
    u = rng.random(2_000)
    at = iter(range(10**9))

    def each(function: Callable[[int], object]) -> str:
        taken = [seconds(lambda: function(next(at) % 2_000), 1) for _ in range(2_000)]
        return f"{np.median(taken) * 1e6:.0f} us"

    line("one mode given three", each(lambda i: three.mode_at(y[i])))
    driven = load_model("dut").mixture.conditional(1, (0, 2, 3))
    states = load_model("dut").mixture.sample(2_000, rng)[:, [0, 2, 3]]
    line("one mode given three, model dut", each(lambda i: driven.mode_at(states[i])), "<= 15 us")
    line("one inverse given three", each(lambda i: three.ppf(u[i : i + 1], y[i : i + 1])))
    line("one mode given two", each(lambda i: two.mode(y[i : i + 1, :2])))
    line("one inverse given two", each(lambda i: two.ppf(u[i : i + 1], y[i : i + 1, :2])))
    began = time.perf_counter()
    marginal.ppf(u[:1], nothing)
    line("first inverse given nothing", f"{(time.perf_counter() - began) * 1e3:.0f} ms")
    line("one inverse given nothing", each(lambda i: marginal.ppf(u[i : i + 1], nothing)))


def main() -> None:
    """Print the table."""
    from threadpoolctl import threadpool_limits

    warnings.simplefilter("ignore")
    # As in the workers of `harness fit`; on small matrices more threads are in each other's way.
    with threadpool_limits(1):
        small = np.ones(10)
        unit = seconds(lambda: [small * small for _ in range(1000)], 21)
        line("product of two arrays of ten numbers (the machine's pace)", f"{unit * 1e3:.2f} us")
        known = truth()
        conditionals(known)
        for n, goal in ((2_973, "<= 2x"), (30_000, "<= 0.5x"), (300_000, "<= 0.2x")):
            iterations(known, n, goal)
        whole_fits(known, 2_973, 8, "<= 1.5x")
        if "--quick" not in sys.argv:
            whole_fits(known, 300_000, 2, "<= 0.2x")
            sweep(known)


if __name__ == "__main__":
    main()
