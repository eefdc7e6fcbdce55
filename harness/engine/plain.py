"""The plain engine: SUMO's kinematics in a few lines of Python.

It tests strategies, episodes and measures in milliseconds, and tests compare SUMO with it.
It detects no collisions.
"""

import math
from collections.abc import Sequence

from harness.core.vocabulary import Arrival, Vehicle

_LEADER_M = 1.0
"""A leader holds a vehicle if the gap is at most this much longer than the one that SUMO keeps."""


class PlainEngine:
    """Ballistic motion: constant acceleration within a step.

    Args:
        vehicle: the ego.
        step_s: length of a step.
    """

    def __init__(self, vehicle: Vehicle, step_s: float) -> None:
        self._start = (-vehicle.trigger_range_m, vehicle.initial_speed_mps)
        self._step_s, self.closed = step_s, False
        self._x_m, self._speed_mps = self._start

    def begin(self, arrivals: Sequence[Arrival]) -> tuple[float, float]:  # noqa: ARG002
        """See ``Engine.begin``."""
        self._x_m, self._speed_mps = self._start
        return self._start

    def step(
        self,
        speed_mps: float,
        pedestrians: Sequence[tuple[int, float]],  # noqa: ARG002
    ) -> float:
        """See ``Engine.step``."""
        self._x_m += (self._speed_mps + speed_mps) / 2 * self._step_s
        self._speed_mps = speed_mps
        return self._x_m

    def remove(self, index: int) -> None:
        """See ``Engine.remove``; this engine keeps no pedestrians."""

    def end(self) -> bool | None:
        """None, because this engine detects no collisions."""
        return None

    def close(self) -> None:
        """See ``Engine.close``; there is nothing to release."""
        self.closed = True


def followed_m(
    ahead_mps: float, speed_mps: float, decel_mps2: float, tau_s: float, step_s: float
) -> float:
    """The longest gap to a leader, without minGap, within which the leader holds a vehicle.

    It is the distance that SUMO's Krauss driver keeps, and a metre.

    Args:
        ahead_mps: the leader's speed.
        speed_mps: the vehicle's speed before the step.
        decel_mps2: the greatest deceleration of both.
        tau_s: the time headway that the vehicle keeps.
        step_s: the length of a step.
    """
    stops_m = speed_mps * (tau_s + step_s + speed_mps / (2 * decel_mps2))
    return max(stops_m - ahead_mps**2 / (2 * decel_mps2), 0.0) + _LEADER_M


def slowing_mps(
    speed_mps: float,
    limit_mps: float,
    ahead_m: float,
    decel_mps2: float,
    step_s: float,
    ballistic: bool,
) -> float:
    """The highest speed at the step's end from which a vehicle has a limit when it begins.

    This is SUMO's own ``freeSpeed``.  With constant acceleration within steps, the new speed v
    solves (speed + v) t/2 + (v² − limit²)/2b = distance.  In Euler's steps, the vehicle slows by
    b t in each of y steps and drives the last one at the limit.

    Args:
        speed_mps: its speed now.
        limit_mps: the limit ahead.
        ahead_m: the distance to where it begins, > 0.
        decel_mps2: b.
        step_s: t.
        ballistic: whether the acceleration is constant within a step.
    """
    if ballistic:
        if (speed_mps + limit_mps) * step_s / 2 >= ahead_m:
            return limit_mps
        half = decel_mps2 * step_s / 2
        room = limit_mps**2 + (2 * ahead_m - step_s * speed_mps) * decel_mps2
        return math.sqrt(half**2 + room) - half
    last_m, b = limit_mps * step_s, decel_mps2 * step_s**2
    if ahead_m < last_m:
        return limit_mps
    root = math.sqrt((b + 2 * last_m) ** 2 + 8 * b * ahead_m)
    y = max(0.0, ((root - b) / 2 - last_m) / b)
    whole = math.floor(y)
    exact_m = (whole * whole + whole) / 2 * b + whole * last_m + (last_m if y > whole else 0.0)
    rest_mps = max(0.0, ahead_m - exact_m) / (whole + 1) / step_s
    return rest_mps + whole * decel_mps2 * step_s + limit_mps
