"""From the hours of a cell to its summary, paired over hours.

Means have Student's t intervals over hours.  Shares of passages and of people have Korn and
Graubard's: those of one hour may go together.
"""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from harness.comparison import (
    Interval,
    Proportion,
    clustered_proportion,
    student_mean,
    student_ratio,
)
from harness.encounter import Arm
from harness.results.hour_measures import HOUR_MEASURES, Columns, known, of_both_arms
from harness.results.summaries import check_pairs
from harness.scenario import Scenario
from harness.traffic.closed_forms import PEDESTRIAN_LOS_S, VEHICLE_LOS_S, level_of_service
from harness.traffic.handbook import Handbook, handbook
from harness.traffic.lanes import Direction, lanes_of
from harness.traffic.saturation import Growth, growth_of


@dataclass(frozen=True, slots=True)
class ArmOfHours:
    """The results of one arm beside its measures.

    ``growth`` is undefined with a permanent queue, which is ``saturated`` by itself.  ``rising_s``
    is the mean delay of vehicles due in the last third of an hour less that of the first.
    ``kappa``: crashes over vehicles whose front reached the crosswalk's near edge or that crashed;
    ``unreached`` vehicles are the others, ``conflicts_unreached`` those of them with a conflict.
    ``fallback``: passages that met somebody and were driven by the fallback of the arm's strategy.
    The level of service of vehicles is that of their control delay, and F on a saturated road (HCM:
    more than its capacity).
    """

    not_through: int
    never_went: int
    unreached: int
    conflicts_unreached: int
    growth: Growth
    saturated: bool
    rising_s: Interval
    kappa: Proportion
    fallback: Proportion
    handbook: Handbook
    los_vehicles: str | None
    los_pedestrians: str | None

    @property
    def still_rises(self) -> bool:
        """Whether the delay still grows in the counted time, beyond chance."""
        return self.rising_s.low is not None and self.rising_s.low > 0


@dataclass(frozen=True, slots=True)
class HoursSummary:
    """A cell: means of each measure in both arms and of their paired difference, AV − human.

    ``time_ratio`` is the sum of the travel times of the AV's arm over that of the reference's.
    """

    pairs: int
    failed: int
    confidence: float
    time_ratio: Interval
    measures: dict[str, tuple[Interval, Interval, Interval]]
    arms: dict[Arm, ArmOfHours]


def summarise_hours(hours: pa.Table, scenario: Scenario, confidence: float) -> HoursSummary:
    """The summary of a cell, from its rows of ``hours`` by pair, AV first.

    A pair in which an arm failed counts nowhere but in ``failed``.

    Raises:
        InputError: the rows are not two arms of each pair.
    """
    av, human, failed = _arms(hours)
    measures = {of.name: of_both_arms(of, av, human, confidence) for of in HOUR_MEASURES}
    arms = {}
    for place, (arm, own) in enumerate(((Arm.AV, av), (Arm.HUMAN, human))):
        means = {name: found[place] for name, found in measures.items()}
        arms[arm] = _arm(own, scenario, arm, means, confidence)
    times = np.array([av["travel_time_s"], human["travel_time_s"]])
    times = times[:, ~np.isnan(times).any(axis=0)]
    return HoursSummary(
        pairs=hours.num_rows // 2,
        failed=failed,
        confidence=confidence,
        time_ratio=student_ratio(times[0], times[1], confidence).within(least=0.0),
        measures=measures,
        arms=arms,
    )


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
    row |= summary.time_ratio.columns("time_ratio")
    for arm, end in ends.items():
        row |= summary.arms[arm].kappa.columns(f"kappa{end}")
    for name, found in summary.measures.items():
        for interval, end in zip(found, ("", "_human", "_difference"), strict=True):
            row |= interval.columns(f"{name}{end}")
    for arm, end in ends.items():
        own = summary.arms[arm]
        for name in ("not_through", "never_went", "unreached", "conflicts_unreached"):
            row[f"{name}{end}"] = getattr(own, name)
        row[f"growth{end}"], row[f"growth_bound{end}"] = own.growth.share, own.growth.bound
        row |= own.rising_s.columns(f"rising_s{end}")
        row |= own.fallback.columns(f"fallback_share{end}")
        row[f"yield_rate{end}"] = own.handbook.yield_rate
        row[f"hcm_pedestrian_delay_s{end}"] = own.handbook.hcm_s
        row[f"nchrp_pedestrian_delay_s{end}"] = own.handbook.nchrp_s
        row[f"no_handbook{end}"] = own.handbook.reason
        row[f"los_vehicles{end}"], row[f"los_pedestrians{end}"] = (
            own.los_vehicles,
            own.los_pedestrians,
        )
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
    lanes = [
        lane
        for lane in lanes_of(scenario)
        if traffic.has_vehicles(oncoming=lane.direction is Direction.ONCOMING)
    ]
    growth = Growth(None, None)
    if not traffic.saturated:
        growths = own["late_second_half"] - own["late_first_half"]
        growth = growth_of(growths, own["due_through"] / 2, len(lanes))
    saturated = traffic.saturated or growth.saturated
    seconds = traffic.duration_s * max(1, len(own["vehicles"]))
    walked = known(own["walking_mps"])
    people = means["pedestrian_delay_s"].value
    return ArmOfHours(
        not_through=int(own["not_through"].sum()),
        never_went=int(own["never_went"].sum()),
        unreached=int((own["vehicles"] - own["reached"]).sum()),
        conflicts_unreached=int(own["conflicts_unreached"].sum()),
        growth=growth,
        saturated=saturated,
        rising_s=student_mean(
            known(own["last_third_delay_s"] - own["first_third_delay_s"]), confidence
        ),
        kappa=clustered_proportion(own["crashes"], own["reached"], confidence),
        fallback=clustered_proportion(own["fallbacks"], own["met"], confidence),
        handbook=handbook(
            scenario,
            traffic.av_share if arm is Arm.AV else 0.0,
            float(own["vehicles"].sum()) / seconds,
            float(own["pedestrians"].sum()) / seconds,
            float(walked.mean()) if len(walked) else None,
        ),
        los_vehicles="F" if saturated else _level_of_vehicles(means),
        los_pedestrians=None if people is None else level_of_service(people, PEDESTRIAN_LOS_S),
    )


def _level_of_vehicles(means: dict[str, Interval]) -> str | None:
    """By the control delay; a vehicle that is not through has at least ``vehicle_delay_s``."""
    delays = [means[name].value for name in ("control_delay_s", "vehicle_delay_s")]
    defined = [delay for delay in delays if delay is not None]
    return level_of_service(max(defined), VEHICLE_LOS_S) if defined else None
