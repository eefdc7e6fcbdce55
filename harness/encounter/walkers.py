"""Pedestrians of a running episode: steady, timed or reactive."""

import math
from typing import NamedTuple, Protocol

import numpy as np

from harness.core.vocabulary import (
    PEDESTRIAN_RADIUS_M,
    Arrival,
    Crossing,
    Leg,
    PedestrianView,
    Side,
    Vehicle,
    Walk,
    quick_tuple,
)
from harness.measures.motion.contact import Body, time_to_collision_s
from harness.measures.motion.walking import cleared_s

LOOK_EVERY_S = 1.0
"""Time between two looks of a reactive pedestrian after they stepped off."""


class SeenCar(NamedTuple):
    """The vehicle that a pedestrian sees: range, speed, and its size.

    ``to_lane_m`` is the distance from their kerb to the centre of the vehicle's lane.
    """

    range_m: float
    speed_mps: float
    to_lane_m: float
    vehicle: Vehicle


class ChooseSpeed(Protocol):
    """Chooses the walking speed of a pedestrian from what they see."""

    def __call__(
        self, arrival: Arrival, range_m: float | None, speed_mps: float | None, /
    ) -> float:
        """Walking speed in m/s, > 0, from the vehicle's range and speed; None: there is none."""


def chosen_speed(choose: ChooseSpeed, person: Arrival, seen: SeenCar | None) -> float:
    """The walking speed of a pedestrian who sees a vehicle, or none."""
    return choose(person, None, None) if seen is None else choose(person, *seen[:2])


class Walker:
    """A pedestrian at the crosswalk who steps off and keeps their speed.

    At ``due_s`` the beginning of a step has something to do for them: it is −∞ while they wait, and
    then the time at which they reach the other kerb.  ``look_s`` is the time at which they next
    look at the vehicles; it may lie within a step.
    """

    def __init__(self, arrival: Arrival, crossing: Crossing) -> None:
        self.arrival = arrival
        self.index, self.side = arrival.index, arrival.side
        self.start_s: float | None = None
        self.wanted_mps: float | None = None
        self.seen: SeenCar | None = None
        self.legs: list[Leg] | None = None
        self.due_s, self.look_s = -math.inf, math.inf
        self._start_s, self._base_m, self._speed_mps, self._progress_m = 0.0, 0.0, 0.0, 0.0
        self._length_m = crossing.length_m
        near = self.side is Side.NEAR
        self._kerb_m, self._direction = (0.0, 1.0) if near else (crossing.length_m, -1.0)
        self._to_lane_m = crossing.to_lane_m(self.side)

    def step_off(self, time_s: float, speed_mps: float, seen: SeenCar | None) -> None:
        """Leave the kerb at a speed, having seen a vehicle or none."""
        self._start_s, self._speed_mps = time_s, speed_mps
        self.start_s, self.wanted_mps, self.seen = time_s, speed_mps, seen
        self.due_s = time_s + self._length_m / speed_mps

    def look(self, seen: SeenCar | None) -> None:
        """Decide again at ``look_s``; a steady walker never does."""

    def walk_until(self, time_s: float) -> float:
        """Move on to a time and return y; the speed is 0 while they wait."""
        self._progress_m = self._base_m + self._speed_mps * (time_s - self._start_s)
        if self._progress_m > self._length_m:
            self._progress_m = self._length_m
        return self._kerb_m + self._direction * self._progress_m

    def view(self) -> PedestrianView:
        """The pedestrian as a strategy sees them now."""
        walked_m, speed_mps = self._progress_m, self._speed_mps
        lane_m, rest_m = self._to_lane_m - walked_m, self._length_m - walked_m
        # A path may begin before the kerb.
        on = self.start_s is not None and walked_m >= 0
        return quick_tuple(PedestrianView, (self.index, self.side, lane_m, rest_m, speed_mps, on))

    @property
    def walk(self) -> Walk:
        """Their walk so far."""
        legs = None if self.legs is None else tuple(self.legs)
        range_m, vehicle_mps = self.seen[:2] if self.seen else (None, None)
        return Walk(self.arrival, self.start_s, self.wanted_mps, range_m, vehicle_mps, legs)


class TimedWalker(Walker):
    """A pedestrian who stands at the beginning of a path until its start, then follows it."""

    def __init__(self, arrival: Arrival, crossing: Crossing) -> None:
        super().__init__(arrival, crossing)
        assert arrival.path is not None
        self._crossing, self._path = crossing, arrival.path
        self._leg = 0
        self.look_s, self.due_s = self._path[0].time_s, math.inf
        self._progress_m = self._along(self._path[0].y_m)

    def look(self, seen: SeenCar | None) -> None:
        """Start on the path; the vehicle that they see is recorded and changes nothing."""
        self.start_s, self.legs = self.look_s, list(self._path)
        self.wanted_mps = abs(self._path[-1].y_mps)
        self.seen = seen
        cleared = cleared_s(self.walk, self._crossing)
        self.due_s = math.inf if cleared is None else cleared
        self.walk_until(self.look_s)
        self.look_s = math.inf

    def walk_until(self, time_s: float) -> float:
        """See ``Walker.walk_until``."""
        if self.start_s is not None:
            path, number = self._path, self._leg
            while number + 1 < len(path) and path[number + 1].time_s <= time_s:
                number += 1
            self._leg, leg = number, path[number]
            walked_s = time_s - leg.time_s
            y = leg.y_m + leg.y_mps * walked_s + leg.y_mps2 * walked_s**2 / 2
            self._progress_m = min(self._along(y), self._length_m)
            # A pedestrian who steps back is shown with speed 0.
            self._speed_mps = max(0.0, self._direction * (leg.y_mps + leg.y_mps2 * walked_s))
        return self._kerb_m + self._direction * self._progress_m

    def _along(self, y_m: float) -> float:
        return self._direction * (y_m - self._kerb_m)


class ReactiveWalker(Walker):
    """A pedestrian who looks every second, and then walks at the speed that ``choose`` gives.

    If a vehicle that keeps its speed would hit them at that speed, they stand until they look
    again.  They never stand once their disc has reached the vehicle's path.
    """

    def __init__(self, arrival: Arrival, crossing: Crossing, choose: ChooseSpeed) -> None:
        super().__init__(arrival, crossing)
        self._choose = choose

    def step_off(self, time_s: float, speed_mps: float, seen: SeenCar | None) -> None:
        """See ``Walker.step_off``."""
        super().step_off(time_s, speed_mps, seen)
        self.look_s = time_s + LOOK_EVERY_S
        self._note_leg()

    def look(self, seen: SeenCar | None) -> None:
        """See ``ReactiveWalker``."""
        now = self.look_s
        self.look_s = now + LOOK_EVERY_S
        self.walk_until(now)
        if self._progress_m >= self._length_m:
            self.look_s = math.inf
            return
        speed = chosen_speed(self._choose, self.arrival, seen)
        if seen is not None and self._must_stop(speed, seen):
            speed = 0.0
        if speed == self._speed_mps:
            return
        self._start_s, self._base_m, self._speed_mps = now, self._progress_m, speed
        self.due_s = now + (self._length_m - self._base_m) / speed if speed else math.inf
        self._note_leg()

    def _note_leg(self) -> None:
        y = self._kerb_m + self._direction * self._base_m
        leg = Leg(self._start_s, 0.0, y, 0.0, self._direction * self._speed_mps, 0.0)
        self.legs = [*(self.legs or ()), leg]

    def _must_stop(self, speed_mps: float, seen: SeenCar) -> bool:
        """Whether a vehicle that keeps its speed would touch them if they walked on."""
        half_m = seen.vehicle.width_m / 2
        if seen.to_lane_m - self._progress_m <= half_m + PEDESTRIAN_RADIUS_M:
            return False
        y_m = self._kerb_m + self._direction * self._progress_m
        lane_y_m = self._kerb_m + self._direction * seen.to_lane_m
        course = time_to_collision_s(
            np.array([seen.range_m]),
            np.array([y_m]),
            np.array([-seen.speed_mps]),
            np.array([self._direction * speed_mps]),
            Body(seen.vehicle.length_m, lane_y_m - half_m, lane_y_m + half_m),
        )
        return bool(np.isfinite(course[0]))
