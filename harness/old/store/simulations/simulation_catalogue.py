"""Every number that a run of a user's own simulation reports, each defined once."""

from harness.encounter.simulation.visits import (
    ARRIVES,
    BENDS_WITHIN,
    INSIDE,
    LIGHT,
    STOPS,
    TURNS_SOON,
)
from harness.old.statistics import CONFLICTS, Conflict, Entry, Form, Interval, Proportion
from harness.old.store.arm_columns import ArmColumns, scaled

_NO_TRIP = "no such trip counts"
_NOBODY = "nobody crossed"
_NO_PASSAGE = "no vehicle passed a chosen crosswalk straight on"
_NOT_REACHED = "no vehicle reached a chosen crosswalk"
_NO_COMMAND = "no strategy drove"

AVS_NOT_DRIVEN = {
    "avs_bend": (BENDS_WITHIN, "bend within R0"),
    "avs_turn": (TURNS_SOON, "turn before their rear has left"),
    "avs_inside": (INSIDE, "came onto the approach within R0"),
    "avs_stop": (STOPS, "stop before their rear has left"),
    "avs_arrive": (ARRIVES, "arrive before their rear has left"),
    "avs_light": (LIGHT, "have a traffic light on their way"),
}
"""Columns of passages of AVs that no strategy may drive: the reason, and the words of a note."""


def _mean(
    key: str,
    heading: str,
    meaning: str,
    undefined: str,
    *,
    unit: str = "s",
    first: bool = True,
    may_be_absent: bool = False,
) -> Entry[ArmColumns]:
    """The mean over pairs of the column ``key``, and its difference pair by pair."""
    return Entry(
        key,
        heading,
        meaning,
        unit=unit,
        digits=1,
        of_arm=lambda c, arm: c.mean(key, arm),
        paired=lambda c: c.difference(key),
        interval=Interval,
        undefined=undefined,
        first_screen=first,
        may_be_absent=may_be_absent,
    )


def _total(key: str, heading: str, meaning: str) -> Entry[ArmColumns]:
    """The sum of the column ``key`` over pairs."""
    return Entry(key, heading, meaning, form=Form.COUNT, of_arm=lambda c, arm: c.total(key, arm))


def _conflicts(conflict: Conflict) -> Entry[ArmColumns]:
    """Conflicts of one kind per 1,000 vehicles that reached a chosen crosswalk."""
    events = f"conflicts_{conflict.name}"
    return Entry(
        f"{events}_per_1000",
        f"{conflict.heading} per 1,000",
        f"Conflicts, by the threshold `conflicts.{conflict.threshold}`, per 1,000 vehicles that "
        "reached a chosen crosswalk straight on or had a contact before it.",
        of_arm=lambda c, arm: scaled(c.share(events, "reached", arm), 1_000.0),
        paired=lambda c: scaled(c.share_difference(events, "reached"), 1_000.0),
        interval=Interval,
        undefined=_NOT_REACHED,
        first_screen=conflict.name == "pet",
    )


SIMULATIONS: tuple[Entry[ArmColumns], ...] = (
    _mean(
        "av_time_loss_s",
        "time loss of AVs",
        "Mean time loss of the AVs' trips through the whole scenario, with the wait for departure. "
        "In the reference's arm it is the mean of the same vehicles.",
        _NO_TRIP,
    ),
    _mean(
        "other_time_loss_s",
        "time loss of other vehicles",
        "Mean time loss of the trips of all other vehicles.",
        _NO_TRIP,
        may_be_absent=True,
    ),
    _mean(
        "people_time_loss_s",
        "time loss of people",
        "Mean time loss of people's trips, as SUMO computes it of their walks.",
        _NO_TRIP,
    ),
    _mean(
        "crosswalk_delay_s",
        "vehicles' delay at crosswalks",
        "Mean delay of the passages straight over a chosen crosswalk, from R0 until the rear has "
        "left it, against a passage at the vehicle's own free speed. A passage that did not end "
        "counts with its delay until then.",
        _NO_PASSAGE,
    ),
    _mean(
        "crosswalk_wait_s",
        "people's wait at crosswalks",
        "Mean time that people stood within 1 m of the kerb before they stepped off, or until the "
        "end.",
        _NOBODY,
    ),
    _mean(
        "queue_p95_m",
        "queue, 95 %",
        "95 % quantile, over seconds and chosen crosswalks, of the distance from the crosswalk to "
        "the rear of the last queued vehicle on a lane that leads straight over it. A vehicle at "
        "its scheduled stop is not queued.",
        _NO_PASSAGE,
        unit="m",
    ),
    Entry(
        "kappa",
        "contacts with people",
        "Contacts by the harness's geometry over the vehicles that reached a chosen crosswalk "
        "straight on or had a contact before it.",
        form=Form.EVENTS,
        digits=1,
        of_arm=lambda c, arm: c.share("crashes", "reached", arm),
        interval=Proportion,
        undefined=_NOT_REACHED,
        first_screen=True,
        crashes=True,
    ),
    *(_conflicts(conflict) for conflict in CONFLICTS),
    Entry(
        "cut_share",
        "commands cut by SUMO",
        "Share of the strategies' commands that SUMO did not follow because of other vehicles, "
        "lights or the junction.",
        form=Form.SHARE,
        digits=0,
        of_arm=lambda c, arm: c.share("cut", "commands", arm),
        interval=Proportion,
        undefined=_NO_COMMAND,
        first_screen=True,
        may_be_absent=True,
    ),
    _mean(
        "vehicle_time_loss_s",
        "time loss of all vehicles",
        "Mean time loss of all vehicles' trips, with the wait for departure.",
        _NO_TRIP,
        first=False,
    ),
    _mean(
        "people_duration_s",
        "duration of people's trips",
        "Mean duration of people's trips.",
        _NO_TRIP,
        first=False,
    ),
    Entry(
        "fallback_share",
        "fallbacks among passages that met someone",
        "Among the passages that met someone and were driven by the arm's strategy, the share in "
        "which the strategy fell back on another one.",
        form=Form.SHARE,
        of_arm=lambda c, arm: c.share("fallbacks", "met_driven", arm),
        interval=Proportion,
        undefined="no passage that a strategy drove met anyone",
    ),
    _total("vehicles", "vehicles", "Vehicles' trips that were due in the counted time."),
    _total("automated", "AVs", "Of these, the AVs; in the reference's arm the same vehicles."),
    _total("people", "people", "People's trips that were due in the counted time."),
    _total("passages", "passages", "Passages straight over a chosen crosswalk."),
    _total("met", "passages that met someone", "Passages during which somebody was there."),
    _total("driven", "passages that a strategy drove", "Passages that the arm's strategy drove."),
    _total(
        "not_driven",
        "passages that no strategy may drive",
        "Passages that SUMO drove, for the reasons below.",
    ),
    _total(
        "av_passages",
        "passages of AVs",
        "Passages of AVs; in the reference's arm of the same vehicles.",
    ),
    *(
        _total(column, f"of these, {words}", f"No strategy may drive: {why}.")
        for column, (why, words) in AVS_NOT_DRIVEN.items()
    ),
    _total(
        "avs_uncommanded",
        "of these, got no command",
        "A strategy may drive them, but gave no command: SUMO drove.",
    ),
    _total(
        "not_measured",
        "vehicles not measured",
        "Vehicles that turned at the crosswalk's junction, or whose way bends within 10 m before "
        "the crosswalk or before the rear has left it.",
    ),
    _total("unfinished", "trips that did not end", "They count with the time until the end."),
    _total("not_departed", "vehicles that never departed", "They count with their wait."),
    _total("sumo_collisions", "SUMO's collisions, vehicles", "Vehicle–vehicle collisions."),
    _total(
        "sumo_person_collisions",
        "SUMO's collisions, people",
        "SUMO's own collisions of a vehicle and a person, also of vehicles that stand and of "
        "crosswalks that were not chosen.",
    ),
    _total("teleports", "teleports", "Vehicles that SUMO teleported."),
    _total(
        "stuck",
        "vehicles that stood for over 60 s",
        "Vehicles on their way straight on that stood at a chosen crosswalk for more than 60 s "
        "without a break, the front at most 5 m before it.",
    ),
    _total(
        "deadlocked",
        "of these, with people who stood too",
        "Of these, vehicles for which somebody who wanted to cross stood there as well for more "
        "than 60 s: driver and people may have waited for each other.",
    ),
    Entry(
        "stood_longest_s",
        "longest stand of these",
        "Longest time for which such a vehicle stood; 0 without one.",
        unit="s",
        digits=0,
        of_arm=lambda c, arm: float(max(c.arms[arm]["stood_longest_s"], default=0.0)),
    ),
    Entry("pairs", "pairs", "Number of pairs.", form=Form.COUNT, paired=lambda c: c.pairs),
    Entry(
        "failed",
        "failures",
        "Pairs in which an arm failed. No other number counts them.",
        form=Form.COUNT,
        paired=lambda c: c.failed,
    ),
    Entry(
        "confidence",
        "confidence of each interval",
        "Confidence of every interval.",
        form=Form.SHARE,
        paired=lambda c: c.confidence,
    ),
)
"""The catalogue of users' own simulations, in the order in which it is shown."""
