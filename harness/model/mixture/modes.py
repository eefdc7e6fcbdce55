"""Takes a few normal densities and an interval and returns the highest point of their sum.

The module uses Python's floats, because with a few components arrays would mostly add overhead.
"""

from collections.abc import Sequence
from math import exp
from typing import NamedTuple

_MOST_STEPS = 60
# A component whose peak is below e^-25 of another's moves a mode by less than 1e-9.
_NEGLIGIBLE = 25.0
# A component with a peak of e^-7 adds at most a thousandth to another peak, so no ascent starts
# from it.
_LOW = 7.0
# After one Newton step an ascent has almost its final height. An ascent below this share of the
# highest one therefore cannot exceed it.
_PROMISING = 0.5
# Both numbers are in spreads. Ascents nearer than the first number end at the same peak. A step
# below the second number is the last one, because Newton's method converges quadratically.
_SAME = 0.2
_LAST_STEP = 1e-5
_TINY = 1e-300

Normal = tuple[float, float, float, float]
"""log h, mean, 1/s² and s of the density h · exp(−(x − mean)²/(2 s²))."""


def highest_point(normals: Sequence[Normal], lower: float, upper: float) -> float:
    """Position of the global maximum on [lower, upper] of a sum of normals.

    An ascent starts from every mean, clipped to the interval, because in one dimension these
    ascents reach all peaks of a mixture of normals (Carreira-Perpiñán 2000).
    """
    starts = [min(max(mean, lower), upper) for _, mean, _, _ in normals]
    peaks = [
        log_height - 0.5 * precision * (x - mean) ** 2
        for (log_height, mean, precision, _), x in zip(normals, starts, strict=True)
    ]
    highest = max(peaks)
    some, places = [], []
    for (log_height, mean, precision, spread), x, peak in zip(normals, starts, peaks, strict=True):
        if peak > highest - _NEGLIGIBLE:
            some.append((log_height - highest, mean, precision, spread))
            if peak > highest - _LOW:
                places.append((x, spread))
    if len(some) == 1:
        return places[0][0]
    climbs: list[_Climb] = []
    for x, spread in places:
        x += _newton(some, x, spread)[1]
        x = min(max(x, lower), upper)
        if all(abs(x - other.x) > _SAME * min(spread, other.reach) for other in climbs):
            climbs.append(_Climb(x, spread, *_newton(some, x, spread)))
    high = _PROMISING * max([climb.value for climb in climbs])
    ends = [_top(some, climb, lower, upper) for climb in climbs if climb.value > high]
    return max(ends)[1]


class _Climb(NamedTuple):
    """The position of an ascent, its longest step, the density there, and the next step."""

    x: float
    reach: float
    value: float
    step: float


def _top(normals: list[Normal], climb: _Climb, lower: float, upper: float) -> tuple[float, float]:
    """Height and position of the next peak; a step that would lower the height is quartered."""
    x, reach, best, step = climb
    step = min(max(x + step, lower), upper) - x
    for _ in range(_MOST_STEPS):
        if abs(step) <= _LAST_STEP * reach:
            break
        value, onward = _newton(normals, x + step, reach)
        if value >= best:
            x, best = x + step, value
            step = min(max(x + onward, lower), upper) - x
        else:
            step *= 0.25
    return best, x + step


def _newton(normals: list[Normal], x: float, reach: float) -> tuple[float, float]:
    """The density at x, and Newton's step for its log: uphill and at most ``reach`` long."""
    value, first, second = _TINY, 0.0, 0.0
    for log_height, mean, precision, _ in normals:
        away = mean - x
        slope = precision * away
        term = exp(log_height - 0.5 * slope * away)
        value += term
        first += term * slope
        second += term * (slope * slope - precision)
    slope = first / value
    # If the log density is not concave, the step has the maximum length.
    bend = max(slope * slope - second / value, abs(slope) / reach + _TINY)
    return value, slope / bend
