"""When the ego's rectangle first meets a pedestrian's disc: exact, inside steps too.

Seen from the ego (front bumper at 0, body over −length … 0, y across), the pedestrian's centre is
a point and the ego grown by the disc's radius a rounded rectangle: two rectangles and four
circles.  A contact is the first time the point enters it.
"""

import numpy as np

from harness.encounter import PEDESTRIAN_RADIUS_M, FloatArray

_EPSILON_M = 1e-12


def first_contact_in_step(
    x0_m: float,
    speed_mps: float,
    acceleration_mps2: float,
    y0_m: float,
    walking_mps: float,
    duration_s: float,
    body: tuple[float, float, float],
) -> float | None:
    """Time into the step at which contact begins, or None.

    The bumper moves as x0 + v s + a s²/2, the pedestrian stands at x = 0 and walks as y0 + w s.
    Candidates are all roots of the boundary's pieces (at most quartic); the earliest at which
    the distance is within the radius counts.

    Args:
        x0_m: bumper at the start of the step.
        speed_mps: ego's speed then.
        acceleration_mps2: constant over the step.
        y0_m: pedestrian's y then.
        walking_mps: his signed velocity across the road.
        duration_s: length of the step.
        body: (length of the ego, y of its right side, y of its left side) in m.
    """
    length, right, left = body
    radius = PEDESTRIAN_RADIUS_M
    front = np.array([-acceleration_mps2 / 2, -speed_mps, -x0_m])  # pedestrian ahead of bumper
    across = np.array([walking_mps, y0_m])
    pieces = [_shift(front, -radius), _shift(front, length + radius)]
    pieces += [_shift(across, radius - right), _shift(across, -left - radius)]
    for corner_x in (0.0, -length):
        for corner_y in (right, left):
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


def gap(
    ahead_m: FloatArray | float, y_m: FloatArray | float, body: tuple[float, float, float]
) -> FloatArray | float:
    """Distance between the ego's rectangle and the disc's edge in m, negative inside."""
    length, right, left = body
    dx = np.maximum(np.maximum(ahead_m, -length - np.asarray(ahead_m)), 0.0)
    dy = np.maximum(np.maximum(right - np.asarray(y_m), np.asarray(y_m) - left), 0.0)
    distance: FloatArray = np.hypot(dx, dy) - PEDESTRIAN_RADIUS_M
    return distance


def time_to_collision(
    ahead_m: FloatArray,
    y_m: FloatArray,
    speed_mps: FloatArray,
    walking_mps: FloatArray,
    body: tuple[float, float, float],
) -> FloatArray:
    """TTC: time until rectangle and disc meet if both keep their velocities, in s.

    Args:
        ahead_m: pedestrian's distance ahead of the front bumper (negative beside the body).
        y_m: his y.
        speed_mps: the ego's speed.
        walking_mps: his signed velocity across the road.
        body: (length, y of the right side, y of the left side) of the ego in m.

    Returns:
        Array of the same shape, ≥ 0; infinite where they are not on a collision course.
    """
    length, right, left = body
    radius = PEDESTRIAN_RADIUS_M
    with np.errstate(divide="ignore", invalid="ignore"):
        times = [
            _enters_rectangle(
                ahead_m, y_m, -speed_mps, walking_mps, (-length - radius, radius), (right, left)
            ),
            _enters_rectangle(
                ahead_m,
                y_m,
                -speed_mps,
                walking_mps,
                (-length, 0.0),
                (right - radius, left + radius),
            ),
        ]
        for corner_x in (0.0, -length):
            for corner_y in (right, left):
                times.append(
                    _enters_circle(ahead_m - corner_x, y_m - corner_y, -speed_mps, walking_mps)
                )
    result: FloatArray = np.minimum.reduce(times)
    return result


def _enters_rectangle(
    x: FloatArray,
    y: FloatArray,
    vx: FloatArray,
    vy: FloatArray,
    x_bounds: tuple[float, float],
    y_bounds: tuple[float, float],
) -> FloatArray:
    """Slab method; infinite where the ray misses."""
    enter, leave = np.zeros_like(x), np.full_like(x, np.inf)
    for position, velocity, (low, high) in ((x, vx, x_bounds), (y, vy, y_bounds)):
        first, second = (low - position) / velocity, (high - position) / velocity
        still = velocity == 0
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
