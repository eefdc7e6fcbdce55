"""Whether obstacles hide a pedestrian, by exact plane geometry in any plane frame."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from harness.core.vocabulary import PEDESTRIAN_RADIUS_M

_ROUNDING_RAD = 1e-12
"""Tolerance of angles: obstacles that touch each other leave no gap."""
_ROUNDING_M = 1e-6
"""Tolerance with which obstacles that are not near a line of sight are left out."""

Point = tuple[float, float]
"""(x, y) in m."""


class Rectangle(NamedTuple):
    """An obstacle in m; its sides are along the frame's axes."""

    x_low_m: float
    x_high_m: float
    y_low_m: float
    y_high_m: float

    def holds(self, point: Point) -> bool:
        """Whether a point is inside the rectangle or on its edge."""
        x_m, y_m = point
        return self.x_low_m <= x_m <= self.x_high_m and self.y_low_m <= y_m <= self.y_high_m


def is_hidden(eye: Point, centre: Point, obstacles: Sequence[Rectangle]) -> bool:
    """Whether obstacles hide the whole disc of a pedestrian from an eye.

    At distance d a disc of radius r covers the angles within asin(r/d) of the direction to its
    centre.  An obstacle in front of it hides the angles between its outermost corners.  The disc is
    hidden if the obstacles together hide all its angles.

    Args:
        eye: the eye.  An obstacle that contains it hides nobody.
        centre: centre of the disc.
        obstacles: the obstacles.

    Example:
        >>> wall = Rectangle(4.0, 5.0, -1.0, 1.0)
        >>> is_hidden((0.0, 0.0), (10.0, 0.0), [wall])
        True
        >>> is_hidden((0.0, 0.0), (3.0, 0.0), [wall])  # before the wall
        False
    """
    ahead, across = centre[0] - eye[0], centre[1] - eye[1]
    distance_m = math.hypot(ahead, across)
    if distance_m <= PEDESTRIAN_RADIUS_M:
        return False
    bearing_rad = math.atan2(across, ahead)
    half_rad = math.asin(PEDESTRIAN_RADIUS_M / distance_m)
    covered = sorted(
        shadow
        for obstacle in obstacles
        if _is_between(eye, centre, obstacle)
        for shadow in _shadows(eye, bearing_rad, distance_m, obstacle)
    )
    reached_rad = -half_rad
    for low_rad, high_rad in covered:
        if low_rad > reached_rad + _ROUNDING_RAD:
            return False
        reached_rad = max(reached_rad, high_rad)
    return reached_rad >= half_rad - _ROUNDING_RAD


def _is_between(eye: Point, centre: Point, obstacle: Rectangle) -> bool:
    """Whether an obstacle may hide part of a disc: it touches the strip from the eye to the disc.

    All lines of sight to the disc lie in a strip as wide as the disc.  The obstacle is beside the
    strip if they are apart along one of the obstacle's axes or across the strip.
    """
    if obstacle.holds(eye):
        return False
    (eye_x, eye_y), (x_m, y_m) = eye, centre
    x_low, x_high, y_low, y_high = obstacle
    reach_m = PEDESTRIAN_RADIUS_M + _ROUNDING_M
    if (
        x_low > max(eye_x, x_m + reach_m)
        or x_high < min(eye_x, x_m - reach_m)
        or y_low > max(eye_y, y_m + reach_m)
        or y_high < min(eye_y, y_m - reach_m)
    ):
        return False
    ahead, across = x_m - eye_x, y_m - eye_y
    # Twice the distances from the strip's middle line, times the length of the strip.
    middle = abs(ahead * (y_low + y_high - 2 * eye_y) - across * (x_low + x_high - 2 * eye_x))
    half = abs(ahead) * (y_high - y_low) + abs(across) * (x_high - x_low)
    return middle - half <= 2 * reach_m * math.hypot(ahead, across)


def _shadows(
    eye: Point, bearing_rad: float, distance_m: float, obstacle: Rectangle
) -> list[tuple[float, float]]:
    """The angles of the disc that an obstacle hides, relative to the direction to its centre."""
    x_low, x_high = (bound - eye[0] for bound in obstacle[:2])
    y_low, y_high = (bound - eye[1] for bound in obstacle[2:])
    mid_rad = math.atan2((y_low + y_high) / 2, (x_low + x_high) / 2)
    # Seen from outside, a rectangle fills less than half a turn.
    edges = [_turned(math.atan2(y, x) - mid_rad) for x in (x_low, x_high) for y in (y_low, y_high)]
    first_rad, last_rad = min(edges), max(edges)
    half_rad = math.asin(PEDESTRIAN_RADIUS_M / distance_m)
    shadows = []
    for turn_rad in (-math.tau, 0.0, math.tau):
        offset_rad = _turned(mid_rad - bearing_rad) + turn_rad
        low_rad = max(offset_rad + first_rad, -half_rad)
        high_rad = min(offset_rad + last_rad, half_rad)
        if high_rad - low_rad <= _ROUNDING_RAD:
            continue
        angle_rad = (low_rad + high_rad) / 2
        # Of two separate convex bodies the same one is nearer along every line of sight.
        to_disc_m = distance_m * math.cos(angle_rad) - math.sqrt(
            max(0.0, PEDESTRIAN_RADIUS_M**2 - (distance_m * math.sin(angle_rad)) ** 2)
        )
        if _entry(bearing_rad + angle_rad, (x_low, x_high), (y_low, y_high)) < to_disc_m:
            shadows.append((low_rad, high_rad))
    return shadows


def _entry(direction_rad: float, x_m: Point, y_m: Point) -> float:
    """Distance from the origin at which a line of sight enters a rectangle that it meets."""
    enter_m = 0.0
    for slope, bounds in ((math.cos(direction_rad), x_m), (math.sin(direction_rad), y_m)):
        if abs(slope) > _ROUNDING_RAD:
            enter_m = max(enter_m, min(bounds[0] / slope, bounds[1] / slope))
    return enter_m


def _turned(angle_rad: float) -> float:
    """The same direction as an angle from −π to π."""
    return math.remainder(angle_rad, math.tau)
