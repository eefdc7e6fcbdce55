"""What the harness costs on top of SUMO: ``python -m benchmarks.engine``.

Every row is measured in this one run, in turns, so that the ratios hold on a noisy machine; the
median over the rounds is printed.  Traffic: the paper's experiment, one ego and one pedestrian.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import libsumo
from rich.console import Console
from rich.table import Table

from harness.encounter import Arm, Trace
from harness.engine.protocol import Engine
from harness.engine.sumo import libsumo_engine
from harness.engine.traci import traci_engine
from harness.episode.arrivals import planned_arrivals
from harness.episode.pairing import PairRunner
from harness.interaction import InteractionModel, load_model
from harness.measures import measure
from harness.network import place_of
from harness.roads import read_site
from harness.scenario import Scenario, Setting, load_scenario


@dataclass
class Cost:
    """Seconds for some episodes."""

    seconds: float
    episodes: int
    steps: int
    model_s: float = 0.0
    measures_s: float = 0.0

    @property
    def measures_share(self) -> float:
        return self.measures_s / self.seconds

    @property
    def per_step_us(self) -> float:
        return (self.seconds - self.model_s) / self.steps * 1e6

    @property
    def model_us(self) -> float:
        return self.model_s / self.steps * 1e6

    @property
    def per_second(self) -> float:
        return self.episodes / self.seconds


class TimedModel(InteractionModel):
    """The interaction model with a stopwatch."""

    spent_s = 0.0

    def walking_speed(self, *args, **kwargs):  # type: ignore[no-untyped-def]
        begin = time.perf_counter()
        try:
            return super().walking_speed(*args, **kwargs)
        finally:
            self.spent_s += time.perf_counter() - begin

    def driver_speed(self, *args, **kwargs):  # type: ignore[no-untyped-def]
        begin = time.perf_counter()
        try:
            return super().driver_speed(*args, **kwargs)
        finally:
            self.spent_s += time.perf_counter() - begin


def timed_model() -> TimedModel:
    """The default model, timed."""
    model = load_model(Scenario().model.name)
    return TimedModel(model.mixture, model.name, model.provenance, model.sha256)


def harness_arm(strategy: str, episodes: int, make: Callable[[], Engine]) -> Cost:
    """One arm of the harness: plan, episode, contact and measures."""
    scenario = load_scenario("cctc", [Setting("arms.av", strategy)])
    model = timed_model()
    engine = make()
    runner = PairRunner(scenario, model, lambda: engine)
    runner._run_arm(Arm.AV, 0, planned_arrivals(scenario, 0))
    model.spent_s = 0.0
    begin = time.perf_counter()
    traces: list[Trace] = []
    planned = {pair: planned_arrivals(scenario, pair) for pair in range(episodes)}
    for pair, arrivals in planned.items():
        traces.append(runner._run_arm(Arm.AV, pair, arrivals))
    simulated = time.perf_counter()
    measure(traces)
    end = time.perf_counter()
    engine.close()
    steps = sum(len(trace.x_m) - 1 for trace in traces)
    return Cost(end - begin, episodes, steps, model.spent_s, end - simulated)


def bare(episodes: int, steps: int) -> Cost:
    """libsumo stepping one vehicle and one walking person, no call in between."""
    scenario = load_scenario("cctc")
    place = place_of(scenario)
    engine = libsumo_engine(place, scenario.vehicle(), scenario.crosswalk(), 0.1)
    site = read_site(place)
    begin = time.perf_counter()
    for number in range(episodes):
        person, ego = f"person-{number}", f"vehicle-{number}"
        near, far = site.footpaths
        libsumo.person.add(person, near.edge, near.inside_m)
        libsumo.person.appendWalkingStage(person, [near.edge, far.edge], far.inside_m)
        libsumo.simulationStep()
        libsumo.vehicle.add(
            ego,
            "drive",
            typeID="ego",
            departLane="0",
            departPos=repr(site.ego.departure(30.0).position_m),
            departSpeed="5.0",
        )
        libsumo.vehicle.setSpeedMode(ego, 32)
        libsumo.vehicle.setSpeed(ego, 5.0)
        libsumo.simulationStep()
        for _ in range(steps):
            libsumo.simulationStep()
        libsumo.vehicle.remove(ego)
        if person in libsumo.person.getIDList():
            libsumo.person.remove(person)
    seconds = time.perf_counter() - begin
    engine.close()
    return Cost(seconds, episodes, episodes * steps)


def restarted(episodes: int, start: Callable[[], Engine]) -> Cost:
    """The harness's AV arm with a SUMO of its own for every episode."""
    scenario = load_scenario("cctc")
    model = timed_model()
    planned = {pair: planned_arrivals(scenario, pair) for pair in range(episodes)}
    engines: list[Engine] = []

    def fresh() -> Engine:
        engines.append(start())
        return engines[-1]

    runner = PairRunner(scenario, model, fresh)
    steps = 0
    begin = time.perf_counter()
    for pair, arrivals in planned.items():
        runner._engine = None
        trace = runner._run_arm(Arm.AV, pair, arrivals)
        engines.pop().close()
        steps += len(trace.x_m) - 1
    return Cost(time.perf_counter() - begin, episodes, steps)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--episodes", type=int, default=200)
    options = parser.parse_args()
    scenario = load_scenario("cctc")
    place, vehicle, crossing = place_of(scenario), scenario.vehicle(), scenario.crosswalk()

    def local() -> Engine:
        return libsumo_engine(place, vehicle, crossing, 0.1)

    def remote() -> Engine:
        return traci_engine(place, vehicle, crossing, 0.1)

    # Both ends of TraCI's socket on one core: 3 to 6 times faster than across cores.
    everything = os.sched_getaffinity(0)

    def pinned(measure_it: Callable[[], Cost]) -> Cost:
        os.sched_setaffinity(0, {min(everything)})
        try:
            return measure_it()
        finally:
            os.sched_setaffinity(0, everything)

    n = options.episodes

    def steps_of(arm: str) -> int:
        """Steps of an episode of that arm, as just measured."""
        cost = found[arm][-1]
        return round(cost.steps / cost.episodes)

    rows: dict[str, Callable[[], Cost]] = {
        "AV arm (soft_yield)": lambda: harness_arm("soft_yield", n, local),
        "bare libsumo, same steps as AV": lambda: bare(n, steps_of("AV arm (soft_yield)")),
        "control arm (constant_speed)": lambda: harness_arm("constant_speed", n, local),
        "bare libsumo, same steps as control": lambda: bare(
            n, steps_of("control arm (constant_speed)")
        ),
        "human arm (human_gmm)": lambda: harness_arm("human_gmm", n, local),
        "bare libsumo, same steps as human": lambda: bare(n, steps_of("human arm (human_gmm)")),
        "libsumo started for each episode": lambda: restarted(max(1, n // 10), local),
        "TraCI, one open server, one core": lambda: pinned(
            lambda: harness_arm("soft_yield", max(1, n // 10), remote)
        ),
        "TraCI, a process for each episode": lambda: restarted(2, remote),
    }
    found: dict[str, list[Cost]] = {name: [] for name in rows}
    for _ in range(options.rounds):
        for name, measure_it in rows.items():
            found[name].append(measure_it())
    print_costs(found)


def print_costs(found: dict[str, list[Cost]]) -> None:
    """The table of all ways, and the ratios that mean something on a shared machine."""
    table = Table(title="medians of the rounds")
    for heading in ("way", "episodes/s", "µs/step", "model µs/step", "measures", "steps/episode"):
        table.add_column(heading)
    for name, costs in found.items():
        table.add_row(
            name,
            f"{statistics.median(c.per_second for c in costs):.0f}",
            f"{statistics.median(c.per_step_us for c in costs):.2f}",
            f"{statistics.median(c.model_us for c in costs):.2f}",
            f"{statistics.median(c.measures_share for c in costs):.1%}",
            f"{costs[0].steps / costs[0].episodes:.0f}",
        )
    console = Console()
    console.print(table)
    for arm, reference in (
        ("AV arm (soft_yield)", "bare libsumo, same steps as AV"),
        ("control arm (constant_speed)", "bare libsumo, same steps as control"),
        ("human arm (human_gmm)", "bare libsumo, same steps as human"),
    ):
        ratios = [
            a.per_step_us / b.per_step_us for a, b in zip(found[arm], found[reference], strict=True)
        ]
        with_model = [
            (a.per_step_us + a.model_us) / b.per_step_us
            for a, b in zip(found[arm], found[reference], strict=True)
        ]
        console.print(
            f"{arm}: {statistics.median(ratios):.2f} × bare without the model's time, "
            f"{statistics.median(with_model):.2f} × with it"
        )
    for other in ("libsumo started for each episode", "TraCI, one open server, one core"):
        ratios = [
            a.per_second / b.per_second
            for a, b in zip(found["AV arm (soft_yield)"], found[other], strict=True)
        ]
        console.print(f"AV arm: {statistics.median(ratios):.1f} × the episodes/s of: {other}")
    console.print(
        "TraCI with a process for each episode spends most of its second in a fixed sleep of "
        "traci.start: no figure to boast of."
    )


if __name__ == "__main__":
    main()
