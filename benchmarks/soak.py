"""Whether a long run stays as it began: ``python -m benchmarks.soak``.

``harness run`` is started as it stands, with a folder of its own for temporary files, and looked at
from outside every few seconds: memory, open files and threads of the command and of its workers,
processor time, pairs done, temporary files.  What is printed holds the second half of the pairs
against the first.  How fast the machine is meanwhile, with all else that runs on it, is told by a
few pairs in a SUMO started for them at each look, and taken out of the processor time.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
import psutil
from rich.console import Console
from rich.table import Table

from harness.encounter.pairing import PairRunner
from harness.engine.shared import close_engine, open_engine
from harness.model.interaction import load_model
from harness.results.folder import MANIFEST, done_parts, read_manifest
from harness.scenario import load_scenario

COMMAND = "command"

STARTING = 0.05
"""Share of the pairs after which a run counts as started: caches are filled by then."""

PARTS = 5
"""Into which each half is divided for rates."""

FRESH_PAIRS = 10
"""Pairs that tell the machine's pace at each look."""


class State(NamedTuple):
    """One process at one time; ``memory_mb`` is its own alone (USS), ``resident_mb`` all (RSS)."""

    memory_mb: float
    resident_mb: float
    open_files: int
    threads: int
    cpu_s: float


class Look(NamedTuple):
    """One look at a run: wall time since its start, and every process by name.

    ``fresh_s`` is the processor time of a few pairs in a fresh SUMO, here and now.
    """

    time_s: float
    pairs: int
    temporary_files: int
    fresh_s: float
    states: dict[str, State]

    @property
    def cpu_s(self) -> float:
        """Processor time of all processes so far."""
        return sum(state.cpu_s for state in self.states.values())


class Soak(NamedTuple):
    """A run from start to end; ``left`` are files that should be gone."""

    exit_code: int
    pairs: int
    looks: list[Look]
    left: list[str]

    def halves(self) -> tuple[list[Look], list[Look]]:
        """The looks at the started run before and after half of its pairs, workers all there.

        The look at the middle ends the first half and begins the second.
        """
        workers = max(len(look.states) for look in self.looks)
        steady = [
            look
            for look in self.looks
            if len(look.states) == workers and STARTING * self.pairs <= look.pairs < self.pairs
        ]
        middle = next(n for n, look in enumerate(steady) if look.pairs >= self.pairs / 2)
        return steady[: middle + 1], steady[middle:]

    def per_pair(self, value: Callable[[Look], float]) -> tuple[float, float]:
        """Growth of a value per pair in each half, as of processor time.

        The median over ``PARTS`` of each half: other load passes, growth does not.
        """
        first, second = (median(_rates(half, value)) for half in self.halves())
        return first, second

    def slowing(self) -> float:
        """Processor time per pair in the second half over the first, the machine's pace taken out.

        The pace is the median of ``fresh_s`` in either half.
        """
        first, second = self.per_pair(lambda look: look.cpu_s)
        before, after = (median(look.fresh_s for look in half) for half in self.halves())
        return (second / after) / (first / before)

    def middle(self, name: str, value: Callable[[State], float]) -> tuple[float, float]:
        """Median of a value of one process in each half."""
        first, second = (
            median(value(look.states[name]) for look in half) for half in self.halves()
        )
        return first, second

    def slope(self, name: str, value: Callable[[State], float]) -> float:
        """Growth of a value of one process per 1,000 pairs in the second half, least squares."""
        _, looks = self.halves()
        pairs = np.array([look.pairs / 1_000 for look in looks])
        values = np.array([value(look.states[name]) for look in looks])
        pairs = pairs - pairs.mean()
        return float(pairs @ values / (pairs @ pairs))

    def most(self, name: str, value: Callable[[State], float]) -> float:
        """Largest value of one process at any look, finishing the tables included."""
        return max(value(look.states[name]) for look in self.looks if name in look.states)


def _rates(half: list[Look], value: Callable[[Look], float]) -> Iterator[float]:
    """Growth of a value per pair in each part of a half."""
    first, last = half[0].pairs, half[-1].pairs
    ends = [first + (last - first) * part / PARTS for part in range(PARTS + 1)]
    marks = [next(look for look in half if look.pairs >= end) for end in ends]
    for before, after in pairwise(marks):
        if after.pairs > before.pairs:
            yield (value(after) - value(before)) / (after.pairs - before.pairs)


def soak(
    scenario: str, pairs: int, workers: int, settings: Sequence[str], out: Path, every_s: float
) -> Soak:
    """Run a scenario to its end and look at it.

    Args:
        scenario: name or path.
        pairs: how many.
        workers: how many; as many tasks must be under way at a time.
        settings: further ``key=value`` of the scenario.
        out: the run folder.
        every_s: pause between two looks.
    """
    options = [part for setting in settings for part in ("--set", setting)]
    command = [sys.executable, "-m", "harness", "run", scenario, "--quiet", *options]
    command += ["--pairs", str(pairs), "--workers", str(workers), "--out", str(out)]
    fresh_s = _pace()
    with tempfile.TemporaryDirectory(prefix="soak-") as folder:
        temporary = Path(folder)
        begin = time.perf_counter()
        # What the command prints is one line; a pipe holds it.
        process = subprocess.Popen(
            command, env={**os.environ, "TMPDIR": folder}, stdout=subprocess.DEVNULL
        )
        looks: list[Look] = []
        try:
            while process.poll() is None:
                with suppress(psutil.Error):
                    states = _states(process.pid)
                    done = _pairs_done(out, pairs)
                    passed = time.perf_counter() - begin
                    count = len(_files(temporary))
                    looks.append(Look(passed, done, count, fresh_s(), states))
                time.sleep(every_s)
        finally:
            process.kill()
            process.wait()
        left = [str(path.relative_to(temporary)) for path in _files(temporary)]
    left += [path.name for path in out.iterdir() if _hidden(path) and path.name != ".lock"]
    return Soak(process.returncode, pairs, looks, left)


def _pace() -> Callable[[], float]:
    """Measures the processor time of a few pairs of ``cctc`` in a SUMO started for them, in s."""
    scenario = load_scenario("cctc")
    model = load_model(scenario.model.name)
    runner = PairRunner(scenario, model, lambda: open_engine(scenario))

    def fresh_s() -> float:
        begin = time.process_time()
        for _ in runner.run(range(FRESH_PAIRS)):
            pass
        close_engine()
        return time.process_time() - begin

    fresh_s()  # imports and caches
    return fresh_s


def _states(pid: int) -> dict[str, State]:
    command = psutil.Process(pid)
    children = sorted(command.children(), key=lambda child: child.pid)
    named = {f"worker {n + 1}": child for n, child in enumerate(children)}
    return {name: _state(process) for name, process in {COMMAND: command, **named}.items()}


def _state(process: psutil.Process) -> State:
    with process.oneshot():
        memory, cpu = process.memory_full_info(), process.cpu_times()
        return State(
            memory_mb=memory.uss / 2**20,
            resident_mb=memory.rss / 2**20,
            open_files=process.num_fds(),
            threads=process.num_threads(),
            cpu_s=cpu.user + cpu.system,
        )


def _pairs_done(run: Path, pairs: int) -> int:
    """By the parts."""
    if not (run / MANIFEST).is_file():
        return 0
    return min(pairs, len(done_parts(run)) * int(read_manifest(run)["pairs_per_part"]))


def _files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*"))


def _hidden(path: Path) -> bool:
    return path.name.startswith(".")


VALUES: dict[str, Callable[[State], float]] = {
    "own memory (USS), MB": lambda state: state.memory_mb,
    "resident memory (RSS), MB": lambda state: state.resident_mb,
    "open files": lambda state: state.open_files,
    "threads": lambda state: state.threads,
}


def table_of(title: str, found: Soak) -> Table:
    """Second half against first."""
    table = Table(title=title)
    for heading in ("", "first half", "second half", "ratio", "per 1,000 pairs", "most"):
        table.add_column(heading, justify="left" if not heading else "right")
    for what, value in (
        ("processor time per pair, ms", lambda look: 1e3 * look.cpu_s),
        ("wall time per pair, ms", lambda look: 1e3 * look.time_s),
    ):
        first, second = found.per_pair(value)
        table.add_row(what, f"{first:.3f}", f"{second:.3f}", f"{second / first:.3f}", "", "")
    pace = "processor time, the machine's pace taken out"
    table.add_row(pace, "", "", f"{found.slowing():.3f}", "", "")
    for name in found.halves()[0][0].states:
        for what, value in VALUES.items():
            first, second = found.middle(name, value)
            slope, most = found.slope(name, value), found.most(name, value)
            row = (f"{first:.1f}", f"{second:.1f}", f"{second / first:.3f}")
            table.add_row(f"{name}: {what}", *row, f"{slope:+.4f}", f"{most:.1f}")
    return table


def main() -> None:
    """Run, look and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="cctc")
    parser.add_argument("--pairs", type=int, default=100_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--out", type=Path, required=True, help="the run folder")
    parser.add_argument("--every", type=float, default=3.0, help="seconds between two looks")
    options = parser.parse_args()
    given = (options.scenario, options.pairs, options.workers, options.set, options.out)
    found = soak(*given, options.every)
    console = Console(width=120)
    title = f"{options.scenario}, {options.pairs} pairs, {options.workers} workers"
    if found.exit_code == 0:
        console.print(table_of(title, found))
    most = max(look.temporary_files for look in found.looks)
    console.print(
        f"exit code {found.exit_code} after {found.looks[-1].time_s:.0f} s; "
        f"at most {most} temporary files, left behind: {', '.join(found.left) or 'none'}"
    )


if __name__ == "__main__":
    main()
