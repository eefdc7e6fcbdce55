"""Held-out conditional scores of the default model against simpler and earlier recipes.

Run ``python -m benchmarks.model_scores`` where the DUT set lies in ``../shared/data/dut``, or with
``--rows`` on rows extracted as the default model's card says.  Every recipe is fitted anew on the
vehicles outside each fold and scored on those inside it: mean log f(v_p | 1/R, v) per encounter
weight with its standard error over vehicles, and the paired difference to the default with its own.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from sklearn.mixture import GaussianMixture

from harness.model.interaction import PEDESTRIAN_SPEED, load_model
from harness.model.mixture import TruncatedGaussianMixture, fit_mixture
from harness.model.trajectories import extract
from harness.studies.calibration import (
    HeldOut,
    Sample,
    by_vehicle,
    make_sample,
    read_rows,
    vehicle_folds,
    walking_log_scores,
)

Array = NDArray[np.float64]
Recipe = Callable[[Sample, NDArray[np.bool_], NDArray[np.bool_], int], Array]

DUT = Path(__file__).resolve().parents[2] / "shared" / "data" / "dut"

ROWS_PER_VEHICLE = 200
"""The interim recipe took at most this many rows of a vehicle."""


def default_recipe(
    sample: Sample, train: NDArray[np.bool_], held: NDArray[np.bool_], components: int, seed: int
) -> Array:
    """Truncated EM with the sample's weights, as ``harness fit``."""
    fit = fit_mixture(
        sample.data[train],
        components,
        sample.lower,
        sample.upper,
        sample_weight=sample.weights[train],
        n_init=3,
        seed=seed,
    )
    return walking_log_scores(fit.mixture, sample.data[held])


def normal(sample: Sample, train: NDArray[np.bool_], held: NDArray[np.bool_], seed: int) -> Array:
    """One normal for v_p whatever the vehicle does, weighted mean and spread."""
    del seed
    speeds, weights = sample.data[train, PEDESTRIAN_SPEED], sample.weights[train]
    mean = np.average(speeds, weights=weights)
    spread = np.sqrt(np.average((speeds - mean) ** 2, weights=weights))
    scores: Array = norm(mean, spread).logpdf(sample.data[held, PEDESTRIAN_SPEED])
    return scores


def scikit_learn(
    sample: Sample,
    train: NDArray[np.bool_],
    held: NDArray[np.bool_],
    components: int,
    seed: int,
    weighted: bool,
) -> Array:
    """scikit-learn's mixture, not truncated; it takes no weights, so rows are drawn by them."""
    rows, weights = sample.data[train], sample.weights[train]
    if weighted:
        rng = np.random.default_rng(seed)
        rows = rows[rng.choice(len(rows), len(rows), p=weights / weights.sum())]
    spread = rows.std(axis=0)
    found = GaussianMixture(components, n_init=3, tol=1e-6, max_iter=1000, random_state=seed)
    found.fit(rows / spread)
    mixture = TruncatedGaussianMixture(
        found.weights_,
        found.means_ * spread,
        found.covariances_ * np.outer(spread, spread),
        np.full(4, -np.inf),
        np.full(4, np.inf),
    )
    return walking_log_scores(mixture, sample.data[held])


def interim(sample: Sample, train: NDArray[np.bool_], held: NDArray[np.bool_], seed: int) -> Array:
    """The interim model's recipe: K = 10, rows alike, at most 200 of each vehicle, 6 starts."""
    assert sample.vehicle is not None
    rng = np.random.default_rng(seed)
    chosen = []
    for vehicle in np.unique(sample.vehicle[train]):
        of_vehicle = np.flatnonzero(train & (sample.vehicle == vehicle))
        chosen.append(rng.permutation(of_vehicle)[:ROWS_PER_VEHICLE])
    rows = sample.data[np.sort(np.concatenate(chosen))]
    fit = fit_mixture(rows, 10, sample.lower, sample.upper, n_init=6, seed=seed)
    return walking_log_scores(fit.mixture, sample.data[held])


def recipes(components: int) -> dict[str, Recipe]:
    """The recipes to compare, the default first."""
    found: dict[str, Recipe] = {
        f"default: truncated, K = {components}, by encounter": lambda sample, train, held, seed: (
            default_recipe(sample, train, held, components, seed)
        ),
        "one normal for v_p": normal,
        f"scikit-learn, K = {components}, rows drawn by weight": lambda sample, train, held, seed: (
            scikit_learn(sample, train, held, components, seed, weighted=True)
        ),
        f"scikit-learn, K = {components}, rows alike": lambda sample, train, held, seed: (
            scikit_learn(sample, train, held, components, seed, weighted=False)
        ),
        "interim recipe: K = 10, ≤ 200 rows a vehicle": interim,
    }
    if components != 10:
        found["the paper's K = 10, by encounter"] = lambda sample, train, held, seed: (
            default_recipe(sample, train, held, 10, seed)
        )
    return found


def score(sample: Sample, recipe: Recipe, folds: NDArray[np.intp], seed: int) -> HeldOut:
    """A recipe's held-out scores over all folds."""
    assert sample.vehicle is not None
    assert sample.vehicles is not None
    scores = np.empty(sample.weights.size)
    for fold in range(int(folds.max()) + 1):
        held = folds == fold
        scores[held] = recipe(sample, ~held, held, seed + fold)
    return by_vehicle(scores, sample.weights, sample.vehicle, sample.vehicles)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=Path, help="rows of `harness extract`; else --data's")
    parser.add_argument("--data", type=Path, default=DUT, help="the DUT set")
    parser.add_argument("--folds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    components = load_model("dut").mixture.weights.size
    rows = read_rows(options.rows).rows if options.rows else extract(options.data, "vci").rows
    sample = make_sample(rows, weigh="encounter")
    assert sample.vehicle is not None
    folds = vehicle_folds(sample.vehicle, sample.weights, options.folds, options.seed)
    default: HeldOut | None = None
    print("| recipe | log f(v_p given 1/R, v) | less the default |")
    print("|---|---|---|")
    for name, recipe in recipes(components).items():
        found = score(sample, recipe, folds, options.seed)
        default = default or found
        less = found.less(default)
        difference = "" if default is found else f"{less.mean:+.3f} ± {less.standard_error:.3f}"
        print(
            f"| {name} | {found.mean:.3f} ± {found.standard_error:.3f} | {difference} |", flush=True
        )


if __name__ == "__main__":
    main()
