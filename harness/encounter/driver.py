"""What a vehicle's driver observes at a step, and their command within the vehicle's limits, out.

The step is the same in encounters, simulations, reinforcement learning, validation and checks of
strategies.  The limits are those of ``core.vocabulary.Vehicle``.  How the vehicle obeys the command
is ``core.actuation.Actuator``.
"""

import math
from collections.abc import Callable
from numbers import Real
from typing import Protocol

from harness.core.errors import StrategyError, place_of
from harness.core.vocabulary import (
    ROUNDING,
    Crossing,
    EgoView,
    Observation,
    PedestrianView,
    Strategy,
    Vehicle,
    Views,
    quick_tuple,
)


class Way(Protocol):
    """A vehicle's way over one crosswalk: the constants of both, which may change on the way."""

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle's constants."""

    @property
    def crossing(self) -> Crossing:
        """The crosswalk's constants."""


class Driver:
    """The driver of one vehicle at one crosswalk; to be used at every step.

    Args:
        way: the vehicle and the crosswalk.
        step_s: the simulation's step.
        truth: returns everybody at the crosswalk.
        sensor: returns whom the driver's sensor shows now, given whether the vehicle is within its
            detection range; None: they see the truth within that range.
    """

    def __init__(
        self,
        way: Way,
        step_s: float,
        truth: Callable[[], Views],
        sensor: Callable[[bool], Views] | None = None,
    ) -> None:
        self._way, self._step_s = way, step_s
        self._truth, self._sensor = truth, sensor
        vehicle = way.vehicle
        self._detection_m = vehicle.detection_range_m + ROUNDING
        self._least_mps2 = -vehicle.max_deceleration_mps2
        self._most_mps2 = vehicle.max_acceleration_mps2
        self._shown: list[Views] = []
        self._numbers: dict[int, int] = {}
        self._unchanged: set[int] = set()  # whose number is their index

    @property
    def shown(self) -> tuple[Views, ...] | None:
        """What their sensor has shown at each step, by planned index; None: they see the truth."""
        return None if self._sensor is None else tuple(self._shown)

    def observe(
        self, time_s: float, range_m: float, speed_mps: float, acceleration_mps2: float
    ) -> Observation:
        """The observation of this step, from the time since the trigger and the vehicle's state."""
        way = self._way
        near = -self._detection_m <= range_m <= self._detection_m
        if self._sensor is None:
            seen = self._truth() if near else ()
        else:
            seen = self._sensor(near)
            self._shown.append(seen)
        for view in seen:
            if view[0] not in self._unchanged:
                seen = self._numbered(seen)
                break
        ego = quick_tuple(EgoView, (range_m, speed_mps, acceleration_mps2))
        return quick_tuple(
            Observation, (time_s, self._step_s, ego, way.vehicle, way.crossing, seen)
        )

    def _numbered(self, seen: Views) -> Views:
        """These people by the order in which this driver first saw them.

        Their planned indices would tell of people who are hidden or have not come yet.
        """
        numbers, told = self._numbers, []
        for view in seen:
            number = numbers.setdefault(view.index, len(numbers))
            if number == view.index:
                self._unchanged.add(number)
                told.append(view)
            else:
                told.append(quick_tuple(PedestrianView, (number, *view[1:])))
        return tuple(told)

    def command(self, answer: object, time_s: float) -> float:
        """A strategy's answer as a command in m/s², within the vehicle's limits.

        Raises:
            StrategyError: the answer is not a finite number.
        """
        wanted = answer if type(answer) is float else _as_float(answer)
        if self._least_mps2 <= wanted <= self._most_mps2:
            return wanted
        if math.isfinite(wanted):
            return self._way.vehicle.within_limits(wanted)
        raise StrategyError(f"the strategy returned {answer!r} at t = {time_s:.3f} s")


def answer_of(strategy: Strategy, observation: Observation) -> object:
    """What a strategy answers to an observation.

    Raises:
        StrategyError: the strategy raised an exception.
    """
    try:
        return strategy.decide(observation)
    except (Exception, SystemExit) as error:
        when = f"at t = {observation.time_s:.3f} s ({place_of(error)})"
        what = f"the strategy raised {type(error).__name__}: {error} {when}"
        raise StrategyError(what, error) from error


def attribute_of(strategy: Strategy, name: str) -> object:
    """An attribute that a strategy may have; None: it has none.

    Raises:
        StrategyError: the strategy raised an exception.
    """
    try:
        return getattr(strategy, name, None)
    except (Exception, SystemExit) as error:
        what = f"its {name} raised {type(error).__name__}: {error} ({place_of(error)})"
        raise StrategyError(what, error) from error


def _as_float(answer: object) -> float:
    """A command of another numeric type, such as NumPy's; NaN if it is no number or too large."""
    if not isinstance(answer, Real) or isinstance(answer, bool):
        return math.nan
    try:
        return float(answer)
    except OverflowError:
        return math.nan
