"""What a risk is of: an event of an episode, and a score that says how far an episode is from it.

The score is graded before the event, or no method could find its way there: a mere indicator holds
subset simulation up.  It orders episodes and means nothing else.
"""

import math
import re
from dataclasses import dataclass

from harness.core.encounter import Ending
from harness.core.errors import InputError, unknown_name
from harness.measures import MEASURES, EpisodeRecord

CRASHED = "crashed"

GRADINGS = 3
"""Ways in which an episode's distance from an event is graded."""

_FAR = 1_000.0
"""Added to the score of an episode in which the event's own measure is undefined."""

_NEVER_NEAR = 100.0
"""Added to the least gap in m, which grades an episode without a conflict."""

_BEYOND = {
    "min_time_advantage_s": "<",
    "pet_s": "<",
    "max_drac_mps2": ">",
    "required_deceleration_mps2": ">",
}
"""Measures that do not tell a crash, and the side of every limit on which it lies."""

_FORM = re.compile(r"\s*(\w+)\s*([<>])\s*([-+.\deE]+)\s*")


@dataclass(frozen=True, slots=True)
class Event:
    """A crash (``measure`` None), or a measure below or above a limit.

    A crash that leaves the measure undefined is in the event where it lies on that side: a DRAC
    that grew without bound is above every limit.  So is a crash below every time advantage, which
    is of points and not 0 where bodies touch.  Every other undefined measure is in no event.
    """

    text: str
    measure: str | None = None
    below: bool = True
    limit: float = 0.0

    def holds(self, record: EpisodeRecord) -> bool:
        """Whether an episode ended in the event."""
        crashed = record.ending is Ending.CRASHED
        if self.measure is None:
            return crashed
        value = getattr(record, self.measure)
        if value is None or (crashed and self.measure == "min_time_advantage_s"):
            return crashed and _BEYOND.get(self.measure) == ("<" if self.below else ">")
        return bool(value < self.limit if self.below else value > self.limit)

    def scores(self, record: EpisodeRecord) -> tuple[float, ...]:
        """How far an episode is from the event, graded in ``GRADINGS`` ways.

        Each is at most 0 in the event, positive outside; NaN where the episode failed.  Outside a
        crash they are 10/DRAC, PET and TTC, so that one of them leads to each kind of contact;
        where the measure is undefined, 100 and the least gap in m, +∞ where nobody stepped off.
        For another event it is the distance of the measure from its limit, in its unit.
        """
        if record.ending is Ending.ENGINE_FAILED:
            return (math.nan,) * GRADINGS
        value = None if self.measure is None else getattr(record, self.measure)
        if value is not None:
            distance = float(value) - self.limit if self.below else self.limit - float(value)
            distances = (distance,) * GRADINGS
        elif self.measure is None:
            distances = _to_a_crash(record)
        else:
            distances = tuple(_FAR + distance for distance in _to_a_crash(record))
        if self.holds(record):
            return tuple(min(distance, 0.0) for distance in distances)
        return tuple(max(distance, math.ulp(0.0)) for distance in distances)


def _to_a_crash(record: EpisodeRecord) -> tuple[float, ...]:
    """See ``Event.scores``; minus the speed at the contact in m/s where it crashed."""
    if record.ending is Ending.CRASHED:
        return (-float(record.contact_speed_mps or 0.0),) * GRADINGS
    gap_m = record.min_gap_m
    far = math.inf if gap_m is None else _NEVER_NEAR + float(gap_m)
    drac = record.max_drac_mps2
    return (
        10 / drac if drac else far,
        far if record.pet_s is None else float(record.pet_s),
        far if record.min_ttc_s is None else float(record.min_ttc_s),
    )


def parse_event(text: str) -> Event:
    """The event that a text names: ``crashed``, ``min_ttc_s<0.5``, ``contact_speed_mps>5``.

    Raises:
        InputError: the text is no event, or names no measure.

    >>> parse_event("contact_speed_mps>5")
    Event(text='contact_speed_mps>5', measure='contact_speed_mps', below=False, limit=5.0)
    """
    if text.strip() == CRASHED:
        return Event(CRASHED)
    match = _FORM.fullmatch(text)
    allowed = "crashed, or MEASURE<NUMBER or MEASURE>NUMBER, e.g. min_ttc_s<0.5"
    if match is None:
        raise InputError(f"--event {text}", "is no event", allowed)
    column, sign, number = match.groups()
    columns = [measure.column for measure in MEASURES]
    if column not in columns:
        raise unknown_name("--event", "measure", column, columns)
    try:
        limit = float(number)
    except ValueError:
        raise InputError(f"--event {text}", f"{number!r} is no number", allowed) from None
    if not math.isfinite(limit):
        raise InputError(f"--event {text}", f"{number!r} is not finite", allowed)
    return Event(f"{column}{sign}{limit:g}", column, sign == "<", limit)
