"""Takes candidate rows and the thresholds of an extraction and returns the rows that are kept."""

from collections.abc import Mapping
from operator import gt, lt
from typing import Annotated, Any, Self, TypeVar

import numpy as np
import pandas as pd
from pydantic import BaseModel, ConfigDict, Field, model_validator

from harness.core.documents import check_form
from harness.core.errors import InputError, unknown_name
from harness.model.trajectories.counting import Tally

ROW_COLUMNS = (
    "source", "clip", "vehicle", "pedestrian", "time_s", "range_m", "lateral_m",
    "vehicle_speed_mps", "pedestrian_speed_mps", "arrival_time_s", "time_advantage_s",
    "crossing_angle_deg", "passed_first", "pet_s", "track",
)  # fmt: skip
TEXT_COLUMNS = ("source", "clip", "vehicle", "pedestrian", "passed_first", "track")

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class Options(BaseModel):
    """Options of an extraction, given by keyword."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)


ReaderOptions = TypeVar("ReaderOptions", bound=Options)


class ExtractionRules(Options):
    """Thresholds of pairs and instants in SI units; the defaults are from the data page.

    Attributes:
        sample_s: interval of rows on the clip's clock (5 Hz).
        speed_window_s: speeds are central differences over this window, cut at a track's ends.
        max_gap_s: speeds are undefined across a longer gap between two records.
        vehicle_extension_m, pedestrian_extension_m: a path is extended straight by this length
            beyond its last record.
        min_angle_deg, max_angle_deg: allowed angles between two crossing paths.
        min_range_m … min_time_advantage_s: bounds of a row, both ends included.
        min_vehicle_travel_m: a vehicle that stays within this distance of its first position is
            parked; its jitter is not a path.
        min_pedestrian_travel_m: the same for a standing pedestrian.
    """

    sample_s: Positive = 0.2
    speed_window_s: Positive = 0.5
    max_gap_s: Positive = 0.5
    vehicle_extension_m: NotNegative = 12.0
    pedestrian_extension_m: NotNegative = 3.0
    min_angle_deg: NotNegative = 50.0
    max_angle_deg: NotNegative = 130.0
    min_range_m: NotNegative = 0.5
    max_range_m: NotNegative = 60.0
    min_lateral_m: NotNegative = 0.3
    max_lateral_m: NotNegative = 15.0
    min_vehicle_speed_mps: NotNegative = 0.3
    min_pedestrian_speed_mps: NotNegative = 0.3
    min_time_advantage_s: NotNegative = 0.02
    min_vehicle_travel_m: NotNegative = 3.0
    min_pedestrian_travel_m: NotNegative = 1.0

    @model_validator(mode="after")
    def _bounds_are_in_order(self) -> Self:
        for name in ("angle_deg", "range_m", "lateral_m"):
            low, high = f"min_{name}", f"max_{name}"
            if getattr(self, low) > getattr(self, high):
                raise InputError(low, f"{getattr(self, low)} is above {high}", f"at most {high}")
        return self


def split_options(
    options: Mapping[str, Any], reader_options: type[ReaderOptions], where: str
) -> tuple[ExtractionRules, ReaderOptions]:
    """Split keyword options into the rules and the reader's options.

    Raises:
        InputError: an option is unknown, or a value is not allowed.
    """
    names = set(ExtractionRules.model_fields)
    known = names | set(reader_options.model_fields)
    for name in options:
        if name not in known:
            raise unknown_name(where, "option", name, known)
    rules = {name: value for name, value in options.items() if name in names}
    reader = {name: value for name, value in options.items() if name not in names}
    return check_form(ExtractionRules, rules, where), check_form(reader_options, reader, where)


_LIMITS = {
    "range_below_min": ("range_m", lt, "min_range_m"),
    "range_above_max": ("range_m", gt, "max_range_m"),
    "lateral_below_min": ("lateral_m", lt, "min_lateral_m"),
    "lateral_above_max": ("lateral_m", gt, "max_lateral_m"),
    "vehicle_too_slow": ("vehicle_speed_mps", lt, "min_vehicle_speed_mps"),
    "pedestrian_too_slow": ("pedestrian_speed_mps", lt, "min_pedestrian_speed_mps"),
    "time_advantage_below_min": ("time_advantage_s", lt, "min_time_advantage_s"),
}
"""When a row is dropped.  A missing L passes (ready-made rows may lack it), and so does a value
that equals a limit."""


def with_times(rows: pd.DataFrame) -> pd.DataFrame:
    """Add the arrival time R/v and T_adv = |R/v − L/v_p| (paper, eq. for T_Adv) to candidates.

    They are *undefined* (NaN) where a speed is zero or missing.
    """
    speed = rows["vehicle_speed_mps"].where(rows["vehicle_speed_mps"] != 0)
    walking = rows["pedestrian_speed_mps"].where(rows["pedestrian_speed_mps"] != 0)
    arrival = rows["range_m"] / speed
    advantage = (arrival - rows["lateral_m"] / walking).abs()
    return rows.assign(arrival_time_s=arrival, time_advantage_s=advantage)


def kept_rows(candidates: pd.DataFrame, rules: ExtractionRules, tally: Tally) -> pd.DataFrame:
    """The candidates that break no rule.  The others count under the first rule that they break."""
    tally.candidates += len(candidates)
    speeds = candidates[["vehicle_speed_mps", "pedestrian_speed_mps"]]
    # T_adv is undefined at a speed of 0.
    values = candidates.assign(time_advantage_s=candidates["time_advantage_s"].fillna(-1.0))
    breaks = {"speed_undefined": speeds.isna().any(axis=1)}
    breaks |= {
        reason: beyond(values[name], getattr(rules, limit))
        for reason, (name, beyond, limit) in _LIMITS.items()
    }
    alive = np.ones(len(candidates), dtype=bool)
    for reason, broken in breaks.items():
        tally.drop("candidates", reason, (alive & broken).sum())
        alive &= ~broken
    return candidates.loc[alive].reset_index(drop=True)
