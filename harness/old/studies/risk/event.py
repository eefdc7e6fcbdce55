"""The event of a risk estimate, and a score for the distance of an episode from the event.

The score varies outside the event, because subset simulation cannot approach the event with a
0/1 indicator.  The score orders episodes and has no other meaning.
"""

import math
import re
from dataclasses import dataclass

from harness.core.encounter import Ending
from harness.core.errors import InputError, unknown_name
from harness.measures import MEASURES, EpisodeRecord

CRASHED = "crashed"

GRADINGS = 4
"""Number of scores by which the distance of an episode from an event is graded."""

_FAR = 1_000.0
"""Added to the score of an episode in which the event's measure is undefined."""

_NEVER_NEAR = 100.0
"""Added to the smallest gap in m, which is the score of an episode without a conflict."""

_BEYOND = {
    "min_time_advantage_s": "<",
    "pet_s": "<",
    "max_drac_mps2": ">",
    "required_deceleration_mps2": ">",
}
"""Measures that are undefined in some crashes, and the side of any limit where a crash lies."""

_FORM = re.compile(r"\s*(\w+)\s*([<>])\s*([-+.\deE]+)\s*")


@dataclass(frozen=True, slots=True)
class Event:
    """A crash (``measure`` None), or a measure below or above a limit.

    ``_BEYOND`` decides on a crash in which the measure is undefined.  For example, DRAC grows
    without bound, so a crash is above every limit of DRAC.  A crash always counts as below every
    limit of the time advantage, which refers to points and is not 0 when bodies touch.  Any other
    episode with an undefined measure is not in the event.
    """

    text: str
    measure: str | None = None
    below: bool = True
    limit: float = 0.0

    def holds(self, record: EpisodeRecord) -> bool:
        """Return whether an episode ended in the event."""
        crashed = record.ending is Ending.CRASHED
        if self.measure is None:
            return crashed
        value = getattr(record, self.measure)
        if value is None or (crashed and self.measure == "min_time_advantage_s"):
            return crashed and _BEYOND.get(self.measure) == ("<" if self.below else ">")
        return bool(value < self.limit if self.below else value > self.limit)

    def scores(self, record: EpisodeRecord) -> tuple[float, ...]:
        """Return the distance of an episode from the event, graded in ``GRADINGS`` ways.

        Each score is at most 0 in the event and positive outside it; NaN if the episode failed.
        If the event is a crash, the scores of other episodes are 10/DRAC, PET, TTC and the smallest
        gap in m, so that one of them leads to each kind of contact.  If such a measure is
        undefined, the score is 100 plus the smallest gap, or +∞ if nobody stepped off.  For another
        event the score is the distance of the measure from its limit, in the measure's unit.
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
    """Return ``Event.scores`` for the event crash; in a crash, minus the contact speed in m/s."""
    if record.ending is Ending.CRASHED:
        return (-float(record.contact_speed_mps or 0.0),) * GRADINGS
    gap_m = record.min_gap_m
    far = math.inf if gap_m is None else _NEVER_NEAR + float(gap_m)
    drac = record.max_drac_mps2
    return (
        10 / drac if drac else far,
        far if record.pet_s is None else float(record.pet_s),
        far if record.min_ttc_s is None else float(record.min_ttc_s),
        far if gap_m is None else float(gap_m),
    )


def parse_event(text: str) -> Event:
    """Parse an event: ``crashed``, ``min_ttc_s<0.5`` or ``contact_speed_mps>5``.

    Raises:
        InputError: the text is not an event, or names an unknown measure.

    >>> parse_event("contact_speed_mps>5")
    Event(text='contact_speed_mps>5', measure='contact_speed_mps', below=False, limit=5.0)
    """
    if text.strip() == CRASHED:
        return Event(CRASHED)
    match = _FORM.fullmatch(text)
    allowed = "crashed, or MEASURE<NUMBER or MEASURE>NUMBER, e.g. min_ttc_s<0.5"
    if match is None:
        raise InputError(f"--event {text}", "is not an event", allowed)
    column, sign, number = match.groups()
    columns = [measure.column for measure in MEASURES]
    if column not in columns:
        raise unknown_name("--event", "measure", column, columns)
    try:
        limit = float(number)
    except ValueError:
        raise InputError(f"--event {text}", f"{number!r} is not a number", allowed) from None
    if not math.isfinite(limit):
        raise InputError(f"--event {text}", f"{number!r} is not finite", allowed)
    return Event(f"{column}{sign}{limit:g}", column, sign == "<", limit)
