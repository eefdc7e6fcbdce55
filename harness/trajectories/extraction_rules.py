"""The thresholds of an extraction, and the rules that turn candidate rows into rows."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from harness.errors import InputError, unknown_name
from harness.trajectories.counting import Tally

ROW_COLUMNS = (
    "source",
    "clip",
    "vehicle",
    "pedestrian",
    "time_s",
    "range_m",
    "lateral_m",
    "vehicle_speed_mps",
    "pedestrian_speed_mps",
    "arrival_time_s",
    "time_advantage_s",
    "crossing_angle_deg",
    "passed_first",
    "pet_s",
    "track",
)
TEXT_COLUMNS = ("source", "clip", "vehicle", "pedestrian", "passed_first", "track")

Options = TypeVar("Options")


@dataclass(frozen=True)
class ExtractionRules:
    """Which pairs and instants become rows; SI units, defaults from the project's data page.

    Attributes:
        sample_s: rows stand at multiples of this on the clip's clock (5 Hz).
        speed_window_s: speeds are differences over this window, centred, cut at a track's ends.
        max_gap_s: no speed across a longer gap between two records.
        vehicle_extension_m, pedestrian_extension_m: a path goes on straight for at most this
            beyond the last record.
        min_angle_deg, max_angle_deg: allowed angle between the two paths where they cross.
        min_range_m … min_time_advantage_s: bounds of a row, both ends included.
        min_vehicle_travel_m: a vehicle that never gets this far from where it was first seen is
            parked (its recorded jitter would make a path of its own).
        min_pedestrian_travel_m: the same for a standing pedestrian.
    """

    sample_s: float = 0.2
    speed_window_s: float = 0.5
    max_gap_s: float = 0.5
    vehicle_extension_m: float = 12.0
    pedestrian_extension_m: float = 3.0
    min_angle_deg: float = 50.0
    max_angle_deg: float = 130.0
    min_range_m: float = 0.5
    max_range_m: float = 60.0
    min_lateral_m: float = 0.3
    max_lateral_m: float = 15.0
    min_vehicle_speed_mps: float = 0.3
    min_pedestrian_speed_mps: float = 0.3
    min_time_advantage_s: float = 0.02
    min_vehicle_travel_m: float = 3.0
    min_pedestrian_travel_m: float = 1.0

    def __post_init__(self) -> None:
        check_numbers(self, above_zero=("sample_s", "speed_window_s", "max_gap_s"))
        for low, high in (
            ("min_angle_deg", "max_angle_deg"),
            ("min_range_m", "max_range_m"),
            ("min_lateral_m", "max_lateral_m"),
        ):
            if getattr(self, low) > getattr(self, high):
                raise InputError(low, f"{getattr(self, low)} is above {high}", f"at most {high}")


def check_numbers(options: Any, above_zero: tuple[str, ...] = ()) -> None:
    """Refuse a float option that is no finite number, is negative, or is 0 where it must not be."""
    for item in fields(options):
        if item.type is not float:
            continue
        value = getattr(options, item.name)
        if isinstance(value, bool) or not isinstance(value, int | float | np.number):
            raise InputError(item.name, f"{value!r} is not a number", "a number")
        least = "a finite number above 0" if item.name in above_zero else "a finite number ≥ 0"
        signed = item.name in getattr(options, "SIGNED", ())
        low = not signed and (value < 0 or (item.name in above_zero and value == 0))
        if not math.isfinite(value) or low:
            raise InputError(item.name, f"got {value}", "a finite number" if signed else least)


def split_options(
    options: Mapping[str, Any], reader_options: type[Options], where: str
) -> tuple[ExtractionRules, Options]:
    """Sort keyword options into the rules and the reader's own; a misspelt one is refused."""
    of_rules = {item.name for item in fields(ExtractionRules)}
    of_reader = {item.name for item in fields(reader_options)}  # type: ignore[arg-type]
    for name in options:
        if name not in of_rules | of_reader:
            raise unknown_name(where, "option", name, of_rules | of_reader)
    rules = ExtractionRules(**{name: value for name, value in options.items() if name in of_rules})
    return rules, reader_options(
        **{name: value for name, value in options.items() if name in of_reader}
    )


Mask = Callable[[pd.DataFrame, ExtractionRules], "pd.Series[bool]"]

# Each rule says which rows it drops. Comparisons are written so that a missing L (ready-made rows
# may lack it) passes, and the bounds themselves pass.
ROW_RULES: Mapping[str, Mask] = {
    "speed_undefined": lambda rows, _: (
        rows["vehicle_speed_mps"].isna() | rows["pedestrian_speed_mps"].isna()
    ),
    "range_below_min": lambda rows, rule: rows["range_m"] < rule.min_range_m,
    "range_above_max": lambda rows, rule: rows["range_m"] > rule.max_range_m,
    "lateral_below_min": lambda rows, rule: rows["lateral_m"] < rule.min_lateral_m,
    "lateral_above_max": lambda rows, rule: rows["lateral_m"] > rule.max_lateral_m,
    "vehicle_too_slow": lambda rows, rule: rows["vehicle_speed_mps"] < rule.min_vehicle_speed_mps,
    "pedestrian_too_slow": lambda rows, rule: (
        rows["pedestrian_speed_mps"] < rule.min_pedestrian_speed_mps
    ),
    "time_advantage_below_min": lambda rows, rule: (
        ~(rows["time_advantage_s"] >= rule.min_time_advantage_s)
    ),
}


def with_times(rows: pd.DataFrame) -> pd.DataFrame:
    """Add the arrival time R/v and T_adv = |R/v − L/v_p| (paper, eq. for T_Adv) to candidates.

    Undefined (NaN) where a speed is zero or missing.
    """
    speed = rows["vehicle_speed_mps"].where(rows["vehicle_speed_mps"] != 0)
    walking = rows["pedestrian_speed_mps"].where(rows["pedestrian_speed_mps"] != 0)
    arrival = rows["range_m"] / speed
    advantage = (arrival - rows["lateral_m"] / walking).abs()
    return rows.assign(arrival_time_s=arrival, time_advantage_s=advantage)


def kept_rows(candidates: pd.DataFrame, rules: ExtractionRules, tally: Tally) -> pd.DataFrame:
    """The candidates that break no rule; each one dropped is charged to its first broken rule."""
    tally.candidates += len(candidates)
    alive = np.ones(len(candidates), dtype=bool)
    for reason, breaks in ROW_RULES.items():
        broken = alive & breaks(candidates, rules).to_numpy()
        tally.drop("candidates", reason, int(broken.sum()))
        alive &= ~broken
    return candidates.loc[alive].reset_index(drop=True)
