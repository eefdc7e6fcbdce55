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

RATE_HZ = 200

PARTS = {
    "simulationStep": r"_wrap_simulation_step \(",
    "persons held by moveToXY": r"_wrap_person_moveToXY \(",
    "ego's setSpeed and getDistance": r"_wrap_vehicle_(setSpeed|getDistance|getSpeed) \(",
    "ego and persons inserted and removed": r"(_insert_ego|_announce_until|begin|remove|end) "
    r"\(harness/engine/sumo_engine",
    "SUMO started": r"session_of \(",
    "rest of the engine": r"\(harness/engine/",
    "the human driver: modes of the model": r"\(harness/strategies/human_gmm",
    "the AV's strategy": r"\(harness/strategies/",
    "walking speeds: inverses of the model": r"__call__ \(harness/encounter/walking_speeds",
    "measures": r"\(harness/measures/",
    "pedestrians planned": r"\(harness/encounter/arrivals",
    "strategy objects": r"make_strategy \(",
    "the loop of the episode": r"\(harness/encounter/(loop|walkers|deciding)",
    "rows of the tables": r"\(harness/results",
    "waiting": r"_recv \(multiprocessing/connection",
    "imports": r"importlib",
    "supervision in the worker": r"\(harness/(studies/running/|encounter/pairing)",
}
"""Each part of a worker's time and how a frame of it looks; of several the innermost counts."""

COMMAND = {
    "intervals": r"\(harness/results/(estimators|findings|catalogue|columns)",
    "parts": r"\(harness/results/tables",
    "manifest and findings": r"\(harness/results",
    "waiting": r"(_recv \(multiprocessing|wait \(threading|_read \()",
    "imports": r"importlib",
}
"""The same of the command itself."""


def record(scenario: str, pairs: int, workers: int, folder: Path) -> list[tuple[str, int]]:
    """Run a batch under py-spy; gives the stacks with their numbers of samples."""
    raw = folder / "stacks.txt"
    spy = [str(Path(sys.executable).with_name("py-spy")), "record", "--subprocesses", "--native"]
    run = [sys.executable, "-m", "harness", "run", scenario, "--pairs", str(pairs), "-q"]
    run += ["--workers", str(workers), "--out", str(folder / "run")]
    command = [*spy, "--rate", str(RATE_HZ), "--format", "raw", "--output", str(raw), "--", *run]
    subprocess.run(command, check=True, capture_output=True)
    found = []
    for line in raw.read_text(encoding="utf-8").splitlines():
        stack, _, number = line.rpartition(" ")
        if number.isdigit():
            found.append((stack, int(number)))
    return found


def part_of(stack: str, parts: dict[str, str]) -> str:
    """The innermost part on a stack."""
    for frame in reversed(stack.split(";")):
        for part, pattern in parts.items():
            if re.search(pattern, frame):
                return part
    return "everything else"


def shares_of(title: str, samples: Counter[str]) -> Table:
    """Parts by their share; waiting is none."""
    total = sum(samples.values())
    table = Table("part", "share", title=title)
    for part, number in samples.most_common():
        table.add_row(part, f"{number / total:.1%}")
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="cctc")
    parser.add_argument("--pairs", type=int, default=2_000)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    workers: Counter[str] = Counter()
    command: Counter[str] = Counter()
    floors = [bare(100, 120).per_step_us]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for stack, samples in record(options.scenario, options.pairs, options.workers, folder):
            if "serve (harness/studies/running/children" not in stack:
                command[part_of(stack, COMMAND)] += samples
            elif "_end_with_parent" not in stack:
                workers[part_of(stack, PARTS)] += samples
        steps = sum(pq.read_table(folder / "run" / "episodes")["steps"].to_pylist())
    floors.append(bare(100, 120).per_step_us)
    for shares in (workers, command):
        shares.pop("waiting", None)
    console = Console(width=100)
    title = f"{options.scenario}, {options.pairs} pairs, {steps} steps: the workers"
    console.print(shares_of(title, workers))
    console.print(shares_of("the command", command))
    worked = sum(workers.values())
    own = sum(command.values()) - command["imports"]
    per_step_us = (worked - workers["imports"]) / RATE_HZ / steps * 1e6
    floor = statistics.mean(floors)
    console.print(
        f"imports apart: the command has {own / (own + worked):.1%} of the samples; "
        f"{per_step_us:.1f} µs per step in the workers, bare libsumo {floor:.1f} µs "
        f"(load {os.getloadavg()[0]:.1f})"
    )


if __name__ == "__main__":
    main()
