"""The decisions of a step: the limits of a strategy's command, and the kerb rule."""

import math
from numbers import Real

from harness.core.encounter import Vehicle
from harness.core.errors import StrategyError, place_of

ROUNDING_M = 1e-9
"""Tolerance of thresholds: engines differ in the last bits of their sums."""


def limited(answer: object, vehicle: Vehicle, time_s: float) -> float:
    """A strategy's command in m/s², within the vehicle's limits.

    Raises:
        StrategyError: the command is not a finite number.
    """
    wanted = answer if type(answer) is float else _as_float(answer)
    least, most = -vehicle.max_deceleration_mps2, vehicle.max_acceleration_mps2
    if least <= wanted <= most:
        return wanted
    if math.isfinite(wanted):
        return max(least, min(wanted, most))
    raise StrategyError(f"the strategy returned {answer!r} at t = {time_s:.3f} s")


def strategy_raised(error: BaseException, time_s: float) -> StrategyError:
    """The error for a strategy that raised an exception in ``decide``."""
    what = f"raised {type(error).__name__}: {error}"
    when = f"at t = {time_s:.3f} s ({place_of(error)})"
    return StrategyError(f"the strategy {what} {when}", error)


def keeps_waiting(
    to_edge_m: float, speed_mps: float, acceleration_mps2: float, wait_s: float
) -> bool:
    """The kerb rule: whether a pedestrian waits for this vehicle.

    They wait while the vehicle is on the crosswalk.  They also wait while its front, at its present
    speed, would reach the near edge within ``wait_s``, unless it stands, or stops before the edge
    at its present deceleration.  The near edge is ``to_edge_m`` ahead of the front; the distance is
    negative once the front is past it.
    """
    if to_edge_m <= ROUNDING_M:
        return True
    if to_edge_m > speed_mps * wait_s + ROUNDING_M:
        return False
    return speed_mps**2 > -2 * acceleration_mps2 * (to_edge_m + ROUNDING_M)


def _as_float(answer: object) -> float:
    """A command of another numeric type, such as NumPy's; NaN if it is no number or too large."""
    if not isinstance(answer, Real) or isinstance(answer, bool):
        return math.nan
    try:
        return float(answer)
    except OverflowError:
        return math.nan
