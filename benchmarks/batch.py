"""What a batch costs: ``python -m benchmarks.batch``.

One and two workers, a sweep, the growth with the number of pairs, and the share of everything
that is not simulation.  All rows come from this one run, in turns, so that ratios hold on a noisy
machine; medians over the rounds are printed.  Two times are given: the whole of a run, and the
steady rate from the first finished task to the last, without the start of the workers.
"""

import argparse
import resource
import statistics
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console
from rich.table import Table

from harness.experiment import run_study
from harness.options import Options
from harness.scenario import Setting, read_scenario_file
from harness.study import Study, parse_variation, single_cell, study_of


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
        return self.pairs / self.whole_s

    @property
    def steady(self) -> float:
        (begin, first), (end, last) = self.finished[0], self.finished[-1]
        return (last - first) / (end - begin) if end > begin else float("nan")

    @property
    def after_s(self) -> float:
        """Tables, summary and manifest: from the last finished task to the end."""
        return self.whole_s - self.finished[-1][0]

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

    def note(done: int, _planned: int, _what: str) -> None:
        finished.append((time.perf_counter() - begin, done))

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        run_study(study, Options(workers=workers), out=out, progress=note)
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
    return single_cell(read_scenario_file(scenario, [Setting("experiment.pairs", pairs)]))


def ten_cells(pairs: int) -> Study:
    """Five flows by two strategies."""
    file = read_scenario_file("cctc_flow", [Setting("experiment.pairs", pairs)])
    vary = ("pedestrians.flow_per_hour=50,100,250,500,1000", "arms.av=soft_yield,hard_yield")
    return study_of(file, [parse_variation(text) for text in vary])


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
    if options.many:
        rows[f"{options.many} pairs, 2 workers"] = (one_cell(options.scenario, options.many), 2)
    found: dict[str, list[Cost]] = {name: [] for name in rows}
    for _ in range(options.rounds):
        for name, (study, workers) in rows.items():
            found[name].append(timed(study, workers))
    table = Table(title=f"{options.scenario}, medians of {options.rounds} rounds")
    for heading in ("run", "pairs", "s", "pairs/s", "steady/s", "per CPU s", "end s", "overhead"):
        table.add_column(heading)
    for name, costs in found.items():
        table.add_row(
            name,
            str(costs[0].pairs),
            f"{statistics.median(c.whole_s for c in costs):.1f}",
            f"{statistics.median(c.per_second for c in costs):.1f}",
            f"{statistics.median(c.steady for c in costs):.1f}",
            f"{statistics.median(c.pairs / c.workers_cpu_s for c in costs):.1f}",
            f"{statistics.median(c.after_s for c in costs):.2f}",
            f"{statistics.median(c.overhead for c in costs):.1%}",
        )
    console = Console(width=100)
    console.print(table)
    pairs_of = list(zip(found["2 workers"], found["1 worker"], strict=True))
    console.print(
        "2 workers against 1: "
        f"{statistics.median(two.per_second / one.per_second for two, one in pairs_of):.2f} × the "
        "pairs/s of the whole run, "
        f"{statistics.median(two.steady / one.steady for two, one in pairs_of):.2f} × steady"
    )
    if options.many:
        long = found[f"{options.many} pairs, 2 workers"]
        pairs_of = list(zip(long, found["2 workers"], strict=True))
        print_growth(console, options.many, options.pairs, pairs_of)


def print_growth(console: Console, many: int, few: int, costs: list[tuple[Cost, Cost]]) -> None:
    """Time per pair of the long run over that of the short one; 1 is linear."""
    steady = statistics.median(short.steady / long.steady for long, short in costs)
    cpu = statistics.median(
        (long.parent_cpu_s + long.workers_cpu_s)
        / long.pairs
        / ((short.parent_cpu_s + short.workers_cpu_s) / short.pairs)
        for long, short in costs
    )
    console.print(
        f"time per pair at {many} pairs over that at {few}: {steady:.3f} steady, "
        f"{cpu:.3f} in processor time with the start of the workers"
    )


if __name__ == "__main__":
    main()
