"""The tracks of a clip in; candidate rows out, one for each pair and sampling instant."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from harness.core.freezing import Frozen, frozen
from harness.core.vocabulary import ROUNDING, BoolArray, FloatArray
from harness.model.trajectories.rules import ExtractionRules, Tally
from harness.model.trajectories.tracks import (
    Clip,
    Track,
    TravelPath,
    VehicleTrack,
    arc_of_records,
    build_path,
    fingerprint,
    first_crossing,
    travel_m,
)

VEHICLE_STEP_M, VEHICLE_CHORD_M = 0.5, 2.0
PEDESTRIAN_STEP_M, PEDESTRIAN_CHORD_M = 0.25, 1.0
"""Spacing of corners, and length of the chord that gives a direction.  They are longer than the
recording jitter (about 2 cm in drone video) and shorter than turns of cars or pedestrians."""

LONG_PAUSE_S = 10.0
"""A longer pause of a track has no sampling instants."""

PairColumns = dict[str, FloatArray | str | float | None]
"""The columns of one pair's candidate rows: arrays of one length, or one value for all of them."""


@dataclass(frozen=True, eq=False)
class Mover(Frozen):
    """A track with its path and the path length of every record."""

    track: Track
    path: TravelPath
    arc_m: FloatArray


def candidate_rows(clip: Clip, rules: ExtractionRules, tally: Tally) -> Iterator[pd.DataFrame]:
    """The candidate rows of a clip, pair by pair, in the order of its tracks.

    A pair is a vehicle and a pedestrian whose paths cross.  ``tally`` counts what is left out.

    Yields:
        Frames with ``ROW_COLUMNS``, but R/v and T_adv.  A speed is *undefined* (NaN) at a gap in
        the track, or if the track is shorter than half the speed window.
    """
    walkers = {name: walker_of(track, rules) for name, track in clip.pedestrians.items()}
    tally.drop("tracks", "standing_pedestrian", [*walkers.values()].count(None))
    for vehicle, track in clip.vehicles.items():
        car = car_of(track, rules)
        if car is None:
            tally.drop("tracks", "parked_vehicle")
            continue
        names = {"source": clip.source, "clip": clip.name, "track": fingerprint(track)}
        for pedestrian, walker in walkers.items():
            columns = None if walker is None else _pair_rows(track, car, walker, rules, tally)
            if columns is not None:
                names |= {"vehicle": vehicle, "pedestrian": pedestrian}
                yield pd.DataFrame(names | columns)


def walker_of(track: Track, rules: ExtractionRules) -> Mover | None:
    """A pedestrian with their path; None if they stand."""
    shape = (PEDESTRIAN_STEP_M, PEDESTRIAN_CHORD_M, rules.pedestrian_extension_m)
    return _mover(track, shape, rules.min_pedestrian_travel_m)


def car_of(track: Track, rules: ExtractionRules) -> Mover | None:
    """A vehicle with its path; None if it is parked."""
    shape = (VEHICLE_STEP_M, VEHICLE_CHORD_M, rules.vehicle_extension_m)
    return _mover(track, shape, rules.min_vehicle_travel_m)


def _mover(track: Track, shape: tuple[float, float, float], least_m: float) -> Mover | None:
    """The track with its path; None if the object stays near its first position."""
    path = build_path(track.position_m, *shape) if travel_m(track.position_m) >= least_m else None
    return None if path is None else Mover(track, path, arc_of_records(path, track.position_m))


def _pair_rows(
    vehicle: VehicleTrack, car: Mover, walker: Mover, rules: ExtractionRules, tally: Tally
) -> PairColumns | None:
    """R, L and their rates at the sampling instants of a pair; None if it is not an encounter."""
    times_s = sampling_instants(vehicle.time_s, walker.track.time_s, rules.sample_s)
    if len(times_s) == 0:
        tally.drop("pairs", "no_common_time")
        return None
    crossing = crossing_of(car, walker, rules)
    if isinstance(crossing, str):
        tally.drop("pairs", crossing)
        return None
    on_car, driving, walking, angle = crossing
    range_m = on_car - car.arc_m - vehicle.front_offset_m
    # L is the distance from the line of the vehicle's path at the conflict point, positive on
    # the side the pedestrian comes from.
    across = np.array([-driving[1], driving[0]])
    if across @ walking < 0:
        across = -across
    lateral_m = (car.path.at(on_car) - walker.track.position_m) @ across
    return {
        **rows_of_pair(
            times_s, vehicle.length_m, vehicle.time_s, range_m, walker.track.time_s, lateral_m
        ),
        "vehicle_speed_mps": -rate(vehicle.time_s, range_m, times_s, rules),
        "pedestrian_speed_mps": -rate(walker.track.time_s, lateral_m, times_s, rules),
        "crossing_angle_deg": angle,
    }


class CrossingPaths(NamedTuple):
    """Where two paths cross: the path length on the vehicle's, the unit directions, the angle."""

    on_car_m: float
    driving: FloatArray
    walking: FloatArray
    crossing_deg: float


def crossing_of(car: Mover, walker: Mover, rules: ExtractionRules) -> CrossingPaths | str:
    """The first crossing along the vehicle's path, or why it makes no pair."""
    crossing = first_crossing(car.path, walker.path)
    if crossing is None:
        return "paths_do_not_cross"
    driving = car.path.direction(crossing[0], VEHICLE_CHORD_M / 2)
    walking = walker.path.direction(crossing[1], PEDESTRIAN_CHORD_M / 2)
    angle = angle_deg(driving, walking)
    if not rules.min_angle_deg <= angle <= rules.max_angle_deg:
        return "crossing_angle"
    return CrossingPaths(crossing[0], frozen(driving), frozen(walking), angle)


def angle_deg(driving: FloatArray, walking: FloatArray) -> float:
    """Angle between two unit directions in degrees, 0 to 180."""
    return math.degrees(math.acos(float(np.clip(driving @ walking, -1.0, 1.0))))


def rows_of_pair(
    times_s: FloatArray,
    length_m: float,
    vehicle_time_s: FloatArray,
    range_m: FloatArray,
    pedestrian_time_s: FloatArray,
    lateral_m: FloatArray,
) -> PairColumns:
    """R and L at the sampling instants, who passed first, and the post-encroachment time.

    The vehicle is on the conflict point from R = 0 (front bumper) to R = −length (rear bumper); the
    pedestrian is a point that passes at L = 0.  Who passed first is *undefined* (None) if neither
    record shows it.  The post-encroachment time, between the departure of the first and the arrival
    of the second, is also undefined (NaN) if only one of the two passages was recorded, or if the
    pedestrian passed the line while the vehicle stood on it.

    Args:
        times_s: (n,) the instants.
        length_m: the vehicle's length.
        vehicle_time_s, range_m: R over time.
        pedestrian_time_s, lateral_m: L over time.
    """
    front = _passing(vehicle_time_s, range_m)
    rear = _passing(vehicle_time_s, range_m + length_m)
    walker = _passing(pedestrian_time_s, lateral_m)
    passed_first, pet_s = None, math.nan
    if front[1] <= walker[0]:
        passed_first, left, came = "vehicle", rear, walker
    elif walker[1] <= front[0]:
        passed_first, left, came = "pedestrian", walker, front
    # The two bounds of a recorded passage are equal.
    if passed_first and left[0] == left[1] <= came[0] == came[1]:
        pet_s = came[0] - left[0]
    return {
        "time_s": times_s,
        "range_m": np.interp(times_s, vehicle_time_s, range_m),
        "lateral_m": np.interp(times_s, pedestrian_time_s, lateral_m),
        "passed_first": passed_first,
        "pet_s": pet_s,
    }


def sampling_instants(first_s: FloatArray, second_s: FloatArray, sample_s: float) -> FloatArray:
    """Multiples of the sampling interval within the common time of two tracks.

    Args:
        first_s, second_s: increasing times of the two tracks, s.
        sample_s: interval, s.

    Returns:
        Increasing times, possibly none.  The ends of the common time are included if they are
        multiples up to rounding.  A pause of the first track longer than ``LONG_PAUSE_S`` has no
        instants, because one wrong time could otherwise cause millions of them.
    """
    pauses = np.flatnonzero(np.diff(first_s) > LONG_PAUSE_S)
    starts = np.maximum(first_s[np.concatenate([[0], pauses + 1])], second_s[0])
    ends = np.minimum(first_s[np.concatenate([pauses, [len(first_s) - 1]])], second_s[-1])
    stretches = []
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        begin = math.ceil(start / sample_s - ROUNDING)
        last = math.floor(end / sample_s + ROUNDING)
        if end >= start:
            stretches.append(np.clip(np.arange(begin, last + 1) * sample_s, start, end))
    return np.concatenate([np.empty(0), *stretches])


def spans_gap(
    time_s: FloatArray, begin_s: FloatArray, end_s: FloatArray, max_gap_s: float
) -> BoolArray:
    """(n,) bool: whether a recording gap longer than ``max_gap_s`` lies within [begin, end]."""
    gaps_before = np.concatenate([[0], np.cumsum(np.diff(time_s) > max_gap_s)])
    left = np.clip(np.searchsorted(time_s, begin_s, side="right") - 1, 0, None)
    right = np.clip(np.searchsorted(time_s, end_s, side="left"), None, len(time_s) - 1)
    return np.asarray(gaps_before[right] > gaps_before[left])


def rate(
    time_s: FloatArray, value: FloatArray, at_s: FloatArray, rules: ExtractionRules
) -> FloatArray:
    """Rate of change over the speed window around each instant, cut at the track's ends.

    It is undefined (NaN) across a gap, and if less than half of the window was recorded.
    """
    half_s = rules.speed_window_s / 2
    begin_s, end_s = np.maximum(at_s - half_s, time_s[0]), np.minimum(at_s + half_s, time_s[-1])
    gap = spans_gap(time_s, begin_s, end_s, rules.max_gap_s)
    known = (end_s - begin_s >= half_s - ROUNDING) & ~gap
    change = np.interp(end_s, time_s, value) - np.interp(begin_s, time_s, value)
    return np.where(known, change / np.where(known, end_s - begin_s, 1.0), np.nan)


def _passing(time_s: FloatArray, remaining_m: FloatArray) -> tuple[float, float]:
    """Bounds of the time at which the remaining distance first is 0; equal if it was recorded."""
    past = np.flatnonzero(remaining_m <= 0)
    if len(past) == 0:
        return float(time_s[-1]), math.inf
    if past[0] == 0:
        return -math.inf, float(time_s[0])
    after = int(past[0])
    left, right = remaining_m[after - 1], remaining_m[after]
    share = left / (left - right)
    when = float(time_s[after - 1] + share * (time_s[after] - time_s[after - 1]))
    return when, when
