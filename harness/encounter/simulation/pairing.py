"""Runs pairs of one cell with ``[simulation]``: the user's scenario twice with one seed."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from harness.core.encounter import Arm, StepMotion, Strategy, Trace
from harness.core.errors import EngineError, StrategyError, in_one_line
from harness.encounter.arms import check_arms, make_strategy
from harness.encounter.simulation.arm import SimulationArm
from harness.encounter.simulation.demand import number_of, write_people
from harness.encounter.simulation.driving import PassageLog
from harness.encounter.simulation.log import SimulationLog, uniform_of
from harness.encounter.simulation.passages import VehicleTrack, passage
from harness.encounter.simulation.people import PeopleAtCrosswalk
from harness.encounter.simulation.seeing import SimulationSight
from harness.encounter.simulation.trips import Trip, read_trips
from harness.engine.simulation.outputs import Kept
from harness.engine.simulation.running import (
    NO_OPTIONS,
    TRIPS_FILE,
    Function,
    OwnSimulation,
    write_config,
)
from harness.measures import EpisodeRecord, measure
from harness.model.interaction import InteractionModel
from harness.scenario import Scenario
from harness.scenario.consistency import SUMO_DRIVER
from harness.scenario.own_simulation import setting_of, sumo_seed
from harness.site.simulation import Setting
from harness.strategies.perception.sensor import sensor_of
from harness.strategies.perception.updates import Views


@dataclass(frozen=True, slots=True)
class MeasuredPassage:
    """A passage over a chosen crosswalk with its trace and its record."""

    log: PassageLog
    trace: Trace
    record: EpisodeRecord


@dataclass(frozen=True, slots=True)
class SimulationOutcome:
    """One arm of a pair: its log and passages, or the reason why it failed."""

    pair: int
    arm: Arm
    scenario: Scenario
    log: SimulationLog = field(default_factory=SimulationLog)
    passages: tuple[MeasuredPassage, ...] = ()
    trips: tuple[Trip, ...] = ()
    reason: str | None = None
    traceback: str | None = None


GetFolder = Callable[[int, Arm], AbstractContextManager[Path]]
"""The folder of an arm, where its configuration and its outputs lie while it runs."""


class SimulationRunner:
    """Runs pairs of one cell with ``[simulation]``, one after another.

    Args:
        scenario: the cell.
        model: the interaction model.
        get_folder: the folder of each arm.
        begin: starts the simulation of an arm from its configuration and its end.
        more: further options of SUMO.

    Raises:
        InputError: the configuration, a crosswalk, or an arm's strategy is refused.
    """

    def __init__(
        self,
        scenario: Scenario,
        model: InteractionModel,
        get_folder: GetFolder,
        begin: Callable[[Path, float | None], OwnSimulation] = OwnSimulation,
        more: Mapping[str, str] = NO_OPTIONS,
    ) -> None:
        self._scenario, self._model, self._get_folder = scenario, model, get_folder
        self._begin, self._more = begin, more
        self._setting = setting_of(scenario)
        check_arms(scenario, model)

    def run(
        self, pairs: Iterable[int], on_arm: Callable[[], None] = lambda: None
    ) -> Iterator[SimulationOutcome]:
        """Simulate both arms of every pair, the AV's first; ``on_arm`` is called after each arm."""
        for pair in pairs:
            for arm in Arm:
                yield self.run_arm(pair, arm)
                on_arm()

    def run_arm(self, pair: int, arm: Arm) -> SimulationOutcome:
        """Simulate one arm of a pair; if a strategy fails in one vehicle, the whole arm fails."""
        scenario, setting = self._scenario, self._setting
        simulation = scenario.known_simulation
        seed = sumo_seed(scenario, setting.config, pair)
        with self._get_folder(pair, arm) as folder:
            kept = Kept(folder, frozenset(simulation.outputs))
            added = write_people(folder, scenario, setting, pair)
            path = write_config(setting.config, kept, seed, simulation.step_s, added, self._more)
            running: OwnSimulation | None = None
            try:
                running = self._begin(path, setting.config.end_s)
                log = self._arm(running, pair, arm, seed).run()
                running.close()
                running = None
                trips = read_trips(folder / TRIPS_FILE, log.end_s)
            except EngineError as error:
                text = error.traceback if isinstance(error, StrategyError) else None
                return SimulationOutcome(pair, arm, scenario, reason=str(error), traceback=text)
            finally:
                if running is not None:
                    running.close()
        passages = measured(log, setting)
        return SimulationOutcome(pair, arm, scenario, log, tuple(passages), tuple(trips))

    def _arm(self, running: OwnSimulation, pair: int, arm: Arm, seed: int) -> SimulationArm:
        scenario, setting = self._scenario, self._setting
        simulation, ego = scenario.known_simulation, scenario.ego
        av_types, model = frozenset(simulation.av_types), self._model.of_pair(pair)

        def is_automated(name: str, type_id: str, vehicle_class: str) -> bool:
            alike = type_id in av_types or vehicle_class in av_types
            return alike and uniform_of(seed, name) < simulation.av_share

        def driver_of(automated: bool) -> Arm:
            return Arm.AV if automated and arm is Arm.AV else Arm.HUMAN

        def make(name: str, automated: bool) -> tuple[str, Strategy | None]:
            driver = driver_of(automated)
            strategy_name = scenario.arms.driver(driver)
            if strategy_name == SUMO_DRIVER:
                return strategy_name, None
            try:
                number = number_of(name)
                return strategy_name, make_strategy(scenario, driver, pair, model, number)
            except (Exception, SystemExit) as error:
                what = f"vehicle {name}: the strategy could not be made: {in_one_line(error)}"
                raise StrategyError(what, error) from None

        sensors = {driver: sensor_of(scenario, driver) for driver in Arm}

        def see(
            function: Function, people: Mapping[str, PeopleAtCrosswalk]
        ) -> SimulationSight | None:
            if not any(sensors.values()):
                return None
            return SimulationSight(
                lambda automated: sensors[driver_of(automated)], pair, function, people
            )

        return SimulationArm(
            running,
            setting,
            counted_s(scenario, setting),
            ego.detection_range_m or ego.trigger_range_m,
            ego.resume_acceleration_mps2,
            is_automated,
            make,
            lambda vehicle, automated: scenario.late(vehicle, driver_of(automated)),
            see,
        )


def counted_s(scenario: Scenario, setting: Setting) -> tuple[float, float]:
    """Begin and end of the counted time, in s; infinite if the simulation has no fixed end."""
    simulation, config = scenario.known_simulation, setting.config
    begin_s = config.begin_s if simulation.begin is None else simulation.begin
    end_s = config.end_s if simulation.end is None else simulation.end
    return begin_s, float("inf") if end_s is None else end_s


def measured(log: SimulationLog, setting: Setting) -> list[MeasuredPassage]:
    """The passages of an arm with their traces and records, by the time of R0."""
    motion: StepMotion = "ballistic" if setting.config.ballistic else "euler"
    with_states = [each for each in log.passages if len(each.x_m) > 1]
    traces = [
        replace(
            passage(
                VehicleTrack(np.array(each.time_s), np.array(each.x_m), np.array(each.speed_mps)),
                log.people[each.driven_way.way.crosswalk],
                each.driven_way.way,
                each.vehicle,
                motion=motion,
            ),
            fallback=each.fallback,
            sumo_collision=each.collided,
            shown=_shown(each, log),
        )
        for each in with_states
    ]
    return [*map(MeasuredPassage, with_states, traces, _records(traces))]


def _shown(passage: PassageLog, log: SimulationLog) -> tuple[Views, ...] | None:
    """What a passage's driver was shown, with the indices of the people in its trace."""
    if passage.shown is None:
        return None
    numbers = log.numbers[passage.driven_way.way.crosswalk]
    return tuple(
        tuple(view._replace(index=numbers[view.index]) for view in views) for views in passage.shown
    )


def _records(traces: Sequence[Trace]) -> list[EpisodeRecord]:
    """The record of every trace; traces that differ only in v0 and R0 are measured together."""
    groups = defaultdict(list)
    for number, trace in enumerate(traces):
        alike = replace(trace.vehicle, initial_speed_mps=1.0, trigger_range_m=1.0)
        # Steps, as differences of times, differ in their last bits.
        groups[alike, trace.crossing, trace.step_s].append(number)
    records: dict[int, EpisodeRecord] = {}
    for numbers in groups.values():
        records |= zip(numbers, measure([traces[number] for number in numbers]), strict=True)
    return [records[number] for number in range(len(traces))]
