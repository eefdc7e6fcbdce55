"""Whether obstacles hide a pedestrian, by exact plane geometry in the road frame."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from harness.core.encounter import PEDESTRIAN_RADIUS_M

_ROUNDING_RAD = 1e-12
"""Tolerance of angles: obstacles that touch each other leave no gap."""

Point = tuple[float, float]
"""(x, y) in m."""


class Rectangle(NamedTuple):
    """An obstacle in the road frame, its sides along x and y, in m."""

    x_low_m: float
    x_high_m: float
    y_low_m: float
    y_high_m: float


def is_hidden(eye: Point, centre: Point, obstacles: Sequence[Rectangle]) -> bool:
    """Whether obstacles hide the whole disc of a pedestrian from an eye.

    At distance d a disc of radius r covers the angles within asin(r/d) of the direction to its
    centre.  An obstacle in front of it hides the angles between its outermost corners.  The disc is
    hidden if the obstacles together hide all its angles.

    Args:
        eye: the eye, outside every obstacle.
        centre: centre of the disc, which no obstacle touches.
        obstacles: the obstacles.

    Example:
        >>> wall = Rectangle(4.0, 5.0, -1.0, 1.0)
        >>> is_hidden((0.0, 0.0), (10.0, 0.0), [wall])
        True
        >>> is_hidden((0.0, 0.0), (3.0, 0.0), [wall])  # before the wall
        False
    """
    ahead, across = centre[0] - eye[0], centre[1] - eye[1]
    distance = math.hypot(ahead, across)
    if distance <= PEDESTRIAN_RADIUS_M:
        return False
    bearing = math.atan2(across, ahead)
    half = math.asin(PEDESTRIAN_RADIUS_M / distance)
    covered = sorted(
        shadow for obstacle in obstacles for shadow in _shadows(eye, bearing, distance, obstacle)
    )
    reached = -half
    for low, high in covered:
        if low > reached + _ROUNDING_RAD:
            return False
        reached = max(reached, high)
    return reached >= half - _ROUNDING_RAD


def _shadows(
    eye: Point, bearing: float, distance_m: float, obstacle: Rectangle
) -> list[tuple[float, float]]:
    """The angles of the disc that an obstacle hides, relative to the direction to its centre."""
    x_low, x_high, y_low, y_high = (
        bound - eye[number // 2] for number, bound in enumerate(obstacle)
    )
    middle = math.atan2((y_low + y_high) / 2, (x_low + x_high) / 2)
    # Seen from outside, a rectangle fills less than half a turn.
    corners = [_turned(math.atan2(y, x) - middle) for x in (x_low, x_high) for y in (y_low, y_high)]
    first, last = min(corners), max(corners)
    half = math.asin(PEDESTRIAN_RADIUS_M / distance_m)
    shadows = []
    for turn in (-math.tau, 0.0, math.tau):
        offset = _turned(middle - bearing) + turn
        low, high = max(offset + first, -half), min(offset + last, half)
        if high - low <= _ROUNDING_RAD:
            continue
        angle = (low + high) / 2
        # Of two separate convex bodies the same one is nearer along every line of sight.
        to_disc = distance_m * math.cos(angle) - math.sqrt(
            max(0.0, PEDESTRIAN_RADIUS_M**2 - (distance_m * math.sin(angle)) ** 2)
        )
        if _entry(bearing + angle, (x_low, x_high), (y_low, y_high)) < to_disc:
            shadows.append((low, high))
    return shadows


def _entry(direction: float, x_m: Point, y_m: Point) -> float:
    """Distance from the origin at which a line of sight enters a rectangle that it meets."""
    enter = 0.0
    for slope, bounds in ((math.cos(direction), x_m), (math.sin(direction), y_m)):
        if abs(slope) > _ROUNDING_RAD:
            enter = max(enter, min(bounds[0] / slope, bounds[1] / slope))
    return enter


def _turned(angle: float) -> float:
    """The same direction as an angle from −π to π."""
    return math.remainder(angle, math.tau)
