"""The columns from which the reported numbers of hours of traffic are computed."""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from harness.episode.traffic.closed_forms import PEDESTRIAN_LOS_S, VEHICLE_LOS_S, level_of_service
from harness.episode.traffic.handbook import Handbook, handbook
from harness.episode.traffic.lanes import Direction, lanes_of
from harness.episode.traffic.saturation import Growth, growth_of
from harness.scenario import Scenario
from harness.statistics import Interval
from harness.store.arm_columns import ArmColumns, arm_columns, scaled


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

    def handbook(self, arm: int) -> Handbook:
        """The delay of pedestrians in an arm by the handbooks."""
        traffic, columns = self.scenario.known_traffic, self.arms[arm]
        seconds = traffic.duration_s * max(1, len(columns["vehicles"]))
        walked = columns["walking_mps"][~np.isnan(columns["walking_mps"])]
        return handbook(
            self.scenario,
            0.0 if arm else traffic.share_of_avs,
            float(columns["vehicles"].sum()) / seconds,
            float(columns["pedestrians"].sum()) / seconds,
            float(walked.mean()) if len(walked) else None,
        )

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
