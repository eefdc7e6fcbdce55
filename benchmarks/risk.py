"""Crashes in a flow that is seen late, by brute force and by ``harness risk``.

``python -m benchmarks.risk reference LATENCY_S FIRST COUNT`` runs the AV's episodes of ``COUNT``
pairs on the plain engine, from pair ``FIRST`` on, and adds a row to ``data/risk_reference.csv``.
It knows nothing of ``harness/risk``: the people are those of a run's own streams.
``python -m benchmarks.risk seeds LATENCY_S FIRST COUNT`` asks ``harness risk`` with so many seeds
and prints a line for each; ``python -m benchmarks.risk verdict FILE`` holds such lines against the
reference.

The case is ``cctc_flow`` with ``gap_yield`` and 500 pedestrians per hour.
"""

import argparse
import csv
import json
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path

from harness.encounter import Arm, Ending
from harness.engine.plain import PlainEngine
from harness.episode.arrivals import Given
from harness.episode.pairing import PairRunner
from harness.interaction import load_model
from harness.risk.folder import Settings, estimate_risk, read_risk
from harness.scenario import Scenario, Setting, load_scenario
from harness.versions import versions_of_runs

REFERENCE = Path(__file__).parent / "data" / "risk_reference.csv"
REFERENCE_SEED = 101
COLUMNS = ("latency_s", "seed", "first_pair", "pairs", "crashed", "failed", "versions")

_CHUNK = 500


def scenario_of(latency_s: float, seed: int) -> Scenario:
    """The case at a latency."""
    settings = [
        Setting("arms.av", "gap_yield"),
        Setting("pedestrians.flow_per_hour", 500.0),
        Setting("perception.latency_s", latency_s),
        Setting("experiment.seed", seed),
    ]
    return load_scenario("cctc_flow", settings)


def reference(latency_s: float, first: int, count: int) -> dict[str, object]:
    """What brute force finds in the pairs from ``first`` on."""
    scenario = scenario_of(latency_s, REFERENCE_SEED)
    engine = PlainEngine(scenario.vehicle(), scenario.experiment.step_s)
    model = load_model(scenario.model.name, scenario.model.path)
    runner = PairRunner(scenario, model, lambda: engine)
    crashed = failed = 0
    for at in range(first, first + count, _CHUNK):
        pairs: list[tuple[int, Given]]
        pairs = [(pair, {}) for pair in range(at, min(at + _CHUNK, first + count))]
        for outcome in runner.run_arm_given(Arm.AV, pairs, lambda: None):
            crashed += outcome.record.ending is Ending.CRASHED
            failed += outcome.record.ending is Ending.ENGINE_FAILED
    versions = " ".join(f"{name} {of}" for name, of in versions_of_runs().items())
    values = (latency_s, REFERENCE_SEED, first, count, crashed, failed, versions)
    return dict(zip(COLUMNS, values, strict=True))


def estimates(
    latency_s: float, seeds: range, target_cv: float, workers: int | None
) -> Iterator[dict[str, object]]:
    """What ``harness risk`` says with some seeds."""
    for seed in seeds:
        with tempfile.TemporaryDirectory() as place:
            asked = Settings("cctc_flow", scenario_of(latency_s, seed), target_cv=target_cv)
            folder = estimate_risk(asked, out=Path(place) / "risk", workers=workers)
            result = read_risk(folder)
        kept = ("probability", "ci_low", "ci_high", "effective_sample_size", "episodes", "warnings")
        yield {"latency_s": latency_s, "seed": seed, **{key: result[key] for key in kept}}


def verdict(found: list[dict[str, float]]) -> str:
    """How many intervals hold the reference, and how far their mean is from it."""
    with REFERENCE.open(encoding="utf-8") as file:
        rows = [
            row for row in csv.DictReader(file) if float(row["latency_s"]) == found[0]["latency_s"]
        ]
    crashed, pairs = (sum(int(row[key]) for row in rows) for key in ("crashed", "pairs"))
    truth, error = crashed / pairs, math.sqrt(crashed) / pairs
    held = sum(one["ci_low"] <= truth <= one["ci_high"] for one in found)
    mean = sum(one["probability"] for one in found) / len(found)
    spread = math.sqrt(sum((one["probability"] - mean) ** 2 for one in found) / (len(found) - 1))
    both = math.hypot(error, spread / math.sqrt(len(found)))
    return (
        f"reference {truth:.3g} ± {error:.2g} ({crashed} of {pairs:,}); {held} of {len(found)} "
        f"intervals hold it; mean {mean:.3g}, {(mean - truth) / both:+.1f} standard errors away"
    )


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    brute = commands.add_parser("reference")
    brute.add_argument("latency_s", type=float)
    brute.add_argument("first", type=int)
    brute.add_argument("count", type=int)
    seeds = commands.add_parser("seeds")
    seeds.add_argument("latency_s", type=float)
    seeds.add_argument("first", type=int)
    seeds.add_argument("count", type=int)
    seeds.add_argument("--target-cv", type=float, default=0.1)
    seeds.add_argument("--workers", type=int, default=None)
    judged = commands.add_parser("verdict")
    judged.add_argument("file", type=Path)
    asked = parser.parse_args()
    if asked.command == "reference":
        row = reference(asked.latency_s, asked.first, asked.count)
        print(row)
        new = not REFERENCE.exists()
        with REFERENCE.open("a", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            if new:
                writer.writeheader()
            writer.writerow(row)
    elif asked.command == "seeds":
        wanted = range(asked.first, asked.first + asked.count)
        for one in estimates(asked.latency_s, wanted, asked.target_cv, asked.workers):
            print(json.dumps(one), flush=True)
    else:
        print(verdict([json.loads(line) for line in asked.file.read_text("utf-8").splitlines()]))


if __name__ == "__main__":
    main()
