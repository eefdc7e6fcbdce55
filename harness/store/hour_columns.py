"""The columns from which the reported numbers of hours of traffic are computed.

Means have Student's t intervals over hours.  Shares of passages and of people have the intervals of
Korn and Graubard, because those of one hour may be correlated.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from harness.core.encounter import FloatArray
from harness.episode.traffic.closed_forms import PEDESTRIAN_LOS_S, VEHICLE_LOS_S, level_of_service
from harness.episode.traffic.handbook import Handbook, handbook
from harness.episode.traffic.lanes import Direction, lanes_of
from harness.episode.traffic.saturation import Growth, growth_of
from harness.scenario import Scenario
from harness.statistics import (
    Interval,
    Proportion,
    clustered_proportion,
    student_mean,
    student_ratio,
)
from harness.store.summaries import check_pairs

Columns = Mapping[str, FloatArray]
"""The columns of ``hours`` of one arm, over the pairs in which neither arm failed."""


@dataclass(frozen=True)
class HourColumns:
    """The columns of both arms of a cell, AV's first, and what else their statistics need.

    A pair in which an arm failed counts in ``pairs`` and ``failed`` alone.
    """

    arms: tuple[Columns, Columns]
    pairs: int
    failed: int
    scenario: Scenario
    confidence: float

    def mean(self, name: str, arm: int) -> Interval:
        """The mean of a column whose values are ≥ 0."""
        return self._mean(self.arms[arm][name]).within(least=0.0)

    def difference(self, name: str) -> Interval:
        """The mean over hours of the AV's value minus the reference's."""
        av, human = self.arms
        return self._mean(av[name] - human[name])

    def time_ratio(self) -> Interval:
        """The sum of the travel times in the AV's arm over the sum in the reference's arm."""
        times = np.array([columns["travel_time_s"] for columns in self.arms])
        av, human = times[:, ~np.isnan(times).any(axis=0)]
        return student_ratio(av, human, self.confidence).within(least=0.0)

    def share(self, events: str, trials: str, arm: int) -> Proportion:
        """The share of events among trials; both are columns of counts."""
        columns = self.arms[arm]
        return clustered_proportion(columns[events], columns[trials], self.confidence)

    def share_difference(self, events: str, trials: str) -> Interval:
        """The difference of the shares, with Student's t interval of the hours' contributions.

        It has no interval if there was no event in either arm, because an event may still occur.
        """
        shares = [self.share(events, trials, arm).value for arm in (0, 1)]
        if None in shares:
            return Interval(None, None, None)
        av, human = (share or 0.0 for share in shares)
        difference = av - human
        # Over the mean of the trials, as the sum of the hours' parts is the share itself.
        parts = [
            (columns[events] - share * columns[trials]) / columns[trials].mean()
            for columns, share in zip(self.arms, (av, human), strict=True)
        ]
        reach = self._mean(parts[0] - parts[1]).half_width
        if reach is None or not (av or human):
            return Interval(difference, None, None)
        return Interval(difference, difference - reach, difference + reach).within(-1.0, 1.0)

    def total(self, name: str, arm: int) -> int:
        """The sum of a column of counts."""
        return int(self.arms[arm][name].sum())

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
        """The mean delay of vehicles due in the last third of an hour minus that of the first."""
        columns = self.arms[arm]
        return self._mean(columns["last_third_delay_s"] - columns["first_third_delay_s"])

    def queue_m(self, arm: int) -> Interval:
        """The 95 % quantile of the queue in metres: vehicles with the gaps between them."""
        spacing_m = self.scenario.ego.length_m + self.scenario.known_traffic.min_gap_m
        return scaled(self.mean("queue_p95", arm), spacing_m)

    def queue_difference_m(self) -> Interval:
        """The difference of the queues in metres."""
        spacing_m = self.scenario.ego.length_m + self.scenario.known_traffic.min_gap_m
        return scaled(self.difference("queue_p95"), spacing_m)

    def handbook(self, arm: int) -> Handbook:
        """The delay of pedestrians in an arm by the handbooks."""
        traffic, columns = self.scenario.known_traffic, self.arms[arm]
        seconds = traffic.duration_s * max(1, len(columns["vehicles"]))
        walked = columns["walking_mps"][~np.isnan(columns["walking_mps"])]
        return handbook(
            self.scenario,
            0.0 if arm else traffic.av_share,
            float(columns["vehicles"].sum()) / seconds,
            float(columns["pedestrians"].sum()) / seconds,
            float(walked.mean()) if len(walked) else None,
        )

    def los_vehicles(self, arm: int) -> str | None:
        """The level by the control delay; F if the road is saturated (HCM: above capacity).

        A vehicle that has not passed has no control delay, but at least ``vehicle_delay_s``.
        """
        if self.saturated(arm):
            return "F"
        means = [self.mean(name, arm).value for name in ("control_delay_s", "vehicle_delay_s")]
        delays = [delay for delay in means if delay is not None]
        return level_of_service(max(delays), VEHICLE_LOS_S) if delays else None

    def los_pedestrians(self, arm: int) -> str | None:
        """The level by the mean wait at the kerb."""
        delay_s = self.mean("pedestrian_delay_s", arm).value
        return None if delay_s is None else level_of_service(delay_s, PEDESTRIAN_LOS_S)

    def _mean(self, values: FloatArray) -> Interval:
        return student_mean(values[~np.isnan(values)], self.confidence)


def hour_columns(hours: pa.Table, scenario: Scenario, confidence: float) -> HourColumns:
    """The columns of a cell, from its rows of ``hours`` by pair, AV first.

    Raises:
        InputError: the rows do not have both arms of each pair.
    """
    check_pairs(hours, "hours")
    ran = np.array([reason is None for reason in hours["reason"].to_pylist()], dtype=bool)
    both = ran[::2] & ran[1::2]
    columns = {
        name: hours[name].cast(pa.float64()).to_numpy(zero_copy_only=False)
        for name in hours.column_names
        if pa.types.is_floating(hours.schema.field(name).type)
        or pa.types.is_integer(hours.schema.field(name).type)
    }
    av, human = (
        {name: column[place::2][both] for name, column in columns.items()} for place in (0, 1)
    )
    return HourColumns((av, human), len(both), int((~both).sum()), scenario, confidence)


def scaled(interval: Interval, factor: float) -> Interval:
    """An interval times a number above 0."""
    ends = (interval.value, interval.low, interval.high)
    return Interval(*(None if end is None else factor * end for end in ends))
