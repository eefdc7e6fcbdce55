"""The first contact of the ego's rectangle with a pedestrian's disc, exact within steps too.

In the ego's frame (front bumper at 0, body over −length … 0, y across) the pedestrian is a point,
and the ego enlarged by the disc's radius is a rounded rectangle: two rectangles and four circles.
A contact begins when the point enters it.
"""

import math
from typing import NamedTuple

import numpy as np

from harness.core.vocabulary import PEDESTRIAN_RADIUS_M, ROUNDING, FloatArray

_EPSILON_M = 1e-12
"""Rounding of a gap of 0, besides that of a root."""
_MARGIN_M = 1e-6
"""Rounding of a path, within which a piece of the boundary may have a root."""
_REAL_S = 1e-7
"""A root with a smaller imaginary part counts as real: rounding splits double roots."""


class Motion(NamedTuple):
    """A coordinate during a step: its initial position and speed, and its constant acceleration."""

    place_m: float
    speed_mps: float
    acceleration_mps2: float = 0.0

    def at(self, time_s: float) -> float:
        """The position after a time."""
        return self.place_m + self.speed_mps * time_s + self.acceleration_mps2 * time_s**2 / 2

    def after(self, time_s: float) -> "Motion":
        """The motion that goes on after a time."""
        speed = self.speed_mps + self.acceleration_mps2 * time_s
        return Motion(self.at(time_s), speed, self.acceleration_mps2)


class Body(NamedTuple):
    """The ego's rectangle: its length, and y of its right and its left side."""

    length_m: float
    right_m: float
    left_m: float


def first_contact_in_step_s(
    ego: Motion, walker_x: Motion, walker_y: Motion, duration_s: float, body: Body
) -> float | None:
    """Time into the step at which contact begins, or None.

    Candidates are the roots of all pieces of the boundary (at most quartic).  The result is the
    earliest root at which the distance is within the radius.

    Args:
        ego: motion of the front bumper, along the road.
        walker_x: motion of the pedestrian along the road, without acceleration.
        walker_y: motion of the pedestrian across the road.
        duration_s: length of the step.
        body: the ego's rectangle.
    """
    length, right, left = body
    radius = PEDESTRIAN_RADIUS_M
    front = Motion(  # pedestrian ahead of bumper
        walker_x.place_m - ego.place_m, walker_x.speed_mps - ego.speed_mps, -ego.acceleration_mps2
    )
    ahead_range, across_range = _range(front, duration_s), _range(walker_y, duration_s)
    # Only pieces near the path can have a root; finding roots is expensive.
    candidates = [0.0]
    for path, span, edges in (
        (front, ahead_range, (radius, -length - radius)),
        (walker_y, across_range, (right - radius, left + radius)),
    ):
        for edge in edges:
            if _near(span, edge, 0.0):
                candidates += _times_at(path, edge)
    for corner_x_m in (0.0, -length):
        for corner_y_m in (right, left):
            if _near(ahead_range, corner_x_m, radius) and _near(across_range, corner_y_m, radius):
                candidates += _times_at_circle(front, walker_y, corner_x_m, corner_y_m)
    for time in sorted(candidates):
        if not 0 <= time <= duration_s:
            continue
        y = walker_y.at(time)
        # A root is accurate to about ROUNDING; grazing counts as a contact.
        if gap_m(front.at(time), y, body) <= ROUNDING * max(1.0, abs(y)) + _EPSILON_M:
            return time
    return None


def _times_at(path: Motion, edge_m: float) -> tuple[float, ...]:
    """The times at which a coordinate reaches an edge; a miss within rounding counts."""
    square, slope, constant = path.acceleration_mps2 / 2, path.speed_mps, path.place_m - edge_m
    if square == 0:
        return () if slope == 0 else (-constant / slope,)
    discriminant = slope * slope - 4 * square * constant
    if discriminant < 0:
        touches = math.sqrt(-discriminant) < 2 * abs(square) * _REAL_S
        return (-slope / (2 * square),) if touches else ()
    # The sum of terms of equal sign loses no digits; the other root follows from it.
    larger = -(slope + math.copysign(math.sqrt(discriminant), slope)) / 2
    return (larger / square, constant / larger) if larger != 0 else ()  # from the start on


def _times_at_circle(
    ahead: Motion, across: Motion, corner_x_m: float, corner_y_m: float
) -> list[float]:
    """The times at which a moving point is on the circle with the disc's radius around a corner."""
    dx = (ahead.acceleration_mps2 / 2, ahead.speed_mps, ahead.place_m - corner_x_m)
    dy = (across.acceleration_mps2 / 2, across.speed_mps, across.place_m - corner_y_m)
    circle = np.convolve(dx, dx) + np.convolve(dy, dy)
    circle[-1] -= PEDESTRIAN_RADIUS_M**2
    roots = np.roots(circle)
    times: list[float] = roots.real[np.abs(roots.imag) < _REAL_S].tolist()
    return times


def _range(path: Motion, duration_s: float) -> tuple[float, float]:
    """Smallest and largest position over 0 … duration."""
    values = [path.place_m, path.at(duration_s)]
    if path.acceleration_mps2 != 0:
        values.append(path.at(min(max(-path.speed_mps / path.acceleration_mps2, 0.0), duration_s)))
    return min(values), max(values)


def _near(span: tuple[float, float], place_m: float, reach_m: float) -> bool:
    """Whether a range of positions is within reach of a position, with a margin for rounding."""
    reach_m += _MARGIN_M
    return span[0] - reach_m <= place_m <= span[1] + reach_m


def gap_m(ahead_m: FloatArray | float, y_m: FloatArray | float, body: Body) -> FloatArray:
    """Distance between the ego's rectangle and the disc's edge in m, negative inside."""
    length, right, left = body
    dx = np.maximum(np.maximum(ahead_m, -length - np.asarray(ahead_m)), 0.0)
    dy = np.maximum(np.maximum(right - np.asarray(y_m), np.asarray(y_m) - left), 0.0)
    distance: FloatArray = np.hypot(dx, dy) - PEDESTRIAN_RADIUS_M
    return distance


def time_to_collision_s(
    ahead_m: FloatArray, y_m: FloatArray, ahead_mps: FloatArray, y_mps: FloatArray, body: Body
) -> FloatArray:
    """TTC: time until rectangle and disc meet if both keep their velocities, in s.

    Args:
        ahead_m: pedestrian's distance ahead of the front bumper (negative at or behind it).
        y_m: the pedestrian's y.
        ahead_mps: the pedestrian's velocity along the road minus the ego's speed.
        y_mps: the pedestrian's velocity across the road.
        body: the ego's rectangle.

    Returns:
        Array of the same shape, ≥ 0; infinite where they are not on a collision course.
    """
    length, right, left = body
    radius = PEDESTRIAN_RADIUS_M
    with np.errstate(divide="ignore", invalid="ignore"):
        times = [
            _enters_rectangle(
                (ahead_m, y_m), (ahead_mps, y_mps), (-length - radius, radius), (right, left)
            ),
            _enters_rectangle(
                (ahead_m, y_m), (ahead_mps, y_mps), (-length, 0.0), (right - radius, left + radius)
            ),
        ]
        for corner_x_m in (0.0, -length):
            for corner_y_m in (right, left):
                place = ahead_m - corner_x_m, y_m - corner_y_m
                times.append(_enters_circle(*place, ahead_mps, y_mps))
    result: FloatArray = np.minimum.reduce(times)
    return result


def _enters_rectangle(
    place: tuple[FloatArray, FloatArray],
    velocity: tuple[FloatArray, FloatArray],
    x_bounds: tuple[float, float],
    y_bounds: tuple[float, float],
) -> FloatArray:
    """First time ≥ 0 in the rectangle, by the slab method; infinite if never."""
    enter, leave = np.zeros_like(place[0]), np.full_like(place[0], np.inf)
    for position, speed, (low, high) in zip(place, velocity, (x_bounds, y_bounds), strict=True):
        first, second = (low - position) / speed, (high - position) / speed
        still = speed == 0
        outside = still & ((position < low) | (position > high))
        near = np.where(still, np.where(outside, np.inf, -np.inf), np.minimum(first, second))
        far = np.where(still, np.inf, np.maximum(first, second))
        enter, leave = np.maximum(enter, near), np.minimum(leave, far)
    return np.where(enter <= leave, enter, np.inf)


def _enters_circle(
    x_m: FloatArray, y_m: FloatArray, x_mps: FloatArray, y_mps: FloatArray
) -> FloatArray:
    """First time ≥ 0 at which the point is within the radius of the origin; infinite if never."""
    a = x_mps * x_mps + y_mps * y_mps
    b = x_m * x_mps + y_m * y_mps
    c = x_m * x_m + y_m * y_m - PEDESTRIAN_RADIUS_M**2
    discriminant = b * b - a * c
    time = (-b - np.sqrt(discriminant)) / a
    hit = (discriminant >= 0) & (a > 0) & (time >= 0)
    return np.where(c <= 0, 0.0, np.where(hit, time, np.inf))
