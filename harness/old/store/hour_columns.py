"""The columns from which the reported numbers of hours of traffic are computed."""

from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa

from harness.encounter.traffic.lanes import Direction, lanes_of
from harness.encounter.traffic.saturation import Growth, growth_of
from harness.old.statistics import Interval
from harness.old.store.arm_columns import ArmColumns, arm_columns, scaled
from harness.scenario import Scenario

PEDESTRIAN_LOS_S = (5.0, 10.0, 20.0, 30.0, 45.0)
"""Longest mean delays of pedestrians for the levels A to E (HCM 2010, exhibit 19-2)."""

VEHICLE_LOS_S = (10.0, 15.0, 25.0, 35.0, 50.0)
"""Longest mean control delays of vehicles for the levels A to E at an unsignalized place (HCM 2010,
exhibit 19-1)."""


@dataclass(frozen=True)
class HourColumns(ArmColumns):
    """The columns of both arms of a cell and the other inputs of the statistics of hours."""

    scenario: Scenario

    def unreached(self, arm: int) -> int:
        """Vehicles that neither reached the crosswalk's near edge nor crashed."""
        return self.total("vehicles", arm) - self.total("reached", arm)

    def growth(self, arm: int) -> Growth:
        """The growth of the number of late vehicles; undefined with a permanent queue."""
        traffic, columns = self.scenario.known_traffic, self.arms[arm]
        if traffic.saturated:
            return Growth(None, None)
        growths = columns["late_second_half"] - columns["late_first_half"]
        lanes = [
            lane
            for lane in lanes_of(self.scenario)
            if traffic.has_vehicles(oncoming=lane.direction is Direction.ONCOMING)
        ]
        return growth_of(growths, columns["due_through"] / 2, len(lanes))

    def saturated(self, arm: int) -> bool:
        """Whether more vehicles arrived than passed."""
        return self.scenario.known_traffic.saturated or self.growth(arm).saturated

    def rise_s(self, arm: int) -> Interval:
        """The mean delay of vehicles due in the last third of an hour minus the first third's."""
        columns = self.arms[arm]
        return self.mean_of(columns["last_third_delay_s"] - columns["first_third_delay_s"])

    def queue_m(self, arm: int) -> Interval:
        """The 95 % quantile of the queue in metres: vehicles and the gaps between them."""
        if self.scenario.known_traffic.types:
            return self.mean("queue_p95_m", arm)
        return scaled(self.mean("queue_p95", arm), self._spacing_m)

    def queue_difference_m(self) -> Interval:
        """The difference of the queues in metres."""
        if self.scenario.known_traffic.types:
            return self.difference("queue_p95_m")
        return scaled(self.difference("queue_p95"), self._spacing_m)

    @property
    def _spacing_m(self) -> float:
        """Distance between the fronts of two queued vehicles without a vehicle mix."""
        return self.scenario.ego.length_m + self.scenario.known_traffic.min_gap_m

    def los_vehicles(self, arm: int) -> str | None:
        """The level of service by control delay; F if the road is saturated (HCM: above capacity).

        The control delay omits vehicles that have not passed, so the larger of it and the mean of
        ``vehicle_delay_s`` is used.
        """
        if self.saturated(arm):
            return "F"
        means = [self.mean(name, arm).value for name in ("control_delay_s", "vehicle_delay_s")]
        delays = [delay for delay in means if delay is not None]
        return level_of_service(max(delays), VEHICLE_LOS_S) if delays else None

    def los_pedestrians(self, arm: int) -> str | None:
        """The level of service by the mean wait at the kerb."""
        delay_s = self.mean("pedestrian_delay_s", arm).value
        return None if delay_s is None else level_of_service(delay_s, PEDESTRIAN_LOS_S)


def hour_columns(hours: pa.Table, scenario: Scenario, confidence: float) -> HourColumns:
    """The columns of a cell, from its rows of ``hours`` by pair, AV first.

    Raises:
        InputError: the rows do not have both arms of each pair.
    """
    columns = arm_columns(hours, "hours", confidence)
    return HourColumns(columns.arms, columns.pairs, columns.failed, confidence, scenario)


def level_of_service(delay_s: float, longest_s: Sequence[float]) -> str:
    """The level A to F of a mean delay.

    Args:
        delay_s: mean delay of pedestrians or vehicles.
        longest_s: ``PEDESTRIAN_LOS_S`` or ``VEHICLE_LOS_S``.

    >>> level_of_service(12.0, PEDESTRIAN_LOS_S), level_of_service(12.0, VEHICLE_LOS_S)
    ('C', 'B')
    """
    return "ABCDEF"[sum(delay_s > limit for limit in longest_s)]
