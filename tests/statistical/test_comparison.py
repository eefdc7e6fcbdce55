"""Whether intervals and tests hold what they say: by enumeration where possible, else simulated."""

from itertools import combinations

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from benchmarks.coverage import INTERVALS, Named, chosen_pairs, holds, population
from harness.results.catalogue import ENTRIES
from harness.results.estimators import (
    Sampling,
    clopper_pearson,
    difference,
    share_difference,
    sign_flip_p,
)
from harness.scenario import load_scenario
from harness.studies.allowed import RELIABLE_FROM
from harness.studies.differences import DIFFERENCES, holm


def least_coverage(intervals: list[tuple[float, float]]) -> float:
    """The smallest coverage over shares p of intervals for 0 … n successes, summed exactly."""
    low, high = (np.array(ends) for ends in zip(*intervals, strict=True))
    n = len(low) - 1
    # Coverage falls to its local minima at the intervals' own ends.
    ends = np.concatenate([low, high])
    p = np.concatenate([np.linspace(0.0005, 0.9995, 1_999), ends - 1e-9, ends + 1e-9])
    p = p[(p > 0) & (p < 1), np.newaxis]
    inside = (low <= p) & (p <= high)
    chances = stats.binom.pmf(np.arange(n + 1), n, p)
    return float((chances * inside).sum(axis=1).min())


@pytest.mark.parametrize("n", [1, 2, 5, 10, 50, 200])
def test_clopper_pearson_covers_at_least_95_percent(n: int) -> None:
    assert least_coverage([clopper_pearson(k, n, 0.95) for k in range(n + 1)]) >= 0.95 - 1e-7
    # Another interval would be caught: Wilson's covers 95 % on average, but not everywhere.
    wilson: list = [stats.binomtest(k, 50).proportion_ci(0.95, "wilson") for k in range(51)]
    assert least_coverage(wilson) < 0.9


def test_mcnemar_rejects_at_most_5_percent() -> None:
    # Equal crash rates: of n discordant pairs each is on either side with chance ½.
    for discordant in range(1, 80):
        ran = np.ones(discordant, dtype=bool)
        counts, order = np.arange(discordant + 1), np.arange(discordant)
        p = [share_difference(order < k, order >= k, ran, ran).p for k in counts]
        chances = stats.binom.pmf(counts, discordant, 0.5)
        assert chances[np.array(p) < 0.05].sum() <= 0.05


LEAST = {
    **{key: entry.estimate.reliable_from for entry in ENTRIES for key in entry.keys},
    **{f"A − B: {each.key}": each.reliable_from for each in DIFFERENCES},
    "mu_bound": RELIABLE_FROM,
}
"""Informative pairs from which on an interval covers what it says, by name; 0: exact."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cctc", "cctc_flow"])
def test_intervals_hold_where_they_are_not_called_unreliable(name: str) -> None:
    """Pairs of a shipped scenario on the plain engine, with its AV and with Hard-Yield."""
    scenario = load_scenario(name)
    both = [population(name, range(6_000), av) for av in (None, "hard_yield")]
    rng = np.random.default_rng(13)

    def intervals(first: pa.Table, second: pa.Table) -> list[Named]:
        kinds = (kind((first, second), scenario) for kind in INTERVALS.values())
        return [named for kind in kinds for named in kind]

    truth = {key: of.value for key, of in intervals(*both) if isinstance(of.value, float)}
    for n in sorted({*LEAST.values()} - {0}):
        hits, trials = dict.fromkeys(truth, 0), dict.fromkeys(truth, 0)
        for _ in range(100):
            chosen = rng.integers(0, 6_000, n)
            for key, of in intervals(*(chosen_pairs(each, chosen) for each in both)):
                if key in truth and of.low is not None and (of.n or 0) >= LEAST[key]:
                    trials[key] += 1
                    hits[key] += holds(of, truth[key])
        assert sum(trials.values()) > 0
        for key, hit in hits.items():
            least = stats.binom.ppf(0.001, trials[key], 0.935)
            assert hit >= least, f"N = {n}, {key}: {hit} of {trials[key]}"


def told_apart(times: np.ndarray, missed: np.ndarray, rng: np.random.Generator) -> bool:
    """Whether ``harness compare`` calls any of these cells faster or safer than another."""
    both = list(combinations(range(len(times)), 2))
    ran = np.ones(times.shape[1], dtype=bool)
    tests = [share_difference(missed[a], missed[b], ran, ran).p for a, b in both]
    adjusted = holm([sign_flip_p(times[a] - times[b]) for a, b in both] + tests)
    if min(adjusted[len(both) :]) < 0.05:
        return True
    found = (
        difference(times[a], times[b], Sampling(rng), times[0])
        for p, (a, b) in zip(adjusted, both, strict=False)
        if p < 0.05
    )
    return any(of.low is not None and not of.low <= 0.0 <= of.high for of in found)


@pytest.mark.parametrize("cells", [2, 8])
def test_equal_cells_are_not_told_apart(cells: int) -> None:
    """Poisson(5) of 2,000 pairs differ: any "better" in at most 5 % of the sweeps."""
    rng = np.random.default_rng(14)
    sweeps, pairs, wrong = 600, 2_000, 0
    for _ in range(sweeps):
        times, missed = np.full((cells, pairs), 7.4), np.zeros((cells, pairs), dtype=bool)
        for cell in range(cells):
            waits = rng.choice(pairs, min(pairs, rng.poisson(2.5)), replace=False)
            times[cell, waits] += rng.lognormal(1.0, 1.0, len(waits))
            missed[cell, rng.choice(pairs, rng.poisson(2.5), replace=False)] = True
        wrong += told_apart(times, missed, rng)
    assert wrong <= stats.binom.ppf(0.999, sweeps, 0.05), f"{wrong} of {sweeps}"
