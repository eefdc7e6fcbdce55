"""Every number that a run of hours of traffic reports, each defined once."""

from harness.old.statistics import CONFLICTS, Entry, Form, Interval, Proportion
from harness.old.store.arm_columns import scaled
from harness.old.store.hour_columns import HourColumns

_NO_VEHICLE = "there is no counted vehicle, or the queue is permanent"
_NO_KIND = "there is no counted vehicle of this kind, or the queue is permanent"
_NOBODY = "nobody arrived"
_NOBODY_MET = "no passage met anyone"
_NOT_REACHED = "no vehicle reached the crosswalk"


def _mean(
    key: str,
    heading: str,
    meaning: str,
    unit: str = "",
    undefined: str = _NO_VEHICLE,
    *,
    first_screen: bool = False,
    digits: int = 2,
) -> Entry[HourColumns]:
    """The mean over hours of the column ``key``, and its difference hour by hour."""
    return Entry(
        key,
        heading,
        meaning,
        unit=unit,
        digits=1 if unit == "s" else digits,
        of_arm=lambda c, arm: c.mean(key, arm),
        paired=lambda c: c.difference(key),
        interval=Interval,
        undefined=undefined,
        first_screen=first_screen,
    )


def _per_1000(
    events: str, heading: str, meaning: str, first_screen: bool = False
) -> Entry[HourColumns]:
    """Events per 1,000 vehicles that reached the crosswalk."""
    return Entry(
        f"{events}_per_1000",
        f"{heading} per 1,000",
        f"{meaning} per 1,000 vehicles that reached the crosswalk or crashed before it.",
        of_arm=lambda c, arm: scaled(c.share(events, "reached", arm), 1_000.0),
        paired=lambda c: scaled(c.share_difference(events, "reached"), 1_000.0),
        interval=Interval,
        undefined=_NOT_REACHED,
        first_screen=first_screen,
    )


def _total(key: str, heading: str, meaning: str) -> Entry[HourColumns]:
    """The sum of the column ``key``."""
    return Entry(key, heading, meaning, form=Form.COUNT, of_arm=lambda c, arm: c.total(key, arm))


HOURS: tuple[Entry[HourColumns], ...] = (
    _mean(
        "automated_delay_s",
        "delay of AVs",
        "Mean delay of the vehicles that `arms.av` drives. In the reference's arm it is the mean "
        "delay of the same vehicles.",
        "s",
        _NO_KIND,
        first_screen=True,
    ),
    _mean(
        "other_delay_s",
        "delay of other vehicles",
        "Mean delay of all other vehicles.",
        "s",
        _NO_KIND,
        first_screen=True,
    ),
    _mean(
        "throughput_per_hour",
        "throughput",
        "Number of vehicles that passed the crosswalk, per hour.",
        "1/h",
        first_screen=True,
        digits=0,
    ),
    _mean(
        "pedestrian_delay_s",
        "people's wait",
        "Mean wait at the kerb.",
        "s",
        _NOBODY,
        first_screen=True,
    ),
    Entry(
        "queue_p95_m",
        "queue, 95 %",
        "`queue_p95` in metres: each vehicle counts with its length and `traffic.min_gap_m`.",
        unit="m",
        digits=1,
        of_arm=lambda c, arm: c.queue_m(arm),
        paired=lambda c: c.queue_difference_m(),
        interval=Interval,
        undefined=_NO_VEHICLE,
        first_screen=True,
    ),
    Entry(
        "los_vehicles",
        "level of service, vehicles",
        "Level of service of vehicles (HCM), by their control delay; F if the road is saturated.",
        form=Form.WORD,
        of_arm=lambda c, arm: c.los_vehicles(arm),
        undefined=_NO_VEHICLE,
        first_screen=True,
    ),
    Entry(
        "los_pedestrians",
        "level of service, people",
        "Level of service of pedestrians (HCM), by their mean wait.",
        form=Form.WORD,
        of_arm=lambda c, arm: c.los_pedestrians(arm),
        undefined=_NOBODY,
    ),
    _per_1000("crashes", "crashes", "Crashes"),
    Entry(
        "kappa",
        "crashes",
        "κ, the number of crashes over the number of vehicles that reached the crosswalk or "
        "crashed before it.",
        form=Form.EVENTS,
        digits=1,
        of_arm=lambda c, arm: c.share("crashes", "reached", arm),
        interval=Proportion,
        undefined=_NOT_REACHED,
        first_screen=True,
        crashes=True,
    ),
    Entry(
        "time_ratio",
        "ratio of travel times",
        "Sum of the travel times in the AV's arm over the sum in the reference's arm.",
        digits=3,
        paired=lambda c: c.time_ratio(),
        interval=Interval,
        undefined=_NO_VEHICLE,
    ),
    _mean("vehicle_delay_s", "delay of all vehicles", "Mean delay of all vehicles.", "s"),
    _mean(
        "control_delay_s",
        "delay to the road's end",
        "Mean delay up to the point at which vehicles leave the road.",
        "s",
    ),
    _mean(
        "person_delay_h",
        "delay of all persons",
        "Delay of all persons: `traffic.occupancy` × the vehicles' delays plus the pedestrians' "
        "waits.",
        "h",
    ),
    _mean(
        "queue_mean",
        "queue, mean",
        "Number of queued vehicles in a lane, mean over seconds and lanes.",
    ),
    _mean(
        "queue_p95",
        "queue, 95 %, in vehicles",
        "Number of queued vehicles in a lane, 95 % quantile over seconds and lanes.",
    ),
    _mean("queue_longest", "queue, longest, in vehicles", "Longest queue in a lane."),
    _mean(
        "stops_per_vehicle", "stops per vehicle", "Number of stops per vehicle, from its entry on."
    ),
    Entry(
        "first_driver_yield_share",
        "people for whom the first driver yielded",
        "Share of the people who had to wait whose first driver yielded: they went before the "
        "vehicle that first kept them waiting.",
        form=Form.SHARE,
        of_arm=lambda c, arm: c.share("let_go", "had_to_wait", arm),
        paired=lambda c: c.share_difference("let_go", "had_to_wait"),
        interval=Proportion,
        undefined="nobody had to wait",
    ),
    *(
        _per_1000(
            f"conflicts_{conflict.name}",
            conflict.heading,
            f"Conflicts, by the threshold `conflicts.{conflict.threshold}`,",
            first_screen=conflict.name == "pet",
        )
        for conflict in CONFLICTS
    ),
    Entry(
        "pairs",
        "pairs of hours",
        "Number of pairs of hours.",
        form=Form.COUNT,
        paired=lambda c: c.pairs,
    ),
    Entry(
        "failed",
        "failures",
        "Pairs in which an hour failed. No other number counts them.",
        form=Form.COUNT,
        paired=lambda c: c.failed,
    ),
    Entry(
        "saturated",
        "saturated",
        "Whether the road is saturated: more vehicles arrived than passed.",
        form=Form.FLAG,
        of_arm=lambda c, arm: c.saturated(arm),
    ),
    Entry(
        "growth",
        "growth of late vehicles",
        "Growth of the number of late vehicles from the first half of the hour to the second, as a "
        "share of the arrivals.",
        form=Form.SHARE,
        of_arm=lambda c, arm: c.growth(arm).share,
        undefined=_NO_VEHICLE,
    ),
    Entry(
        "growth_bound",
        "growth by chance",
        "Largest growth that chance alone explains.",
        form=Form.SHARE,
        of_arm=lambda c, arm: c.growth(arm).bound,
        undefined=_NO_VEHICLE,
    ),
    Entry(
        "rising_s",
        "rise of the delay",
        "Mean delay of the vehicles due in the last third of an hour minus that of the vehicles "
        "due in the first third.",
        unit="s",
        of_arm=lambda c, arm: c.rise_s(arm),
        interval=Interval,
        undefined=_NO_VEHICLE,
    ),
    _total(
        "not_through",
        "vehicles that never passed",
        "Vehicles that had not passed the crosswalk at the end.",
    ),
    _total("never_went", "people who never went", "People who had not stepped off at the end."),
    Entry(
        "unreached",
        "vehicles that never reached the crosswalk",
        "Vehicles that neither reached the crosswalk's near edge nor crashed.",
        form=Form.COUNT,
        of_arm=lambda c, arm: c.unreached(arm),
    ),
    _total(
        "conflicts_unreached",
        "vehicles that never reached it, with a conflict",
        "Vehicles that never reached the crosswalk but had a conflict of any kind. No rate counts "
        "these conflicts.",
    ),
    Entry(
        "fallback_share",
        "fallbacks among passages that met someone",
        "Among the passages that met someone and were driven by the arm's strategy, the share in "
        "which the strategy fell back on another one.",
        form=Form.SHARE,
        of_arm=lambda c, arm: c.share("fallbacks", "met", arm),
        interval=Proportion,
        undefined=_NOBODY_MET,
    ),
    Entry(
        "confidence",
        "confidence of each interval",
        "Confidence of every interval.",
        form=Form.SHARE,
        paired=lambda c: c.confidence,
    ),
)
"""The catalogue of hours of traffic, in the order in which it is shown."""
