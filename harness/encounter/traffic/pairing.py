"""The simulation of pairs of hours of a cell: both arms have the same pedestrians and vehicles."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from harness.core.encounter import Arm, Strategy
from harness.core.errors import EngineError, StrategyError, in_one_line
from harness.core.seeding import Purpose
from harness.encounter.arms import check_arms, draws_from, make_strategy
from harness.encounter.arrivals import planned_arrivals
from harness.encounter.cell_constants import constants_of
from harness.encounter.traffic.demand import Scheduled, scheduled_vehicles
from harness.encounter.traffic.hour import Hour
from harness.encounter.traffic.lanes import lanes_of
from harness.encounter.traffic.passages import Passage, passages_of
from harness.encounter.traffic.vehicles import HourLog, LaneOnRoad, clearing_s
from harness.encounter.walking_speeds import WalkingSpeeds
from harness.engine.road import SumoRoad
from harness.model.interaction import InteractionModel
from harness.scenario import Scenario
from harness.strategies.perception.sensor import sensor_of


@dataclass(frozen=True, slots=True)
class HourOutcome:
    """One arm of a pair: its log and passages, or the reason why it failed."""

    pair: int
    arm: Arm
    scenario: Scenario
    log: HourLog
    passages: tuple[Passage, ...]
    reason: str | None = None
    traceback: str | None = None


ArmKey = tuple[Arm, tuple[str, ...], Purpose, int]
"""Identifies an arm: its drivers, their random stream, and its pair."""


class HourRunner:
    """Runs pairs of one cell with ``[traffic]``, one after another.

    Args:
        scenario: the cell.
        model: the interaction model.
        get_road: returns an open road for this scenario; called for each arm.
        paths: whether to record vehicles' positions outside of their passages.

    Raises:
        InputError: a strategy is unknown, or its parameters are refused.
    """

    def __init__(
        self,
        scenario: Scenario,
        model: InteractionModel,
        get_road: Callable[[], SumoRoad],
        paths: bool = False,
    ) -> None:
        self._scenario, self._model, self._get_road = scenario, model, get_road
        self._traffic, self._paths = scenario.known_traffic, paths
        self._rules = constants_of(scenario)
        self._sensors = {driver: sensor_of(scenario, driver) for driver in Arm}
        check_arms(scenario, model)

    def run(
        self,
        pairs: Iterable[int],
        on_arm: Callable[[], None] = lambda: None,
        known: Mapping[ArmKey, HourOutcome] = MappingProxyType({}),
    ) -> Iterator[HourOutcome]:
        """Simulate both arms of every pair, the AV's first.

        Args:
            pairs: indices of the pairs.
            on_arm: called after each simulated arm.
            known: arms of a cell that differs from this one only in its reference; shared arms are
                not simulated again.
        """
        for pair in pairs:
            for arm in Arm:
                if (outcome := known.get(self.key(arm, pair))) is not None:
                    yield replace(outcome, scenario=self._scenario)
                    continue
                yield self.run_arm(pair, arm)
                on_arm()

    def key(self, arm: Arm, pair: int) -> ArmKey:
        """The key that identifies an arm among cells that differ only in their arms."""
        arms = self._scenario.arms
        alone = arm is Arm.AV and self._scenario.av_drives_alone
        drivers = (arms.av,) if alone else (arms.av, arms.human)
        return arm, drivers, draws_from(self._scenario, arm), pair

    def run_arm(self, pair: int, arm: Arm) -> HourOutcome:
        """Simulate one arm of a pair.

        If a strategy fails in one vehicle, the whole arm fails.  Otherwise that vehicle would block
        the lane for the rest of the hour, and the results would not describe the strategy.
        """
        scenario, traffic, rules = self._scenario, self._traffic, self._rules
        model = self._model.of_pair(pair)
        horizon_s = traffic.warm_up_s + traffic.duration_s + clearing_s(traffic)
        begin_s = traffic.warm_up_s
        arrivals = planned_arrivals(scenario, pair, horizon_s=horizon_s, begin_s=begin_s)
        road = self._get_road()
        lanes = [
            LaneOnRoad(number, lane, scheduled_vehicles(scenario, pair, lane), rules)
            for number, lane in enumerate(lanes_of(scenario))
        ]

        def make(planned: Scheduled) -> tuple[bool, str, Strategy]:
            automated = arm is Arm.AV and planned.uniform < traffic.av_share
            driver = Arm.AV if automated else Arm.HUMAN
            try:
                strategy = make_strategy(scenario, driver, pair, model, planned.number)
                return automated, scenario.arms.driver(driver), strategy
            except (Exception, SystemExit) as error:
                what = f"the strategy could not be made: {in_one_line(error)}"
                raise StrategyError(what, error) from None

        hour = Hour(
            road,
            lanes,
            arrivals,
            WalkingSpeeds(scenario, model),
            make,
            rules,
            traffic,
            sensors=self._sensors,
            pair=pair,
            paths=self._paths,
        )
        try:
            log = hour.run()
        except EngineError as error:
            # The next hour needs a new simulation.
            road.close()
            text = error.traceback if isinstance(error, StrategyError) else None
            return HourOutcome(pair, arm, scenario, HourLog(), (), str(error), text)
        ends = {number: lane.ends_x_m for number, lane in enumerate(road.lanes)}
        passages = passages_of(log, rules, ends, traffic.saturated)
        return HourOutcome(pair, arm, scenario, log, tuple(passages))
