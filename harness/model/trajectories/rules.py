"""The rules of an extraction: which rows are kept, and the counts of what was left out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import gt, lt
from typing import Annotated, Literal, Self

import numpy as np
import pandas as pd
from pydantic import BaseModel, ConfigDict, Field, model_validator

from harness.core.errors import InputError
from harness.core.freezing import Frozen
from harness.core.vocabulary import advantage_s

ROW_COLUMNS = (
    "source", "clip", "vehicle", "pedestrian", "time_s", "range_m", "lateral_m",
    "vehicle_speed_mps", "pedestrian_speed_mps", "arrival_time_s", "time_advantage_s",
    "crossing_angle_deg", "passed_first", "pet_s", "track",
)  # fmt: skip
"""The columns of rows, in their order."""
TEXT_COLUMNS = ("source", "clip", "vehicle", "pedestrian", "passed_first", "track")
"""Those of text; the others are numbers."""

Level = Literal["records", "tracks", "pairs", "candidates"]

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
        "undefined": "a needed value is missing: a gap in a track, or one shorter than the window",
        "min_range_m": "R below its minimum (bumper at or past the conflict point)",
        "max_range_m": "R above its maximum",
        "min_lateral_m": "L below its minimum (pedestrian at or past the vehicle's line)",
        "max_lateral_m": "L above its maximum",
        "min_vehicle_speed_mps": "v below its minimum (standing or rolling back)",
        "min_pedestrian_speed_mps": "v_p below its minimum (standing or turning away)",
        "min_time_advantage_s": "T_adv below its minimum, or unknown",
    },
}
"""Every reason for leaving something out, in the order in which it is checked.  A dropped item
counts under the first reason that applies, so the counts of one level add up.  The reasons of
candidates are bounds of ``ExtractionRules``, of the column whose name follows."""

Seconds = Annotated[float, Field(gt=0, le=60)]
Metres = Annotated[float, Field(ge=0, le=1_000)]


class ExtractionRules(BaseModel):
    """Thresholds of pairs and instants in SI units; the defaults are from the data page.

    Bounds belong to what they bound: a row at its smallest range is kept.
    """

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)

    sample_s: Seconds = 0.2
    """Interval of rows on the clip's clock (5 Hz)."""
    speed_window_s: Seconds = 0.5
    """Speeds are central differences over this window, cut at a track's ends."""
    max_gap_s: Seconds = 0.5
    """Speeds are undefined across a longer gap between two records."""
    vehicle_extension_m: Metres = 12.0
    """The path of a vehicle is extended straight by this length beyond its last record."""
    pedestrian_extension_m: Metres = 3.0
    """The same of a pedestrian's path."""
    min_angle_deg: Annotated[float, Field(ge=0, le=180)] = 50.0
    """Smallest angle between two crossing paths."""
    max_angle_deg: Annotated[float, Field(ge=0, le=180)] = 130.0
    """Largest angle between two crossing paths."""
    min_range_m: Metres = 0.5
    """Smallest R of a row."""
    max_range_m: Metres = 60.0
    """Largest R of a row."""
    min_lateral_m: Metres = 0.3
    """Smallest L of a row."""
    max_lateral_m: Metres = 15.0
    """Largest L of a row."""
    min_vehicle_speed_mps: Annotated[float, Field(ge=0, le=100)] = 0.3
    """Smallest v of a row."""
    min_pedestrian_speed_mps: Annotated[float, Field(ge=0, le=100)] = 0.3
    """Smallest v_p of a row."""
    min_time_advantage_s: Annotated[float, Field(ge=0, le=60)] = 0.02
    """Smallest T_adv of a row."""
    min_vehicle_travel_m: Metres = 3.0
    """A vehicle that stays within this distance of its first position is parked; its jitter is no
    path."""
    min_pedestrian_travel_m: Metres = 1.0
    """The same of a standing pedestrian."""
    source: str | None = None
    """Name of the data set; by default that of the folder (VCI sets) or of the file."""

    @model_validator(mode="after")
    def _bounds_are_in_order(self) -> Self:
        for name in ("angle_deg", "range_m", "lateral_m"):
            low, high = f"min_{name}", f"max_{name}"
            if getattr(self, low) > (most := getattr(self, high)):
                raise InputError(low, f"{getattr(self, low):g}", f"at most {high} = {most:g}")
        return self


@dataclass(frozen=True)
class Counts(Frozen):
    """The counts of an extraction.

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

    clips: int
    rows: int
    vehicles: int | None
    pairs: int | None
    candidates: int
    dropped: Mapping[Level, Mapping[str, int]]
    skipped: Mapping[str, str]
    notes: Sequence[str]


@dataclass
class Tally:
    """Those ``Counts`` into which readers and rules write."""

    clips: int = 0
    candidates: int = 0
    dropped: dict[Level, dict[str, int]] = field(
        default_factory=lambda: {
            level: dict.fromkeys(reasons, 0) for level, reasons in REASONS.items()
        }
    )
    skipped: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def drop(self, level: Level, reason: str, number: int = 1) -> None:
        """Count items of ``level`` as left out for a reason of ``REASONS``."""
        self.dropped[level][reason] += int(number)

    def remarks(self) -> list[str]:
        """Sentences on the records and clips left out, and on assumptions about the others."""
        dropped = [
            f"{number} records left out: {REASONS['records'][reason]}"
            for reason, number in self.dropped["records"].items()
            if number
        ]
        skipped = [f"Clip {clip} not used: {why}" for clip, why in self.skipped.items()]
        return [*dropped, *skipped, *self.notes]


def with_times(rows: pd.DataFrame) -> pd.DataFrame:
    """Add the arrival time R/v and T_adv = |R/v − L/v_p| (paper, eq. for T_Adv) to candidates.

    They are *undefined* (NaN) where a speed is zero or missing; the rows' own T_adv stands where L
    is missing.
    """
    speed = rows["vehicle_speed_mps"].where(rows["vehicle_speed_mps"] != 0)
    walking = rows["pedestrian_speed_mps"].where(rows["pedestrian_speed_mps"] != 0)
    advantage = advantage_s(rows["range_m"], speed, rows["lateral_m"], walking)
    advantage = advantage.fillna(rows["time_advantage_s"])
    return rows.assign(arrival_time_s=rows["range_m"] / speed, time_advantage_s=advantage)


def kept_rows(candidates: pd.DataFrame, rules: ExtractionRules, tally: Tally) -> pd.DataFrame:
    """The candidates that break no rule.  The others count under the first rule that they break.

    A missing L passes (ready-made rows may lack it), and so does a value that equals a limit.
    """
    tally.candidates += len(candidates)
    needed = candidates[["range_m", "vehicle_speed_mps", "pedestrian_speed_mps"]]
    # T_adv is undefined at a speed of 0.
    values = candidates.assign(time_advantage_s=candidates["time_advantage_s"].fillna(-1.0))
    alive = np.ones(len(candidates), dtype=bool)
    for reason in REASONS["candidates"]:
        end, _, column = reason.partition("_")
        if column:
            beyond = lt if end == "min" else gt
            broken = beyond(values[column], getattr(rules, reason))
        else:
            broken = needed.isna().any(axis=1)
        tally.drop("candidates", reason, (alive & broken).sum())
        alive &= ~broken
    return candidates.loc[alive].reset_index(drop=True)
