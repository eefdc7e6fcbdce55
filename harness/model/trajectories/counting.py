"""Counts the items that an extraction used and left out, by rule."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

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
    """The running counts of one extraction; readers and rules write into it."""

    clips: int = 0
    pedestrian_tracks: int = 0
    vehicle_tracks: int = 0
    candidates: int = 0
    out_of_order: int = 0
    default_lengths: int = 0
    skipped: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    dropped: dict[Level, Counter[str]] = field(
        default_factory=lambda: {level: Counter() for level in REASONS}
    )

    def drop(self, level: Level, reason: str, number: int = 1) -> None:
        """Count ``number`` items of ``level`` as left out for a reason of ``REASONS``."""
        if reason not in REASONS[level]:
            raise KeyError(f"{level}: {reason}")
        if number:
            self.dropped[level][reason] += int(number)

    def remarks(self) -> list[str]:
        """Sentences on the records left out, and on assumptions about the other records."""
        dropped = (
            f"{number} records left out: {REASONS['records'][reason]}"
            for reason, number in self.dropped["records"].items()
        )
        skipped = (f"Clip {clip} not used: {why}" for clip, why in self.skipped.items())
        return [*dropped, *skipped, *self.notes]

    def note(self, text: str) -> None:
        """Add a remark unless it is already there."""
        if text not in self.notes:
            self.notes.append(text)


@dataclass(frozen=True)
class Counts:
    """The counts of a finished extraction.

    Attributes:
        clips: clips that were read (None for ready-made rows, which have none).
        vehicle_tracks, pedestrian_tracks: usable tracks in those clips.
        vehicles: distinct vehicles with at least one row; None if unknown.
        pairs: distinct vehicle–pedestrian pairs (encounters) with at least one row; None if
            unknown.
        rows: number of kept rows.
        candidates: sampled instants of crossing pairs before the row rules;
            ``rows + sum(dropped["candidates"].values()) == candidates``.
        out_of_order: records that stand below a later instant in their file; they are used.
        default_lengths: vehicles whose length was not in the data and was taken from the options.
        skipped: clip → reason, for clips that could not be used at all.
        dropped: level → reason → number left out; the reasons are in ``REASONS``.
        notes: remarks on the result.
    """

    clips: int | None
    vehicle_tracks: int
    pedestrian_tracks: int
    vehicles: int | None
    pairs: int | None
    rows: int
    candidates: int
    out_of_order: int
    default_lengths: int
    skipped: Mapping[str, str]
    dropped: Mapping[Level, Mapping[str, int]]
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, object]:
        """The counts as plain data (JSON-ready), reasons in their fixed order."""
        return {**asdict(self), "notes": list(self.notes)}


def freeze(tally: Tally, rows: int, vehicles: int | None, pairs: int | None) -> Counts:
    """The tally as an immutable record with every reason of ``REASONS``, even if its count is 0."""
    every_reason = {
        level: {reason: tally.dropped[level][reason] for reason in reasons}
        for level, reasons in REASONS.items()
    }
    final: dict[str, Any] = {"skipped": dict(tally.skipped), "notes": tuple(tally.notes)}
    final |= {"clips": tally.clips or None, "dropped": every_reason}
    return Counts(rows=rows, vehicles=vehicles, pairs=pairs, **(vars(tally) | final))
