"""What the harness costs on top of SUMO: ``python -m benchmarks.engine``.

Traffic: the paper's experiment, one ego and one pedestrian.  Ways that are compared are run in
short turns in one process, and processor time is counted, so that the ratios within a turn hold
on a machine that others use too; printed are their medians and quartiles over all turns.
"""

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import libsumo
import pyarrow.parquet as pq
from rich.console import Console
from rich.table import Table

from harness.core.vocabulary import Arm, Trace
from harness.encounter.pairing import CHUNK_PAIRS, PairRunner
from harness.engine.protocol import Engine
from harness.engine.shared import open_engine
from harness.engine.sources import APPROACH_M
from harness.measures import measure
from harness.model.interaction import InteractionModel, load_model
from harness.scenario import Scenario, Setting, load_scenario

TURN = CHUNK_PAIRS
"""Episodes of a turn: measured together, as in a run."""

AV, CONTROL, HUMAN = "soft_yield", "constant_speed", "human_gmm"


@dataclass
class Cost:
    """Processor time of some episodes in s, with the interaction model's and the measures'."""

    seconds: float
    steps: Sequence[int]
    """Of each episode."""
    model_s: float = 0.0
    measures_s: float = 0.0

    @property
    def per_step_us(self) -> float:
        """Processor time of a step."""
        return self.seconds / sum(self.steps) * 1e6

    @property
    def without_model_us(self) -> float:
        """The same without the interaction model's."""
        return (self.seconds - self.model_s) / sum(self.steps) * 1e6

    @property
    def per_second(self) -> float:
        """Episodes per second of processor time."""
        return len(self.steps) / self.seconds


class TimedModel(InteractionModel):
    """The interaction model with a stopwatch."""

    spent_s = 0.0

    def walking_speed(self, *args, **kwargs):  # type: ignore[no-untyped-def]
        """See ``InteractionModel``."""
        begin = time.process_time()
        try:
            return super().walking_speed(*args, **kwargs)
        finally:
            self.spent_s += time.process_time() - begin

    def driver_speed(self, *args, **kwargs):  # type: ignore[no-untyped-def]
        """See ``InteractionModel``."""
        begin = time.process_time()
        try:
            return super().driver_speed(*args, **kwargs)
        finally:
            self.spent_s += time.process_time() - begin


class HarnessArm:
    """One arm of the harness, turn by turn: plan, episode, contact and measures."""

    def __init__(self, strategy: str, get_engine: Callable[[], Engine]) -> None:
        self._scenario = load_scenario("cctc", [Setting("arms.av", strategy)])
        model = load_model(Scenario().model.name)
        self._model = TimedModel(model.mixture, model.name, model.provenance, model.sha256)
        self._runner = PairRunner(self._scenario, self._model, get_engine)
        self._next = 0
        self.turn(1)

    def turn(self, episodes: int) -> Cost:
        """The next episodes."""
        pairs = range(self._next, self._next + episodes)
        self._next = pairs.stop
        self._model.spent_s = 0.0
        begin = time.process_time()
        planned = {pair: self._runner._people(pair) for pair in pairs}
        traces: list[Trace] = []
        for pair, people in planned.items():
            traces.append(self._runner._run_arm(Arm.AV, pair, people, lambda *_: None))
        simulated = time.process_time()
        measure(traces)
        end = time.process_time()
        steps = [len(trace.x_m) - 1 for trace in traces]
        return Cost(end - begin, steps, self._model.spent_s, end - simulated)

    def forget_engine(self) -> None:
        """The next episode asks for another one."""
        self._runner._engine = None


class Bare:
    """libsumo stepping one vehicle and one walking person, no call in between."""

    def __init__(self) -> None:
        self._position = repr(APPROACH_M - 30.0)
        self._number = 0

    def turn(self, steps: Sequence[int]) -> Cost:
        """Episodes of so many steps, in the simulation that is open in this process."""
        begin = time.process_time()
        for count in steps:
            self._number += 1
            person, ego = f"person-{self._number}", f"vehicle-{self._number}"
            libsumo.person.add(person, "near", 1.0)
            libsumo.person.appendWalkingStage(person, ["near", "far"], 1.0)
            libsumo.simulationStep()
            libsumo.vehicle.add(
                ego,
                "drive",
                typeID="ego",
                departLane="0",
                departPos=self._position,
                departSpeed="5.0",
            )
            libsumo.vehicle.setSpeedMode(ego, 32)
            libsumo.vehicle.setSpeed(ego, 5.0)
            libsumo.simulationStep()
            for _ in range(count):
                libsumo.simulationStep()
            libsumo.vehicle.remove(ego)
            if person in libsumo.person.getIDList():
                libsumo.person.remove(person)
        return Cost(time.process_time() - begin, steps)


@contextmanager
def opened(start: Callable[[], Engine]) -> Iterator[Engine]:
    """An engine, closed at the end."""
    engine = start()
    try:
        yield engine
    finally:
        engine.close()


def local() -> Engine:
    """SUMO in this process."""
    scenario = load_scenario("cctc")
    return open_engine(scenario)


def bare(episodes: int, steps: int) -> Cost:
    """The floor, in a simulation of its own."""
    with opened(local):
        return Bare().turn([steps] * episodes)


def beside_bare(strategy: str, turns: int) -> tuple[list[Cost], list[Cost]]:
    """An arm and bare stepping of as many steps, in turns."""
    arms, floors = [], []
    with opened(local) as engine:
        arm, floor = HarnessArm(strategy, lambda: engine), Bare()
        for _ in range(turns):
            arms.append(arm.turn(TURN))
            floors.append(floor.turn(arms[-1].steps))
    return arms, floors


def beside_restarts(turns: int) -> tuple[list[Cost], list[Cost]]:
    """The AV's arm on an open simulation, and with one started for each episode."""
    kept, started = [], []
    for _ in range(turns):
        with opened(local) as engine:
            kept.append(HarnessArm(AV, lambda engine=engine: engine).turn(TURN))  # type: ignore[misc]
        engines: list[Engine] = []

        def fresh(engines: list[Engine] = engines) -> Engine:
            engines.append(local())
            return engines[-1]

        arm = HarnessArm(AV, fresh)
        begin, steps = time.process_time(), list[int]()
        for _ in range(TURN):
            engines.pop().close()
            arm.forget_engine()
            steps += arm.turn(1).steps
        started.append(Cost(time.process_time() - begin, steps))
        engines.pop().close()
    return kept, started


def whole_run_us(few: int, many: int) -> float:
    """Processor time of ``harness run cctc`` for each ego-step, start and imports apart.

    Command and worker together, as the difference of two runs.
    """
    times, steps = [], []
    for pairs in (few, many):
        with tempfile.TemporaryDirectory() as folder:
            run = [sys.executable, "-m", "harness", "run", "cctc", "-q", "--workers", "1"]
            begin = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run(
                [*run, "--pairs", str(pairs), "--out", f"{folder}/run"],
                check=True,
                capture_output=True,
            )
            end = resource.getrusage(resource.RUSAGE_CHILDREN)
            episodes = pq.read_table(Path(folder) / "run" / "episodes")
            steps.append(sum(episodes["steps"].to_pylist()))
        times.append(end.ru_utime + end.ru_stime - begin.ru_utime - begin.ru_stime)
    return float((times[1] - times[0]) / (steps[1] - steps[0]) * 1e6)


def spread(values: Sequence[float]) -> str:
    """Median and quartiles."""
    low, middle, high = statistics.quantiles(values, n=4)
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=20, help="of each arm beside bare libsumo")
    parser.add_argument("--rounds", type=int, default=5, help="of the whole run")
    options = parser.parse_args()
    table = Table(title="medians of the turns, processor time")
    for heading in ("way", "episodes/s", "µs/step", "of it the model", "measures"):
        table.add_column(heading)
    lines = []

    def note(way: str, costs: Sequence[Cost]) -> None:
        table.add_row(
            way,
            f"{statistics.median(c.per_second for c in costs):.0f}",
            f"{statistics.median(c.per_step_us for c in costs):.1f}",
            f"{statistics.median(c.per_step_us - c.without_model_us for c in costs):.1f}",
            f"{statistics.median(c.measures_s / c.seconds for c in costs):.1%}",
        )

    floor_us = []
    for name, strategy in (("AV", AV), ("control", CONTROL), ("human", HUMAN)):
        arms, floors = beside_bare(strategy, options.turns)
        note(f"{name} arm ({strategy})", arms)
        note("bare libsumo, as many steps", floors)
        both = list(zip(arms, floors, strict=True))
        floor_us += [floor.per_step_us for floor in floors]
        without = spread([arm.without_model_us / floor.per_step_us for arm, floor in both])
        with_it = spread([arm.per_step_us / floor.per_step_us for arm, floor in both])
        lines.append(f"{name} arm: {without} × bare without the model's time, {with_it} with it")
    for way, (ours, others) in (
        ("libsumo started for each episode", beside_restarts(max(2, options.turns // 4))),
    ):
        note(way, others)
        both = list(zip(ours, others, strict=True))
        times = spread([one.per_second / other.per_second for one, other in both])
        lines.append(f"AV arm: {times} × the episodes/s of: {way}")
    whole = [whole_run_us(50, 550) for _ in range(options.rounds)]
    lines.append(
        f"`harness run cctc`: {spread(whole)} µs of command and worker per ego-step beyond the "
        f"start, {statistics.median(whole) / statistics.median(floor_us):.2f} × bare"
    )
    console = Console()
    console.print(table)
    for line in lines:
        console.print(line)


if __name__ == "__main__":
    main()
