"""Coverage of the intervals that include the model's fit, with a known truth.

    python -m benchmarks.over_model --experiments 50 --first 0

A population of vehicles has rows of the model's four variables: each vehicle has its own mean, and
each of its encounters a row around it.  The truth is the model (K = 1) that is fitted to 3,000
vehicles, and its numbers over 20,000 pairs of ``cctc``.  An experiment draws 20 vehicles, fits the
model and its 20 refits, and spreads 500 pairs over the refits, on the plain engine.
"""

import argparse
from collections import Counter

import numpy as np
import pandas as pd

from harness.engine.plain import PlainEngine
from harness.episode.pairing import PairRunner
from harness.model.interaction import InteractionModel, Refits
from harness.model.mixture import TruncatedGaussianMixture
from harness.scenario import Cell, Scenario, load_scenario
from harness.statistics import Findings, OverModel
from harness.store.episode_tables import episode_rows
from harness.store.kinds import KINDS
from harness.store.over_model import findings_over_model
from harness.studies.calibration import RefitSettings, Sample, make_sample
from harness.studies.calibration.jobs import Job, Settings, Shared, run_job
from harness.studies.calibration.refits import RefitJob, run_refit

VEHICLES, REFITS, PAIRS, TRUE_PAIRS, TRUE_VEHICLES = 20, 20, 500, 20_000, 3_000
NUMBERS = ("time_ratio", "mu", "delay_difference_human_s", "delay_human_s", "kappa_human")
MEAN = np.array([0.1, 3.2, 1.3, 0.35])
BETWEEN = np.array([0.01, 0.8, 0.08, 0.05])
WITHIN = np.array([0.05, 1.2, 0.2, 0.2])
ENCOUNTERS = 10
"""Mean number of encounters of a vehicle; each vehicle has 1 + Poisson encounters."""


def rows_of(vehicles: int, rng: np.random.Generator) -> pd.DataFrame:
    """Rows of some vehicles of the population, inside the model's box."""
    parts = []
    for vehicle in range(vehicles):
        mean = MEAN + BETWEEN * rng.standard_normal(4)
        count, rows = 1 + rng.poisson(ENCOUNTERS - 1), np.empty((0, 4))
        while len(rows) < count:
            drawn = mean + WITHIN * rng.standard_normal((4 * count, 4))
            inside = (drawn > (1 / 60, 0.3, 0.3, 1e-3)).all(1) & (drawn < (0.5, 8, 3, 2)).all(1)
            rows = np.concatenate([rows, drawn[inside]])[:count]
        people = [f"{vehicle}-{number}" for number in range(count)]
        parts.append(pd.DataFrame(rows).assign(vehicle=str(vehicle), pedestrian=people))
    table = pd.concat(parts, ignore_index=True)
    return pd.DataFrame(
        {
            "source": "made up",
            "clip": "one",
            "vehicle": table["vehicle"],
            "pedestrian": table["pedestrian"],
            "range_m": 1 / table[0],
            "vehicle_speed_mps": table[1],
            "pedestrian_speed_mps": table[2],
            "time_advantage_s": 1 / table[3],
        }
    )


def fitted(sample: Sample) -> TruncatedGaussianMixture:
    """The model's mixture, fitted as ``harness fit --components 1`` does."""
    shared = Shared(sample, Settings((1,), starts=1, folds=0), None)
    fit = run_job((Job(1, None), shared)).fit
    assert fit is not None
    return fit.mixture


def with_refits(sample: Sample) -> InteractionModel:
    """The model with its refits."""
    settings, refits = RefitSettings(REFITS, starts=1), []
    for number in range(REFITS):
        refit = run_refit(RefitJob(number, 1, sample, settings))
        assert not isinstance(refit, tuple), refit
        mixture = refit.mixture(sample.lower, sample.upper)
        refits.append(InteractionModel(mixture, f"refit {number}", {}, ""))
    weights = np.bincount(sample.vehicle, sample.weights)
    effective = float(weights.sum() ** 2 / (weights @ weights))
    return InteractionModel(fitted(sample), "m", {}, "", Refits((*refits,), effective, ""))


def numbers_of(
    scenario: Scenario, model: InteractionModel, pairs: int, confidence: float
) -> tuple[Findings, dict[str, OverModel]]:
    """The findings of some pairs, and their intervals over pairs and refits."""
    vehicle, step_s = scenario.vehicle(), scenario.experiment.step_s
    runner = PairRunner(scenario, model, lambda: PlainEngine(vehicle, step_s))
    rows = episode_rows(0, list(runner.run(range(pairs))))
    kind, cell = KINDS["encounters"], Cell(0, {}, scenario)
    findings = kind.findings(rows, cell, confidence)
    if model.refits is None:
        return findings, {}
    used = {"count": REFITS, "effective_vehicles": model.refits.effective_vehicles}
    manifest = {"simulated_with": {"models": [{"refits": used}]}}
    return findings, findings_over_model(kind, rows, cell, findings, manifest)


def main() -> None:
    """Print the truth, and how many intervals of each kind hold."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--experiments", type=int, default=50)
    parser.add_argument("--first", type=int, default=0, help="number of the first experiment")
    parser.add_argument("--true-pairs", type=int, default=TRUE_PAIRS)
    given = parser.parse_args()
    population = make_sample(rows_of(TRUE_VEHICLES, np.random.default_rng(0)))
    truth, _ = numbers_of(
        load_scenario("cctc"),
        InteractionModel(fitted(population), "truth", {}, ""),
        given.true_pairs,
        0.0,
    )
    true = {name: truth[name].number or 0.0 for name in NUMBERS}
    print({name: round(of, 4) for name, of in true.items()}, flush=True)
    held, usual, widths = Counter[str](), Counter[str](), {name: [] for name in NUMBERS}
    shift = {name: [] for name in NUMBERS}
    for number in range(given.first, given.first + given.experiments):
        sample = make_sample(rows_of(VEHICLES, np.random.default_rng((1, number))))
        changes = {"experiment.seed": 1_000 + number, "model.over_refits": True}
        scenario = load_scenario("cctc", changes)
        findings, over = numbers_of(scenario, with_refits(sample), PAIRS, 0.95)
        for name in NUMBERS:
            both, alone = over[name], findings[name]
            usual[name] += (alone.low or 0.0) <= true[name] <= (alone.high or 0.0)
            held[name] += (both.low or 0.0) <= true[name] <= (both.high or 0.0)
            widths[name].append((both.half_width or 0.0) / (alone.half_width or 1.0))
            shift[name].append((alone.number or 0.0) - true[name])
    for name in NUMBERS:
        ratio, off = np.median(widths[name]), np.array(shift[name])
        print(
            f"| {name} | {given.experiments} | {usual[name]} | {held[name]} | {ratio:.2f} | "
            f"{off.mean():+.4f} ± {off.std(ddof=1):.4f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
