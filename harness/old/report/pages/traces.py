"""Turns traces into the player's documents of thinned and rounded numbers."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from harness.core.documents import JsonObject
from harness.core.encounter import PEDESTRIAN_RADIUS_M, Arm, Crossing, FloatArray, Vehicle
from harness.report.player import time_advantage

MOST_STATES = 1_500
"""Maximum number of states in one arm of an encounter; longer traces are thinned evenly."""

HOUR_STEP_S = 0.5
"""Time in s between two states of an object in an hour."""

_FURTHEST_M = 48.0
_BEYOND_M = 14.0
"""Limits in m of the stretch of road that is shown for an encounter."""

Numbers = list[float | None]
Encoded = Mapping[str, object]
"""A part of the document that ``templates/player.js`` reads."""


def scene_of(
    crossing: Crossing, vehicle: Vehicle, borders: Iterable[float] = (), obstacles: Any = ()
) -> JsonObject:
    """Return the crosswalk of an encounter, in metres."""
    half_lane = crossing.lane_width_m / 2
    ends = (crossing.lane_centre_m - half_lane, crossing.lane_centre_m + half_lane)
    return {
        "length": crossing.length_m,
        "width": crossing.width_m,
        "borders": rounded(borders),
        "stop": rounded((-crossing.stop_line_m, *ends)),
        "carLength": vehicle.length_m,
        "carWidth": vehicle.width_m,
        "radius": PEDESTRIAN_RADIUS_M,
        "left": -min(vehicle.trigger_range_m + vehicle.length_m, _FURTHEST_M) - 1,
        "right": _BEYOND_M,
        "obstacles": [rounded((*each.x_bounds_m, *each.y_bounds_m)) for each in obstacles],
    }


def shown_arm(
    arm: Arm,
    title: str,
    rows: pd.DataFrame,
    people: pd.DataFrame,
    crossing: Crossing | None = None,
    words: str = "",
    contact: Encoded | None = None,
) -> JsonObject:
    """Return the player's document of one arm of an episode.

    Args:
        arm: the arm, which determines the colours.
        title: name of the driver.
        rows: rows of ``traces``.
        people: ``index, side, arrival_s, start_s`` of each pedestrian.
        crossing: the crosswalk of an encounter, for its curves over time; None for an hour.
        words: the episode's ending.
        contact: the ``time`` of a contact, and the ``index`` of the pedestrian.
    """
    step_s = HOUR_STEP_S
    if crossing is not None:
        times_s = rows["time_s"].unique()
        step_s = np.ptp(times_s) / MOST_STATES if len(times_s) > MOST_STATES else 0.0
    objects = {str(name): states for name, states in rows.groupby("object", sort=False)}
    vehicles, beliefs = [], []
    for name, states in objects.items():
        kept = _kept(states["time_s"].to_numpy(), step_s)
        if name.startswith("shown-"):
            beliefs.append({"index": int(name.removeprefix("shown-")), **_track(states, kept)})
        elif "-shown-" not in name and not name.startswith("pedestrian-"):
            vehicle = {"name": name, "filled": True, "oncoming": False, **_track(states, kept)}
            if crossing is not None:
                vehicle["v"] = rounded(states["speed_mps"].to_numpy()[kept])
                vehicle["gap"] = rounded(time_advantage(rows, crossing)[kept])
            vehicles.append(vehicle)
    walkers = []
    for person in people.to_dict("records"):
        states = objects.get(f"pedestrian-{person['index']}", rows.iloc[:0])
        start = {"arrival": short(person["arrival_s"]), "start": short(person["start_s"])}
        track = _track(states, _kept(states["time_s"].to_numpy(), step_s))
        walkers.append({"index": person["index"], "side": person["side"], **start, **track})
    return {
        "arm": arm.value,
        "title": title,
        "words": words,
        "contact": contact,
        "vehicles": vehicles,
        "walkers": walkers,
        "shown": beliefs,
    }


def _kept(times_s: FloatArray, step_s: float) -> "np.ndarray":
    """Return the indices of shown states: the first in each ``step_s`` interval, and the last."""
    if not step_s or not len(times_s):
        return np.arange(len(times_s))
    intervals = np.floor(times_s / step_s + 1e-6)
    return np.union1d(np.unique(intervals, return_index=True)[1], len(times_s) - 1)


def _track(rows: pd.DataFrame, kept: "np.ndarray") -> Encoded:
    """Return an object's times and coordinates; a constant coordinate is one number."""
    t, x, y = (rounded(rows[name].to_numpy()[kept]) for name in ("time_s", "x_m", "y_m"))
    return {"t": t, "x": _constant(x), "y": _constant(y)}


def _constant(values: Numbers) -> Numbers | float | None:
    return values[0] if len({*values}) == 1 else values


def rounded(values: Iterable[float]) -> Numbers:
    """Round values to three decimals; None if undefined."""
    return [short(value) for value in values]


def short(value: float | None) -> float | None:
    """Round a value to three decimals; None if undefined."""
    if value is None or not math.isfinite(value):
        return None
    thousandths = round(float(value), 3)
    return int(thousandths) if thousandths == int(thousandths) else thousandths
