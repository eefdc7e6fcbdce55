"""Where the time of a batch goes: ``python -m benchmarks.profile``, under py-spy.

py-spy (extra ``dev``) looks at the stacks of the command and of its workers while they run.  Each
sample of a worker counts for the innermost part below that is on its stack.  The floor is what bare
libsumo takes for as many steps with as many insertions, measured before and after.
"""

import argparse
import os
import re
import statistics
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import pyarrow.parquet as pq
from rich.console import Console
from rich.table import Table

from benchmarks.engine import bare

PARTS = {
    "simulationStep": r"simulationStep \(libsumo",
    "persons held by moveToXY": r"moveToXY \(libsumo",
    "ego's setSpeed and getDistance": r"(setSpeed|getDistance|getSpeed) \(libsumo",
    "ego and persons inserted and removed": r"(_insert_ego|_announce_until|begin|remove|end) "
    r"\(harness/engine/control",
    "SUMO started": r"libsumo_engine \(",
    "rest of the engine": r"\(harness/engine/",
    "the human driver: modes of the model": r"\(harness/strategies/human_gmm",
    "the AV's strategy": r"\(harness/strategies/",
    "walking speeds: inverses of the model": r"(foresee|__call__|_speeds) \(harness/pairing",
    "measures": r"\(harness/measures/",
    "pedestrians planned": r"\(harness/plan",
    "strategy objects": r"make_strategy \(",
    "the loop of the episode": r"\(harness/(episode|walkers|walking)",
    "rows of the tables": r"\(harness/results",
    "waiting for the next task": r"_recv \(multiprocessing/connection",
    "imports": r"importlib",
    "supervision in the worker": r"\(harness/(worker|pairing)|serve \(",
}
"""Each part and how a frame of it looks; of two on one stack the innermost counts."""


def record(scenario: str, pairs: int, workers: int, folder: Path) -> list[tuple[str, int]]:
    """Run a batch under py-spy; gives the stacks with their numbers of samples."""
    raw = folder / "stacks.txt"
    spy = [str(Path(sys.executable).with_name("py-spy")), "record", "--subprocesses"]
    run = [sys.executable, "-m", "harness", "run", scenario, "--pairs", str(pairs), "-q"]
    run += ["--workers", str(workers), "--out", str(folder / "run")]
    command = [*spy, "--rate", "200", "--format", "raw", "--output", str(raw), "--", *run]
    subprocess.run(command, check=True, capture_output=True)
    found = []
    for line in raw.read_text(encoding="utf-8").splitlines():
        stack, _, number = line.rpartition(" ")
        if number.isdigit():
            found.append((stack, int(number)))
    return found


def part_of(stack: str) -> str:
    """The innermost part on a stack."""
    for frame in reversed(stack.split(";")):
        for part, pattern in PARTS.items():
            if re.search(pattern, frame):
                return part
    return "everything else"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="cctc")
    parser.add_argument("--pairs", type=int, default=2_000)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    shares: Counter[str] = Counter()
    command = 0
    floors = [bare(100, 120).per_step_us]
    with tempfile.TemporaryDirectory() as folder:
        for stack, samples in record(
            options.scenario, options.pairs, options.workers, Path(folder)
        ):
            if "_end_with_parent" in stack:
                continue
            if "serve (harness/worker" in stack:
                shares[part_of(stack)] += samples
            elif "-P -c" in stack:
                shares["imports"] += samples
            else:
                command += samples
        steps = sum(pq.read_table(Path(folder) / "run" / "episodes.parquet")["steps"].to_pylist())
    floors.append(bare(100, 120).per_step_us)
    total = sum(shares.values())
    table = Table(title=f"{options.scenario}, {options.pairs} pairs, {steps} steps")
    for heading in ("in the workers", "share"):
        table.add_column(heading)
    for part, samples in shares.most_common():
        table.add_row(part, f"{samples / total:.1%}")
    console = Console(width=100)
    console.print(table)
    console.print(
        f"the command beside its workers: {command / (command + total):.1%} of all samples"
    )
    per_step_us = total / 200 / steps * 1e6
    floor = statistics.mean(floors)
    console.print(
        f"{per_step_us:.1f} µs per step in the workers, of which bare libsumo takes {floor:.1f} "
        f"({floor / per_step_us:.0%}); load {os.getloadavg()[0]:.1f}"
    )


if __name__ == "__main__":
    main()
