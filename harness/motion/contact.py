"""When the ego's rectangle first meets a pedestrian's disc: exact, inside steps too.

Seen from the ego (front bumper at 0, body over −length … 0, y across), the pedestrian's centre is
a point and the ego grown by the disc's radius a rounded rectangle: two rectangles and four
circles.  A contact is the first time the point enters it.
"""

from typing import NamedTuple

import numpy as np

from harness.encounter import PEDESTRIAN_RADIUS_M, FloatArray

_EPSILON_M = 1e-12
_MARGIN_M = 1e-6


class Motion(NamedTuple):
    """A coordinate over a step: place and speed at its beginning, constant acceleration."""

    place_m: float
    speed_mps: float
    acceleration_mps2: float = 0.0

    def at(self, time_s: float) -> float:
        """The place after that time."""
        return self.place_m + self.speed_mps * time_s + self.acceleration_mps2 * time_s**2 / 2


def first_contact_in_step(
    ego: Motion,
    walker_x: Motion,
    walker_y: Motion,
    duration_s: float,
    body: tuple[float, float, float],
) -> float | None:
    """Time into the step at which contact begins, or None.

    Candidates are all roots of the boundary's pieces (at most quartic); the earliest at which
    the distance is within the radius counts.

    Args:
        ego: of the front bumper, along the road.
        walker_x: the pedestrian along the road, without acceleration.
        walker_y: across it.
        duration_s: length of the step.
        body: (length of the ego, y of its right side, y of its left side) in m.
    """
    length, right, left = body
    radius = PEDESTRIAN_RADIUS_M
    front = np.array(  # pedestrian ahead of bumper
        [
            -ego.acceleration_mps2 / 2,
            walker_x.speed_mps - ego.speed_mps,
            walker_x.place_m - ego.place_m,
        ]
    )
    across = np.array([walker_y.acceleration_mps2 / 2, walker_y.speed_mps, walker_y.place_m])
    ahead_range, across_range = _range(front, duration_s), _range(across, duration_s)
    # Only pieces that the path comes near can have a root; finding roots is what costs.
    pieces = [
        _shift(path, -edge)
        for path, span, edges in (
            (front, ahead_range, (radius, -length - radius)),
            (across, across_range, (right - radius, left + radius)),
        )
        for edge in edges
        if _near(span, edge, 0.0)
    ]
    for corner_x in (0.0, -length):
        for corner_y in (right, left):
            if _near(ahead_range, corner_x, radius) and _near(across_range, corner_y, radius):
                dx, dy = _shift(front, -corner_x), _shift(across, -corner_y)
                circle = np.polyadd(np.polymul(dx, dx), np.polymul(dy, dy))
                pieces.append(_shift(circle, -(radius**2)))
    candidates = [0.0]
    for piece in pieces:
        roots = np.roots(piece)
        real = roots.real[np.abs(roots.imag) < 1e-7]
        candidates += [float(t) for t in real if 0 <= t <= duration_s]
    for time in sorted(candidates):
        ahead, y = float(np.polyval(front, time)), float(np.polyval(across, time))
        # A root is found to about 1e-9; a grazing one counts as contact.
        if gap(ahead, y, body) <= 1e-9 * max(1.0, abs(y)) + _EPSILON_M:
            return time
    return None


def _range(polynomial: FloatArray, duration_s: float) -> tuple[float, float]:
    """Smallest and largest value of a polynomial, quadratic at most, over 0 … duration."""
    square, slope, constant = np.concatenate((np.zeros(3 - len(polynomial)), polynomial)).tolist()
    times = [0.0, duration_s]
    if square != 0:
        times.append(min(max(-slope / (2 * square), 0.0), duration_s))
    values = [(square * time + slope) * time + constant for time in times]
    return min(values), max(values)


def _near(span: tuple[float, float], place_m: float, reach_m: float) -> bool:
    """Whether a range of places comes within reach of one, rounding included."""
    reach_m += _MARGIN_M
    return span[0] - reach_m <= place_m <= span[1] + reach_m


def gap(
    ahead_m: FloatArray | float, y_m: FloatArray | float, body: tuple[float, float, float]
) -> FloatArray:
    """Distance between the ego's rectangle and the disc's edge in m, negative inside."""
    length, right, left = body
    dx = np.maximum(np.maximum(ahead_m, -length - np.asarray(ahead_m)), 0.0)
    dy = np.maximum(np.maximum(right - np.asarray(y_m), np.asarray(y_m) - left), 0.0)
    distance: FloatArray = np.hypot(dx, dy) - PEDESTRIAN_RADIUS_M
    return distance


def time_to_collision(
    ahead_m: FloatArray,
    y_m: FloatArray,
    ahead_mps: FloatArray,
    y_mps: FloatArray,
    body: tuple[float, float, float],
) -> FloatArray:
    """TTC: time until rectangle and disc meet if both keep their velocities, in s.

    Args:
        ahead_m: pedestrian's distance ahead of the front bumper (negative beside the body).
        y_m: the pedestrian's y.
        ahead_mps: rate of ``ahead_m``: their velocity along the road less the ego's speed.
        y_mps: their velocity across the road.
        body: (length, y of the right side, y of the left side) of the ego in m.

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
                (ahead_m, y_m),
                (ahead_mps, y_mps),
                (-length, 0.0),
                (right - radius, left + radius),
            ),
        ]
        for corner_x in (0.0, -length):
            for corner_y in (right, left):
                times.append(_enters_circle(ahead_m - corner_x, y_m - corner_y, ahead_mps, y_mps))
    result: FloatArray = np.minimum.reduce(times)
    return result


def _enters_rectangle(
    place: tuple[FloatArray, FloatArray],
    velocity: tuple[FloatArray, FloatArray],
    x_bounds: tuple[float, float],
    y_bounds: tuple[float, float],
) -> FloatArray:
    """Slab method; infinite where the ray misses."""
    enter, leave = np.zeros_like(place[0]), np.full_like(place[0], np.inf)
    for position, speed, (low, high) in zip(place, velocity, (x_bounds, y_bounds), strict=True):
        first, second = (low - position) / speed, (high - position) / speed
        still = speed == 0
        outside = still & ((position < low) | (position > high))
        near = np.where(still, np.where(outside, np.inf, -np.inf), np.minimum(first, second))
        far = np.where(still, np.inf, np.maximum(first, second))
        enter, leave = np.maximum(enter, near), np.minimum(leave, far)
    return np.where(enter <= leave, enter, np.inf)


def _enters_circle(x: FloatArray, y: FloatArray, vx: FloatArray, vy: FloatArray) -> FloatArray:
    """First time ≥ 0 at which the point is within the radius of the origin; infinite if never."""
    a = vx * vx + vy * vy
    b = x * vx + y * vy
    c = x * x + y * y - PEDESTRIAN_RADIUS_M**2
    discriminant = b * b - a * c
    time = (-b - np.sqrt(discriminant)) / a
    hit = (discriminant >= 0) & (a > 0) & (time >= 0)
    return np.where(c <= 0, 0.0, np.where(hit, time, np.inf))


def _shift(polynomial: FloatArray, constant: float) -> FloatArray:
    shifted = polynomial.copy()
    shifted[-1] += constant
    return shifted
