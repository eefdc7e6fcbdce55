"""From the hours of a cell to its summary, paired over hours.

Means have Student's t intervals over hours.  Shares of passages have Korn and Graubard's: passages
of one hour may go together.
"""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from harness.comparison import Interval, Proportion, clustered_proportion, student_mean
from harness.encounter import Arm, FloatArray
from harness.results.summaries import check_pairs
from harness.scenario import Scenario
from harness.strategies.registry import find_strategy
from harness.traffic.closed_forms import (
    PEDESTRIAN_LOS_S,
    VEHICLE_LOS_S,
    critical_headway_s,
    fleet_yield_rate,
    group_headway_s,
    hcm_delay_s,
    level_of_service,
    revised_hcm_delay_s,
)
from harness.traffic.demand import second_half_share
from harness.traffic.lanes import lanes_of

GROWTH = 0.05
"""A road is saturated where the vehicles on it grow in the second half by more than this share of
the half's arrivals."""

Columns = dict[str, FloatArray]


@dataclass(frozen=True, slots=True)
class HourMeasure:
    """A number of an hour: its column, its unit, and how it follows from ``hours``.

    ``events`` is the column that a number per 1,000 passages counts.
    """

    name: str
    unit: str
    of: Callable[[Columns], FloatArray]
    events: str | None = None


def _column(name: str) -> Callable[[Columns], FloatArray]:
    return lambda columns: columns[name]


def _per_1000(events: str) -> HourMeasure:
    def of(columns: Columns) -> FloatArray:
        return _ratio(1000 * columns[events], columns["crossed"])

    return HourMeasure(f"{events}_per_1000", "", of, events)


HOUR_MEASURES = (
    HourMeasure("vehicle_delay_s", "s", _column("vehicle_delay_s")),
    HourMeasure("control_delay_s", "s", _column("control_delay_s")),
    HourMeasure("pedestrian_delay_s", "s", _column("pedestrian_delay_s")),
    HourMeasure("person_delay_h", "h", _column("person_delay_h")),
    HourMeasure("throughput_per_hour", "1/h", _column("throughput_per_hour")),
    HourMeasure("queue_mean", "", _column("queue_mean")),
    HourMeasure("queue_p95", "", _column("queue_p95")),
    HourMeasure("queue_longest", "", _column("queue_longest")),
    HourMeasure("stops_per_vehicle", "", _column("stops_per_vehicle")),
    HourMeasure("first_let_go", "", lambda own: _ratio(own["let_go"], own["had_to_wait"])),
    _per_1000("crashes"),
    _per_1000("conflicts_ttc"),
    _per_1000("conflicts_time_advantage"),
    _per_1000("conflicts_pet"),
    _per_1000("conflicts_drac"),
)


@dataclass(frozen=True, slots=True)
class ArmOfHours:
    """The results of one arm beside its measures.

    ``growth`` is the mean over pairs of the vehicles that the road gained in the second half, over
    the arrivals expected in that half.  The arm is ``saturated`` where that is more than
    ``GROWTH``.  The level of service of vehicles is that of their control delay, and F on a
    saturated road (HCM: more than its capacity).  ``yield_rate`` is the drivers' parameter where
    they have one, else the share of pedestrians whom the first vehicle let go.
    """

    not_through: int
    never_went: int
    growth: float | None
    saturated: bool
    kappa: Proportion
    yield_rate: float | None
    hcm_pedestrian_delay_s: float | None
    nchrp_pedestrian_delay_s: float | None
    los_vehicles: str | None
    los_pedestrians: str | None


@dataclass(frozen=True, slots=True)
class HoursSummary:
    """A cell: means of each measure in both arms and of their paired difference, AV − human."""

    pairs: int
    failed: int
    confidence: float
    mu: Interval
    measures: dict[str, tuple[Interval, Interval, Interval]]
    arms: dict[Arm, ArmOfHours]


def summarise_hours(hours: pa.Table, scenario: Scenario, confidence: float) -> HoursSummary:
    """The summary of a cell, from its rows of ``hours`` by pair, AV first.

    A pair in which an arm failed counts nowhere but in ``failed``.

    Raises:
        InputError: the rows are not two arms of each pair.
    """
    av, human, failed = _arms(hours)
    measures = {measure.name: _of_arms(measure, av, human, confidence) for measure in HOUR_MEASURES}
    arms = {
        arm: _arm(
            own,
            scenario,
            arm,
            {name: found[place] for name, found in measures.items()},
            confidence,
        )
        for place, (arm, own) in enumerate(((Arm.AV, av), (Arm.HUMAN, human)))
    }
    travel = _ratio(av["travel_time_s"], human["travel_time_s"])
    return HoursSummary(
        pairs=hours.num_rows // 2,
        failed=failed,
        confidence=confidence,
        mu=student_mean(travel[~np.isnan(travel)], confidence),
        measures=measures,
        arms=arms,
    )


_OF_AN_ARM = (
    *("not_through", "never_went", "growth", "yield_rate"),
    *("hcm_pedestrian_delay_s", "nchrp_pedestrian_delay_s", "los_vehicles", "los_pedestrians"),
)
"""Columns that ``summary.csv`` has for each arm beside its measures and κ."""


def hours_row(summary: HoursSummary) -> dict[str, float | int | str | bool | None]:
    """A summary as the columns of ``summary.csv``; an interval becomes three."""
    row: dict[str, float | int | str | bool | None] = {
        "pairs": summary.pairs,
        "failed": summary.failed,
        "confidence": summary.confidence,
    }
    ends = {Arm.AV: "", Arm.HUMAN: "_human"}
    for arm, end in ends.items():
        row[f"saturated{end}"] = summary.arms[arm].saturated
    row |= summary.mu.columns("mu")
    for arm, end in ends.items():
        row |= summary.arms[arm].kappa.columns(f"kappa{end}")
    for name, found in summary.measures.items():
        for interval, end in zip(found, ("", "_human", "_difference"), strict=True):
            row |= interval.columns(f"{name}{end}")
    for arm, end in ends.items():
        for name in _OF_AN_ARM:
            row[f"{name}{end}"] = getattr(summary.arms[arm], name)
    return row


def _arms(hours: pa.Table) -> tuple[Columns, Columns, int]:
    """The columns of both arms over the pairs in which neither failed, and how many others."""
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
    return av, human, int((~both).sum())


def _arm(
    own: Columns, scenario: Scenario, arm: Arm, means: dict[str, Interval], confidence: float
) -> ArmOfHours:
    traffic = scenario.known_traffic
    arrivals = second_half_share(traffic) * own["vehicles"]
    growths = _ratio(own["in_system_end"] - own["in_system_half"], arrivals)
    known = growths[~np.isnan(growths)]
    growth = float(known.mean()) if len(known) and not traffic.saturated else None
    saturated = traffic.saturated or (growth is not None and growth > GROWTH)
    people = means["pedestrian_delay_s"].value
    rate = _yield_rate(scenario, arm)
    if rate is None:
        rate = means["first_let_go"].value
    forms = _closed_forms(own, scenario, rate)
    return ArmOfHours(
        not_through=int(own["not_through"].sum()),
        never_went=int(own["never_went"].sum()),
        growth=growth,
        saturated=saturated,
        kappa=clustered_proportion(own["crashes"], own["crossed"], confidence),
        yield_rate=rate,
        hcm_pedestrian_delay_s=forms and forms[0],
        nchrp_pedestrian_delay_s=forms and forms[1],
        los_vehicles="F" if saturated else _level_of_vehicles(means),
        los_pedestrians=None if people is None else level_of_service(people, PEDESTRIAN_LOS_S),
    )


def _level_of_vehicles(means: dict[str, Interval]) -> str | None:
    """By the control delay; a vehicle that is not through has at least ``vehicle_delay_s``."""
    delays = [means[name].value for name in ("control_delay_s", "vehicle_delay_s")]
    known = [delay for delay in delays if delay is not None]
    return level_of_service(max(known), VEHICLE_LOS_S) if known else None


def _of_arms(
    measure: HourMeasure, av: Columns, human: Columns, confidence: float
) -> tuple[Interval, Interval, Interval]:
    """A measure's mean in both arms, and that of their difference hour by hour.

    Hours without an event do not spread, and Student's t would make 0 … 0 of them.  But an event
    that was never seen may yet occur: an arm has the bound of its share then, and two such arms no
    interval of their difference.
    """

    def mean(values: FloatArray) -> Interval:
        return student_mean(values[~np.isnan(values)], confidence)

    def of_arm(own: Columns) -> Interval:
        if measure.events is None or own[measure.events].any():
            return mean(measure.of(own))
        share = clustered_proportion(own[measure.events], own["crossed"], confidence)
        return Interval(share.value, share.low, share.high and 1000 * share.high)

    difference = mean(measure.of(av) - measure.of(human))
    if measure.events and not (av[measure.events].any() or human[measure.events].any()):
        difference = Interval(difference.value, None, None)
    return of_arm(av), of_arm(human), difference


def _yield_rate(scenario: Scenario, arm: Arm) -> float | None:
    """The rate at which an arm's drivers yield by themselves; None where a strategy has none."""
    traffic = scenario.known_traffic
    human = _own_rate(scenario, scenario.arms.human)
    if arm is Arm.HUMAN:
        return human
    av = _own_rate(scenario, scenario.arms.av)
    if av is None or (human is None and traffic.av_share < 1):
        return None
    return fleet_yield_rate(traffic.av_share, av, human or 0.0)


def _own_rate(scenario: Scenario, name: str) -> float | None:
    given: Any = scenario.strategies.get(name, {}).get("yield_rate")
    if given is None:
        parameter = inspect.signature(find_strategy(name, "arms")).parameters.get("yield_rate")
        given = None if parameter is None else parameter.default
    return None if given is None else float(given)


def _closed_forms(
    own: Columns, scenario: Scenario, yield_rate: float | None
) -> tuple[float, float] | None:
    """The HCM's and NCHRP 17-87's delay of pedestrians at this road: t_c = L/S_p, t_s = 0.

    S_p is the speed at which its pedestrians walked, v the flow of vehicles that came.
    """
    traffic, crossing = scenario.known_traffic, scenario.crosswalk()
    speeds = own["walking_mps"][~np.isnan(own["walking_mps"])]
    seconds = traffic.duration_s * max(1, len(own["vehicles"]))
    vehicles = float(own["vehicles"].sum()) / seconds
    if yield_rate is None or not len(speeds) or vehicles == 0 or traffic.saturated:
        return None
    people = float(own["pedestrians"].sum()) / seconds
    headway_s = critical_headway_s(crossing.length_m, float(speeds.mean()), 0.0)
    group_s = group_headway_s(vehicles, people, headway_s, crossing.width_m)
    lanes = len(lanes_of(scenario))
    found = (
        hcm_delay_s(vehicles, group_s, lanes, yield_rate),
        revised_hcm_delay_s(vehicles, group_s, lanes, yield_rate),
    )
    return found if all(np.isfinite(found)) else None


def _ratio(part: FloatArray, whole: FloatArray) -> FloatArray:
    """A quotient, NaN where the whole is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        quotient: FloatArray = np.where(whole == 0, np.nan, part / whole)
    return quotient
