"""What a batch costs: ``python -m benchmarks.batch``.

One and two workers, a sweep, the growth with the number of pairs, peak memory, and the share of
everything that is not simulation.  All rows come from this one run, in turns and in changing order,
so that ratios hold on a noisy machine; medians over the rounds are printed.  Two rates are given:
of the whole run, and the steady one between the first and the last finished task, without the start
of the workers.
"""

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console
from rich.table import Table

from harness.scenario import Setting, Study, read_scenario_file, study_of
from harness.scenario.variation import parse_variation
from harness.studies.running.run import run

FLOWS = "pedestrians.flow_per_hour=50,100,250,500,1000"
STRATEGIES = "arms.av=soft_yield,hard_yield"


@dataclass
class Cost:
    """Times of one run in s; ``finished`` holds (time, pairs done) whenever a task was."""

    pairs: int
    whole_s: float
    parent_cpu_s: float
    workers_cpu_s: float
    finished: list[tuple[float, int]] = field(repr=False)

    @property
    def per_second(self) -> float:
        """Pairs per second of the whole run."""
        return self.pairs / self.whole_s

    @property
    def steady(self) -> float:
        """Pairs per second between the first and the last finished task."""
        (begin, first), (end, last) = self.finished[0], self.finished[-1]
        return (last - first) / (end - begin) if end > begin else float("nan")

    @property
    def start_s(self) -> float:
        """Until the first task is finished."""
        return self.finished[0][0]

    @property
    def after_s(self) -> float:
        """Findings: from the last finished task to the end."""
        return self.whole_s - self.finished[-1][0]

    @property
    def cpu_per_pair_s(self) -> float:
        """Processor time of a pair, of the workers and their parent."""
        return (self.parent_cpu_s + self.workers_cpu_s) / self.pairs

    @property
    def overhead(self) -> float:
        """The parent's share of all processor time: writing, summarising, supervision."""
        return self.parent_cpu_s / (self.parent_cpu_s + self.workers_cpu_s)


def cpu_s(who: int) -> float:
    """User and system time so far."""
    usage = resource.getrusage(who)
    return usage.ru_utime + usage.ru_stime


def timed(study: Study, workers: int) -> Cost:
    """Run a study and throw the results away."""
    finished: list[tuple[float, int]] = []
    own, children = cpu_s(resource.RUSAGE_SELF), cpu_s(resource.RUSAGE_CHILDREN)
    begin = time.perf_counter()

    def note(done: int, _planned: int) -> None:
        finished.append((time.perf_counter() - begin, done))

    with tempfile.TemporaryDirectory() as folder:
        run(study, workers=workers, out=Path(folder) / "run", progress=note)
        whole = time.perf_counter() - begin
    return Cost(
        pairs=sum(cell.scenario.experiment.pairs for cell in study.cells),
        whole_s=whole,
        parent_cpu_s=cpu_s(resource.RUSAGE_SELF) - own,
        workers_cpu_s=cpu_s(resource.RUSAGE_CHILDREN) - children,
        finished=finished,
    )


def one_cell(scenario: str, pairs: int) -> Study:
    """A run of one cell."""
    return study_of(read_scenario_file(scenario, [Setting("experiment.pairs", pairs)]))


def ten_cells(pairs: int) -> Study:
    """Five flows by two strategies."""
    file = read_scenario_file("cctc_flow", [Setting("experiment.pairs", pairs)])
    return study_of(file, [parse_variation(text) for text in (FLOWS, STRATEGIES)])


def command_s(scenario: str, workers: int) -> float:
    """Wall time of ``harness run SCENARIO`` as it stands, from an own process."""
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, "-m", "harness", "run", scenario, "-q", "--out", f"{folder}/run"]
        begin = time.perf_counter()
        subprocess.run([*words, "--workers", str(workers)], check=True, capture_output=True)
        return time.perf_counter() - begin


def peak_mb(scenario: str, pairs: int) -> tuple[float, float]:
    """Peak memory of a run with two workers, in a process of its own: (parent, largest worker)."""
    code = (
        "import resource, sys\n"
        "from benchmarks.batch import one_cell, timed\n"
        "timed(one_cell(sys.argv[1], int(sys.argv[2])), 2)\n"
        "for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN):\n"
        "    print(resource.getrusage(who).ru_maxrss)\n"
    )
    command = [sys.executable, "-c", code, scenario, str(pairs)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    parent, worker = (int(number) / 1024 for number in done.stdout.split())
    return parent, worker


def ratio(above: list[Cost], below: list[Cost], value: Callable[[Cost], float]) -> float:
    """Median of the ratios within each round."""
    rounds = zip(above, below, strict=True)
    return statistics.median(value(one) / value(other) for one, other in rounds)


def measured(rows: dict[str, tuple[Study, int]], rounds: int) -> dict[str, list[Cost]]:
    """Every row once in each round, there and back, so that a drift favours none."""
    found: dict[str, list[Cost]] = {name: [] for name in rows}
    for number in range(rounds):
        order = list(rows.items())
        for name, (study, workers) in order if number % 2 == 0 else reversed(order):
            found[name].append(timed(study, workers))
    return found


def table_of(title: str, found: dict[str, list[Cost]]) -> Table:
    """All rows with their medians."""
    table = Table(title=title)
    columns: dict[str, Callable[[Cost], str]] = {
        "pairs": lambda cost: f"{cost.pairs}",
        "s": lambda cost: f"{cost.whole_s:.1f}",
        "pairs/s": lambda cost: f"{cost.per_second:.1f}",
        "steady/s": lambda cost: f"{cost.steady:.1f}",
        "ms CPU/pair": lambda cost: f"{1e3 * cost.cpu_per_pair_s:.2f}",
        "start s": lambda cost: f"{cost.start_s:.2f}",
        "end s": lambda cost: f"{cost.after_s:.2f}",
        "parent": lambda cost: f"{cost.overhead:.1%}",
    }
    for heading in ("run", *columns):
        table.add_column(heading)
    for name, costs in found.items():
        middle = Cost(
            pairs=costs[0].pairs,
            whole_s=statistics.median(cost.whole_s for cost in costs),
            parent_cpu_s=statistics.median(cost.parent_cpu_s for cost in costs),
            workers_cpu_s=statistics.median(cost.workers_cpu_s for cost in costs),
            finished=sorted(costs, key=lambda cost: cost.steady)[len(costs) // 2].finished,
        )
        table.add_row(name, *(shown(middle) for shown in columns.values()))
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="cctc")
    parser.add_argument("--pairs", type=int, default=1_000, help="of a run, and of each cell")
    parser.add_argument("--many", type=int, default=20_000, help="of the long run; 0 leaves it out")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    rows: dict[str, tuple[Study, int]] = {
        "1 worker": (one_cell(options.scenario, options.pairs), 1),
        "2 workers": (one_cell(options.scenario, options.pairs), 2),
        "10 cells, 2 workers": (ten_cells(options.pairs), 2),
    }
    long = f"{options.many} pairs, 2 workers"
    if options.many:
        rows[long] = (one_cell(options.scenario, options.many), 2)
    found = measured(rows, options.rounds)
    console = Console(width=110)
    console.print(table_of(f"{options.scenario}, medians of {options.rounds} rounds", found))
    one, two = found["1 worker"], found["2 workers"]
    console.print(
        f"2 workers against 1: {ratio(two, one, lambda cost: cost.steady):.2f} × pairs/s steady "
        f"({', '.join(f'{b.steady / a.steady:.2f}' for a, b in zip(one, two, strict=True))}), "
        f"{ratio(two, one, lambda cost: cost.per_second):.2f} × in the whole run; "
        f"{ratio(two, one, lambda cost: cost.cpu_per_pair_s):.3f} × the processor time per pair"
    )
    commands = [
        [command_s(options.scenario, workers) for workers in (1, 2)] for _ in range(options.rounds)
    ]
    took = [statistics.median(times) for times in zip(*commands, strict=True)]
    console.print(
        f"`harness run {options.scenario}` as it stands: {took[0]:.2f} s with one worker, "
        f"{took[1]:.2f} s with two"
    )
    if options.many:
        steady = ratio(two, found[long], lambda cost: cost.steady)
        cpu = ratio(found[long], two, lambda cost: cost.cpu_per_pair_s)
        console.print(
            f"time per pair at {options.many} pairs over that at {options.pairs}: {steady:.3f} "
            f"steady, {cpu:.3f} in processor time with the start of the workers"
        )
        few, many = (peak_mb(options.scenario, pairs) for pairs in (options.pairs, options.many))
        console.print(
            f"peak memory at {options.many} pairs over that at {options.pairs}: "
            f"{many[0]:.0f} / {few[0]:.0f} MB in the command, {many[1]:.0f} / {few[1]:.0f} MB in a "
            f"worker: {many[0] / few[0]:.2f} × and {many[1] / few[1]:.2f} ×"
        )


if __name__ == "__main__":
    main()
