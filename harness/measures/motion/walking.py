"""A walk in; positions and times in the road frame out."""

import math

import numpy as np

from harness.core.vocabulary import ROUNDING, Crossing, FloatArray, Leg, Side, Walk


def legs_of(walk: Walk, crossing: Crossing) -> tuple[Leg, ...]:
    """The legs of a pedestrian who stepped off."""
    if walk.legs is not None:
        return walk.legs
    assert walk.start_s is not None
    assert walk.speed_mps is not None
    if walk.arrival.side is Side.NEAR:
        return (Leg(walk.start_s, 0.0, 0.0, 0.0, walk.speed_mps, 0.0),)
    return (Leg(walk.start_s, 0.0, crossing.length_m, 0.0, -walk.speed_mps, 0.0),)


def cleared_s(walk: Walk, crossing: Crossing) -> float | None:
    """The time at which a pedestrian reaches the other kerb; None if they never do."""
    if walk.start_s is None:
        return None
    legs = legs_of(walk, crossing)
    kerb_m = crossing.length_m if walk.arrival.side is Side.NEAR else 0.0
    ends = [leg.time_s for leg in legs[1:]] + [math.inf]
    for leg, end_s in zip(legs, ends, strict=True):
        time_s = leg.time_s + time_over_s(leg, kerb_m - leg.y_m)
        # The kerb may lie beyond the leg's end by a rounding error.
        if math.isfinite(time_s) and time_s <= end_s + ROUNDING:
            return time_s
    return None


def time_over_s(leg: Leg, across_m: float) -> float:
    """Time on a leg until y has changed by ``across_m``; infinite if it never does."""
    reach = leg.y_mps**2 + 2 * leg.y_mps2 * across_m
    if across_m == 0:
        return 0.0
    if reach < 0:
        return math.inf
    speed = leg.y_mps + math.copysign(math.sqrt(reach), across_m)
    time_s = 2 * across_m / speed if speed else math.inf
    return time_s if time_s >= 0 else math.inf


def states_at(
    walk: Walk, crossing: Crossing, times_s: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """(x, y, speed, forward acceleration) of a pedestrian who stepped off, at given times.

    Args:
        walk: their walk.
        crossing: the crosswalk.
        times_s: shape (n,), none before they stepped off.

    Returns:
        Four arrays of shape (n,), in m, m, m/s and m/s².
    """
    legs = legs_of(walk, crossing)
    columns = np.array(legs, dtype=float).T
    number = np.searchsorted(columns[0], times_s, side="right") - 1
    begin_s, x_m, y_m, x_mps, y_mps, y_mps2 = columns[:, np.maximum(number, 0)]
    walked_s = times_s - begin_s
    velocity_mps = y_mps + y_mps2 * walked_s
    # 0.0 − 0.0 is 0.0; −0.0 would be written differently into a file.
    forward_mps2 = y_mps2 if walk.arrival.side is Side.NEAR else 0.0 - y_mps2
    return (
        x_m + x_mps * walked_s,
        y_m + y_mps * walked_s + y_mps2 * walked_s**2 / 2,
        np.hypot(x_mps, velocity_mps),
        forward_mps2,
    )
