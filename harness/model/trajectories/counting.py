"""Counts the items that an extraction used and left out, by rule."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Level = Literal["records", "tracks", "pairs", "candidates"]

# Every reason for leaving something out, in the order in which it is checked. A dropped item
# counts under the first reason that applies, so the counts of one level add up.
REASONS: Mapping[Level, Mapping[str, str]] = {
    "records": {
        "missing_value": "a needed cell is empty, NaN or infinite",
        "not_a_number": "a needed cell has text instead of a number",
        "out_of_scale": "a needed number is larger than any such measurement (1e12)",
        "duplicated": "same object and same instant as an earlier record",
        "bus_heading_other_way": "bus in the other direction (heading outside the limits)",
    },
    "tracks": {
        "one_record": "an object seen only once",
        "parked_vehicle": "vehicle that stays near its first position",
        "standing_pedestrian": "pedestrian who stays near their first position",
        "sequence_too_short": "sensor sequence shorter than the minimum duration",
    },
    "pairs": {
        "no_common_time": "vehicle and pedestrian share no sampling instant",
        "paths_do_not_cross": "the extended paths have no common point",
        "crossing_angle": "the paths cross outside the allowed angles",
        "no_row_kept": "the paths cross, but every candidate row broke a rule",
    },
    "candidates": {
        "incomplete": "a needed value of a ready-made row is missing",
        "contradictory": "time advantage of a ready-made row contradicts its other values",
        "speed_undefined": "gap in a track, or a track shorter than the speed window",
        "range_below_min": "R below its minimum (bumper at or past the conflict point)",
        "range_above_max": "R above its maximum",
        "lateral_below_min": "L below its minimum (pedestrian at or past the vehicle's line)",
        "lateral_above_max": "L above its maximum",
        "vehicle_too_slow": "v below its minimum (standing or rolling back)",
        "pedestrian_too_slow": "v_p below its minimum (standing or turning away)",
        "time_advantage_below_min": "T_adv below its minimum",
    },
}


@dataclass
class Tally:
    """The counts of an extraction; readers and rules write into it.

    Attributes:
        clips: clips that were read.
        rows: number of kept rows.
        vehicles, pairs: distinct vehicles, and vehicle–pedestrian pairs (encounters), with at least
            one row; None if a row does not identify them.
        candidates: sampled instants of crossing pairs before the row rules;
            ``rows + sum(dropped["candidates"].values()) == candidates``.
        dropped: level → reason → number left out, for every reason of ``REASONS``.
        skipped: clip → reason, for clips that could not be used at all.
        notes: what the files do not say and was assumed.
    """

    clips: int = 0
    rows: int = 0
    vehicles: int | None = None
    pairs: int | None = None
    candidates: int = 0
    dropped: dict[Level, dict[str, int]] = field(
        default_factory=lambda: {level: dict.fromkeys(of, 0) for level, of in REASONS.items()}
    )
    skipped: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def drop(self, level: Level, reason: str, number: int = 1) -> None:
        """Count items of ``level`` as left out for a reason of ``REASONS``."""
        self.dropped[level][reason] += int(number)

    def note(self, text: str) -> None:
        """Add a remark unless it is already there."""
        if text not in self.notes:
            self.notes.append(text)

    def remarks(self) -> list[str]:
        """Sentences on the records and clips left out, and on assumptions about the others."""
        dropped = [
            f"{number} records left out: {REASONS['records'][reason]}"
            for reason, number in self.dropped["records"].items()
            if number
        ]
        skipped = [f"Clip {clip} not used: {why}" for clip, why in self.skipped.items()]
        return [*dropped, *skipped, *self.notes]
