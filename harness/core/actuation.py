"""How a car obeys: commanded accelerations in; its speed after dead time, lag and jerk out.

Within a time of constant command c the acceleration follows a' = (c − a)/lag, cut to ± the jerk.
A car whose speed reaches 0 stands: its acceleration is 0 until a positive command acts on it.
"""

import math
from collections import deque
from itertools import repeat
from typing import NamedTuple

from harness.core.vocabulary import ROUNDING, Vehicle

GRAVITY_MPS2 = 9.80665
"""Standard gravity."""

CUT_MPS = 1e-6
"""The car was given another speed than its response's if they differ by more than this."""


class CarState(NamedTuple):
    """Speed and acceleration of a car at a moment."""

    speed_mps: float
    acceleration_mps2: float


def response(state: CarState, command_mps2: float, duration_s: float, vehicle: Vehicle) -> CarState:
    """The state after a time in which one command acts on the car.

    While the jerk is cut, a(t) = a ± J t.  From \\|c − a\\| = J lag on,
    a(t) = c + (a − c) exp(−t/lag) and v(t) = v + c t + (a − c) lag (1 − exp(−t/lag)).

    Args:
        state: at the beginning.
        command_mps2: c, within the vehicle's limits.
        duration_s: the time, ≥ 0.
        vehicle: has the lag and the jerk.

    >>> late = Vehicle(5.0, 30.0, 30.0, 5.0, 1.8, 3.0, 4.5, 1.0, lag_s=0.5)
    >>> speed, acceleration = response(CarState(5.0, 0.0), -4.0, 0.5, late)
    >>> round(speed, 4), round(acceleration, 4)  # 5 − 4 · 0.5/e and −4 (1 − 1/e)
    (4.2642, -2.5285)
    """
    if state.speed_mps <= 0 and state.acceleration_mps2 < 0:
        state = CarState(0.0, 0.0)
    if command_mps2 > 0 > state.acceleration_mps2:
        stands_s = _stands_after(state, command_mps2, duration_s, vehicle)
        if stands_s is not None:
            state, duration_s = CarState(0.0, 0.0), duration_s - stands_s
    after = _moving(state, command_mps2, duration_s, vehicle)
    return after if after.speed_mps > 0 else CarState(0.0, max(0.0, after.acceleration_mps2))


def _moving(state: CarState, command_mps2: float, time_s: float, vehicle: Vehicle) -> CarState:
    """The state after a time, with speeds below 0 if it brakes for longer than until it stands."""
    (speed, acceleration), lag_s, jerk = state, vehicle.lag_s, vehicle.max_jerk_mps3
    gap = command_mps2 - acceleration
    if jerk is not None and abs(gap) > jerk * lag_s:
        ramp_s = min(time_s, abs(gap) / jerk - lag_s)
        rate = math.copysign(jerk, gap)
        speed += acceleration * ramp_s + rate * ramp_s**2 / 2
        acceleration += rate * ramp_s
        if ramp_s == time_s:
            return CarState(speed, acceleration)
        time_s -= ramp_s
        gap = command_mps2 - acceleration
    grown = -math.expm1(-time_s / lag_s) if lag_s > 0 else 1.0
    speed += command_mps2 * time_s - gap * lag_s * grown
    return CarState(speed, command_mps2 - gap * (1.0 - grown))


def _stands_after(
    state: CarState, command_mps2: float, duration_s: float, vehicle: Vehicle
) -> float | None:
    """When a braking car stands although it is told to drive; None if not in this time.

    The acceleration grows, so v(t) is convex and Newton's steps approach its first root from below.
    """
    time_s = 0.0
    while True:
        speed, acceleration = _moving(state, command_mps2, time_s, vehicle)
        if acceleration >= 0:
            return None
        further_s = speed / -acceleration
        time_s += further_s
        if time_s >= duration_s:
            return None
        if further_s < ROUNDING**2 or further_s < time_s * 1e-15:
            return time_s


class Actuator:
    """The actuation of one car, which is given a command at every step.

    Args:
        vehicle: has the limits, the dead time, the lag and the jerk.
        step_s: the length of a step.
        speed_mps, acceleration_mps2: the car's state now.
        command_mps2: the command that it has obeyed so far, within its limits.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        step_s: float,
        speed_mps: float,
        acceleration_mps2: float = 0.0,
        command_mps2: float = 0.0,
    ) -> None:
        self._vehicle, self._step_s, self._at_once = vehicle, step_s, vehicle.obeys_at_once
        self._state, self._before_mps = CarState(speed_mps, acceleration_mps2), speed_mps
        whole = math.floor(vehicle.dead_time_s / step_s + ROUNDING)
        rest_s = vehicle.dead_time_s - whole * step_s
        self._rest_s = rest_s if rest_s > ROUNDING else 0.0
        self._waiting = deque(repeat(command_mps2, whole + (self._rest_s > 0)))

    def speed_after(self, command_mps2: float, speed_mps: float) -> float:
        """The speed at the end of the next step.

        Args:
            command_mps2: what is commanded now, within the limits; it acts after the dead time.
            speed_mps: the car's speed now.  If SUMO cut the last command, it is not that of the
                response, and the car's acceleration was that of the cut.
        """
        if self._at_once:
            speed_mps += command_mps2 * self._step_s
            return speed_mps if speed_mps > 0 else 0.0
        if abs(speed_mps - self._state.speed_mps) > CUT_MPS:
            gain = (speed_mps - self._before_mps) / self._step_s
            self._state = CarState(speed_mps, gain)
        self._before_mps = speed_mps
        self._waiting.append(command_mps2)
        state, vehicle = self._state, self._vehicle
        if self._rest_s:
            state = response(state, self._waiting.popleft(), self._rest_s, vehicle)
            command = self._waiting[0]
        else:
            command = self._waiting.popleft()
        self._state = response(state, command, self._step_s - self._rest_s, vehicle)
        return self._state.speed_mps
