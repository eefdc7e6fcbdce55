"""How much a result hangs on the interaction model: on K, on its condition, on the data behind it.

    python -m benchmarks.model_sensitivity ../shared/data/dut

Extracts the rows, fits K = 1, 3, 5 and 10, refits the shipped K on resampled vehicles, and runs the
same pairs of ``cctc`` with every model on the plain engine.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from harness.core.encounter import Arm, Ending
from harness.engine.plain import PlainEngine
from harness.episode.pairing import PairRunner
from harness.model.interaction import InteractionModel, load_model
from harness.model.mixture import fit_mixture
from harness.model.trajectories import extract
from harness.scenario import Setting, load_scenario
from harness.statistics import Interval, bootstrap_mean
from harness.studies.calibration import make_sample

SEED, PAIRS, REFITS, STARTS = 1, 100, 20, 1
HUMANS = ("human_gmm", "human_recorded")
KS = (1, 3, 5, 10)


def fitted(rows: pd.DataFrame, components: int, like: InteractionModel) -> InteractionModel:
    """A model of so many components, with the shipped model's box and weights."""
    box = like.mixture
    sample = make_sample(rows, lower=box.lower, upper=box.upper)
    fit = fit_mixture(
        sample.data,
        components,
        box.lower,
        box.upper,
        sample_weight=sample.weights,
        n_init=STARTS,
        seed=SEED,
    )
    return InteractionModel(fit.mixture, f"K = {components}", like.provenance, "")


def resampled(rows: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """The rows of as many vehicles, drawn with replacement; a copy is a vehicle of its own."""
    groups = [own for _, own in rows.groupby(["source", "clip", "vehicle"], sort=True)]
    drawn = rng.integers(0, len(groups), len(groups))
    parts = [
        groups[vehicle].assign(clip=groups[vehicle]["clip"] + f"/{copy}")
        for copy, vehicle in enumerate(drawn.tolist())
    ]
    return pd.concat(parts, ignore_index=True)


def pass_times(model: InteractionModel, reading: str, driver: str) -> tuple[np.ndarray, float]:
    """(pairs,) pass times of a strategy in ``cctc``, NaN where it did not cross; share crashed."""
    scenario = load_scenario(
        "cctc",
        [Setting("arms.av", driver), Setting("model.pedestrian_reading", reading)],
    )
    runner = PairRunner(
        scenario, model, lambda: PlainEngine(scenario.vehicle(), scenario.experiment.step_s)
    )
    records = [runner.run_arm(pair, Arm.AV).record for pair in range(PAIRS)]
    times = np.array([record.pass_time_s for record in records], dtype=float)
    return times, sum(record.ending is Ending.CRASHED for record in records) / PAIRS


def against(model: InteractionModel, reading: str) -> list[tuple[Interval, float]]:
    """μ of Soft-Yield with its interval, and κ of the reference, for each of ``HUMANS``."""
    automated, _ = pass_times(model, reading, "soft_yield")
    found = []
    for human in HUMANS:
        times, kappa = pass_times(model, reading, human)
        tau = automated / times
        found.append((bootstrap_mean(tau[~np.isnan(tau)], np.random.default_rng(SEED)), kappa))
    return found


def line(name: str, found: list[tuple[Interval, float]]) -> str:
    """A row of the table."""
    cells = [f"{mu.value:.3f} ({mu.low:.3f} … {mu.high:.3f}) | {kappa:.1%}" for mu, kappa in found]
    return f"| {name} | {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("paths", nargs="+", type=Path)
    parser.add_argument("--format", default="vci")
    given = parser.parse_args()
    rows = extract(list(given.paths), given.format).rows
    shipped = load_model("dut")
    print("| model | " + " | ".join(f"μ, {human} | κ" for human in HUMANS) + " |", flush=True)
    print(line("shipped", against(shipped, "marginal")), flush=True)
    print(line("shipped, unconditional", against(shipped, "unconditional")), flush=True)
    for components in KS:
        model = fitted(rows, components, shipped)
        print(line(f"K = {components}", against(model, "marginal")), flush=True)
    rng = np.random.default_rng(SEED)
    components = len(shipped.mixture.weights)
    refits = [
        against(fitted(resampled(rows, rng), components, shipped), "marginal")
        for _ in range(REFITS)
    ]
    spread = []
    for number in range(len(HUMANS)):
        mu = np.array([one[number][0].value for one in refits], dtype=float)
        kappa = [one[number][1] for one in refits]
        middle, low, high = (float(of) for of in (np.median(mu), mu.min(), mu.max()))
        spread.append((Interval(middle, low, high), float(np.max(kappa))))
    print(line(f"{REFITS} refits: median, range; largest κ", spread), flush=True)


if __name__ == "__main__":
    main()
