"""What ``harness risk`` says of two cases, beside references that know nothing of it.

``late``: ``cctc_flow`` with ``gap_yield`` that sees 0.7 s late, 500 people per hour; ``late-3``:
0.3 s late; ``late-2``: 0.2 s late, 130 pedestrians per hour.  ``python -m benchmarks.risk reference
CASE FIRST COUNT`` runs the AV's episodes of ``COUNT`` pairs from pair ``FIRST`` on by brute force,
and adds a row to ``data/risk_reference.csv``: the people are those of a run's own streams.
``late-2`` has no reference, because brute force takes too long.

``missed``: ``cctc`` with ``hard_yield`` that finds the pedestrian at each look with probability
0.17.  ``python -m benchmarks.risk quadrature`` prints κ as an integral over side, quantile and the
look at which they are found, which is all that is random there.

``dead-3``, ``dead-4`` and ``blind``: the same with strategies of ``benchmarks.faults``, whose rare
faults no score leads to.  κ is that of ``missed`` and of the fault: ``quadrature`` prints both.

``python -m benchmarks.risk seeds CASE FIRST COUNT`` estimates as ``harness risk`` does with so
many seeds and adds a row for each to ``data/risk_seeds.csv``; ``python -m benchmarks.risk verdict``
holds them against the references.  What is said of an estimate is that κ lies between its lower
limit and the bound of all ways.
"""

import argparse
import csv
import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from benchmarks.faults import BLIND_FROM_MPS, BLIND_TO_MPS
from harness.core.seeding import Given
from harness.core.versions import versions_of_runs
from harness.core.vocabulary import Arm, Arrival, Ending, Side
from harness.encounter.pairing import PairRunner
from harness.encounter.walking_speeds import WalkingSpeeds
from harness.engine.plain import PlainEngine
from harness.model.interaction import load_model
from harness.results.finding import Finding
from harness.scenario import Cell, Scenario, Setting, Study, load_scenario
from harness.studies.risk.estimate import risk

DATA = Path(__file__).parent / "data"
REFERENCE, SEEDS = DATA / "risk_reference.csv", DATA / "risk_seeds.csv"
REFERENCE_SEED = 101

MISSED = 9.154e-6
"""What ``quadrature`` prints of ``missed``."""

UNHINDERED = 0.2146
"""κ of ``constant_speed`` in ``cctc``, by quadrature: a dead strategy's."""

BLIND = 5.422e-5
"""What ``quadrature`` prints of ``blind``."""

TRUTH = {
    "missed": MISSED,
    "dead-3": 1e-3 * UNHINDERED + (1 - 1e-3) * MISSED,
    "dead-4": 1e-4 * UNHINDERED + (1 - 1e-4) * MISSED,
    "blind": BLIND,
}

DETECTION_PROBABILITY = 0.17

_LATE = {"late": (0.7, 500.0), "late-3": (0.3, 500.0), "late-2": (0.2, 130.0)}
"""Latency in s, and pedestrians per hour."""

_CASES: dict[str, tuple[str, dict[str, Any]]] = {
    **{
        name: (
            "cctc_flow",
            {
                "arms.av": "gap_yield",
                "pedestrians.flow_per_hour": flow_per_hour,
                "perception.latency_s": latency_s,
            },
        )
        for name, (latency_s, flow_per_hour) in _LATE.items()
    },
    "missed": (
        "cctc",
        {"arms.av": "hard_yield", "perception.detection_probability": DETECTION_PROBABILITY},
    ),
    **{
        name: (
            "cctc",
            {"arms.av": strategy, "perception.detection_probability": DETECTION_PROBABILITY}
            | ({} if share is None else {f'strategies."{strategy}".share': share}),
        )
        for name, strategy, share in (
            ("dead-3", "benchmarks.faults:Dead", 1e-3),
            ("dead-4", "benchmarks.faults:Dead", 1e-4),
            ("blind", "benchmarks.faults:Blind", None),
        )
    },
}

CHUNK = 500
LOOKS = 80
_QUANTILES = 50
_NARROWEST = 1e-6


def scenario_of(case: str, seed: int) -> Scenario:
    """A case with a seed."""
    name, settings = _CASES[case]
    changes = {**settings, "experiment.seed": seed}
    return load_scenario(name, [Setting(key, value) for key, value in changes.items()])


def crashes(runner: PairRunner, pairs: Sequence[tuple[int, Given]]) -> NDArray[np.bool_]:
    """Which of the AV's episodes end in a crash."""
    endings = [
        outcome.record.ending
        for at in range(0, len(pairs), CHUNK)
        for outcome in runner.run_arm_given(Arm.AV, pairs[at : at + CHUNK])
    ]
    if Ending.FAILED in endings:
        raise SystemExit("an episode failed")
    return np.array([ending is Ending.CRASHED for ending in endings])


def runner_of(scenario: Scenario) -> PairRunner:
    """Runs a case's episodes on the plain engine."""
    engine = PlainEngine(scenario.vehicle(), scenario.experiment.step_s)
    model = load_model(scenario.model.name, scenario.model.path)
    return PairRunner(scenario, model, lambda: engine)


def reference(case: str, first: int, count: int) -> dict[str, Any]:
    """What brute force finds in the pairs of a case from ``first`` on."""
    runner = runner_of(scenario_of(case, REFERENCE_SEED))
    crashed = crashes(runner, [(pair, {}) for pair in range(first, first + count)])
    return {
        "case": case,
        "seed": REFERENCE_SEED,
        "first_pair": first,
        "pairs": count,
        "crashed": int(crashed.sum()),
        "versions": _versions(),
    }


def looks(probability: float = DETECTION_PROBABILITY) -> list[tuple[float, float]]:
    """A quantile of the first detection at each look N, in the middle of those that mean it, and
    P(N).

    N is geometric; whoever is not found at the first ``LOOKS`` looks comes too late for all of
    them alike.

    Args:
        probability: of a detection at each look.
    """
    missed = 1 - probability
    number = np.arange(1, LOOKS + 1)
    found_at = missed ** (number - 1) * np.where(number < LOOKS, probability, 1.0)
    # Below 1 also where rounding would reach it.
    quantiles = np.minimum(1 - missed ** (number - 0.5), np.nextafter(1.0, 0.0))
    return list(zip(quantiles.tolist(), found_at.tolist(), strict=True))


def quadrature(scenario: Scenario) -> float:
    """κ of one pedestrian at the trigger who may be missed, like ``missed``.

    It is Σ over sides and looks N of P(side) P(N) |{quantiles: crash}|.  The set of quantiles is
    found on a grid, its ends by bisection.
    """
    runner = runner_of(scenario)
    grid = (np.arange(_QUANTILES) + 0.5) / _QUANTILES
    kappa = 0.0
    for side in (0.25, 0.75):
        for detection, probability in looks(scenario.perception.detection_probability):

            def crash(
                quantiles: NDArray[np.float64], side: float = side, detection: float = detection
            ) -> NDArray[np.bool_]:
                people: list[tuple[int, Given]] = [
                    (0, {"side": [side], "quantile": [quantile], "detection": [detection]})
                    for quantile in quantiles.tolist()
                ]
                return crashes(runner, people)

            on_grid = crash(grid)
            (changes,) = np.nonzero(np.diff(on_grid))
            low, high = grid[changes], grid[changes + 1]
            while len(low) and (high - low).max() > _NARROWEST:
                middle = (low + high) / 2
                same = crash(middle) == on_grid[changes]
                low, high = np.where(same, middle, low), np.where(same, high, middle)
            ends = np.concatenate([[0.0], (low + high) / 2, [1.0]])
            inside = np.concatenate([on_grid[:1], on_grid[changes + 1]])
            kappa += 0.5 * probability * float(np.diff(ends) @ inside)
    return kappa


def blind_quantiles() -> tuple[float, float]:
    """Between which quantiles of the walking speed ``blind`` sees nobody from the far side."""
    scenario = scenario_of("blind", 0)
    speeds = WalkingSpeeds(scenario, load_model(scenario.model.name, scenario.model.path))
    ego = scenario.ego

    def quantile(speed: float) -> float:
        def beyond(q: float) -> float:
            arrival = Arrival(0, 0.0, Side.FAR, q)
            return speeds(arrival, ego.trigger_range_m, ego.initial_speed_mps) - speed

        return float(brentq(beyond, 1e-6, 1 - 1e-6, xtol=1e-14))

    return quantile(BLIND_FROM_MPS), quantile(BLIND_TO_MPS)


def quadrature_of_the_blind(missed: float) -> float:
    """κ of ``blind``: that of ``missed``, but who walks at the fault's speeds is hit at any look.

    Args:
        missed: κ of ``missed``.
    """
    low, high = blind_quantiles()
    hit = {}
    for case in ("missed", "blind"):
        people: list[tuple[int, Given]] = [
            (0, {"side": [0.75], "quantile": [(low + high) / 2], "detection": [detection]})
            for detection, _ in looks()
        ]
        chances = np.array([probability for _, probability in looks()])
        hit[case] = float(chances @ crashes(runner_of(scenario_of(case, 0)), people))
    return missed + 0.5 * (high - low) * (hit["blind"] - hit["missed"])


def estimate(case: str, seed: int, target_cv: float) -> dict[str, Any]:
    """What ``harness risk`` says with a seed."""
    scenario = scenario_of(case, seed)
    with tempfile.TemporaryDirectory() as place:
        study, out = Study(case, scenario, (Cell(0, {}, scenario),)), Path(place) / "risk"
        how: Any = {"arm": Arm.AV, "target_cv": target_cv, "engine": "plain"}
        (found,) = risk(study, "crashed", **how, workers=0, out=out).records
    numbers = {key: of for key, of in found.items() if isinstance(of, Finding)}
    probability = numbers["probability"]
    return {
        "case": case,
        "seed": seed,
        "target_cv": target_cv,
        "probability": probability.value,
        "ci_low": probability.low,
        "ci_high": probability.high,
        "all_ways_high": numbers["all_ways_high"].value,
        "coefficient_of_variation": numbers["coefficient_of_variation"].value,
        "effective_sample_size": numbers["effective_sample_size"].value,
        "draws": probability.n,
        "episodes": numbers["episodes"].value,
        "brute_force_episodes": numbers["brute_force_episodes"].value,
        "weighted": bool(numbers["weighted"].value),
        "doubt": probability.reason,
        "versions": _versions(),
    }


def verdict(case: str) -> str:
    """How many intervals hold the reference, and how far their mean is from it."""
    error = 0.0
    rows = [row for row in _rows(REFERENCE) if row["case"] == case]
    if case in TRUTH:
        truth = TRUTH[case]
        words = f"{truth:.4g} by quadrature"
    elif not rows:
        return f"{case}: no reference"
    else:
        crashed, pairs = (sum(int(row[key]) for row in rows) for key in ("crashed", "pairs"))
        truth, error = crashed / pairs, math.sqrt(crashed) / pairs
        words = f"{truth:.3g} ± {error:.2g} by brute force ({crashed} of {pairs:,})"
    lines = [f"{case}: {words}"]
    found = [row for row in _rows(SEEDS) if row["case"] == case]
    for target in sorted({row["target_cv"] for row in found}):
        asked = [row for row in found if row["target_cv"] == target]
        values = np.array([float(row["probability"] or 0) for row in asked])
        held = sum(float(row["ci_low"]) <= truth <= float(row["ci_high"]) for row in asked)
        said = sum(float(row["ci_low"]) <= truth <= float(row["all_ways_high"]) for row in asked)
        line = (
            f"  --target-cv {target}: {held} of {len(asked)} intervals hold it, {said} with "
            "the bound of all ways"
        )
        if len(asked) > 1:
            both = math.hypot(error, float(values.std(ddof=1)) / math.sqrt(len(asked)))
            away = (values.mean() - truth) / both
            line += f"; mean {values.mean():.3g}, {away:+.1f} standard errors away"
        episodes = np.mean([int(row["episodes"]) for row in asked])
        gain = np.median([int(row["brute_force_episodes"]) / int(row["episodes"]) for row in asked])
        lines.append(f"{line}; {episodes:,.0f} episodes each, gain {gain:.3g} in the median")
    return "\n".join(lines)


def _versions() -> str:
    return " ".join(f"{name} {of}" for name, of in versions_of_runs().items())


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _add(path: Path, row: Mapping[str, Any]) -> None:
    print(row, flush=True)
    new = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(row), lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow(row)


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    brute, seeds = commands.add_parser("reference"), commands.add_parser("seeds")
    brute.add_argument("case", choices=_LATE)
    seeds.add_argument("case", choices=_CASES)
    for command in (brute, seeds):
        command.add_argument("first", type=int)
        command.add_argument("count", type=int)
    seeds.add_argument("--target-cv", type=float, default=0.1)
    commands.add_parser("quadrature")
    commands.add_parser("verdict")
    asked = parser.parse_args()
    if asked.command == "reference":
        _add(REFERENCE, reference(asked.case, asked.first, asked.count))
    elif asked.command == "quadrature":
        missed = quadrature(scenario_of("missed", 0))
        print(f"missed {missed:.4g}, blind {quadrature_of_the_blind(missed):.4g}")
    elif asked.command == "seeds":
        for seed in range(asked.first, asked.first + asked.count):
            _add(SEEDS, estimate(asked.case, seed, asked.target_cv))
    else:
        for case in _CASES:
            print(verdict(case))


if __name__ == "__main__":
    main()
