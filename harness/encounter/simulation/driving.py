"""Vehicles on their ways over chosen crosswalks, and the strategies that drive them."""

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from harness.core.actuation import Actuator
from harness.core.encounter import (
    EgoView,
    Observation,
    PedestrianView,
    Strategy,
    Vehicle,
    quick_tuple,
)
from harness.core.errors import StrategyError
from harness.encounter.deciding import ROUNDING_M, limited, strategy_raised
from harness.site.simulation import DrivenWay
from harness.strategies.perception.sensor import Sensor
from harness.strategies.perception.updates import Updates, Views

SPEED_MODE_MID_BLOCK = 23
"""SUMO keeps the distance, the limits of the vehicle and red lights; it yields to nobody."""
SPEED_MODE_JUNCTION = 31
"""SUMO's own driver's mode: SUMO also yields to vehicles, and slows down for the junction."""
NO_LANE_CHANGE = 512
"""The vehicle makes no lane changes by itself; requested ones are still made, safely."""
IGNORED_TYPES = "junctionModel.ignoreTypes"

CUT_MPS = 1e-3
"""SUMO has cut a command if the speed differs from it by more than this."""


@dataclass(slots=True, eq=False)
class PassageLog:
    """One vehicle on its way over one crosswalk, from R0 until its rear has left.

    Attributes:
        name: SUMO's id of the vehicle.
        type_id: its vType.
        driven_way: its way.
        vehicle: its constants; v0 is the speed of a free passage.
        automated: whether it is an AV in the AV's arm; the same value in the reference's arm.
        strategy_name: name of the strategy that drives; ``sumo`` if none may drive.
        not_driven: why no strategy may drive it, or None.
        offset_m: x of the front bumper minus SUMO's odometer.
        strategy: the driver, or None.
        time_s, x_m, speed_mps: the states at every step.
        commands: number of commands; ``cut``: number of these commands that SUMO did not follow.
        ended: ``passed``, or why the passage broke off.
        collided: whether SUMO reports a collision with a person there.
        stood_s, with_people_s: time for which it has stood at the crosswalk without a break, and
            for which somebody who wants to cross has stood there as well.
        fallback: the strategy's ``fallback`` (``Strategy``).
        astray: why it cannot be measured on the lane to which it has changed, or None.
        sensor, updates: the driver's sensor and its updates; None: the driver sees the truth.
        shown: what the driver was shown at each step, with a sensor.
    """

    name: str
    type_id: str
    driven_way: DrivenWay
    vehicle: Vehicle
    automated: bool
    strategy_name: str
    not_driven: str | None
    offset_m: float
    strategy: Strategy | None = None
    # Unlike lists, arrays take no time of the garbage collector.
    time_s: "array[float]" = field(default_factory=lambda: array("d"))
    x_m: "array[float]" = field(default_factory=lambda: array("d"))
    speed_mps: "array[float]" = field(default_factory=lambda: array("d"))
    commands: int = 0
    cut: int = 0
    ended: str | None = None
    collided: bool = False
    stood_s: float = 0.0
    with_people_s: float = 0.0
    fallback: bool = False
    astray: str | None = None
    sensor: Sensor | None = None
    updates: Updates | None = None
    shown: list[Views] | None = None

    def note(self, time_s: float, x_m: float, speed_mps: float) -> None:
        """Note the state at the end of a step."""
        self.time_s.append(time_s)
        self.x_m.append(x_m)
        self.speed_mps.append(speed_mps)

    def move_to(self, driven_way: DrivenWay, shift_m: float) -> None:
        """Measure the whole passage on another way, on which every x is greater by ``shift_m``."""
        self.driven_way = driven_way
        self.offset_m += shift_m
        self.x_m = array("d", (x_m + shift_m for x_m in self.x_m))

    @property
    def rear_left_m(self) -> float:
        """x of the front bumper at which the rear has left the crosswalk."""
        return self.vehicle.length_m + self.driven_way.way.crossing.width_m / 2 - ROUNDING_M


@dataclass(slots=True)
class _Kept:
    """A vehicle's own values, which are restored after control."""

    speed_mode: int
    lane_change_mode: int
    ignored_types: str


class Control:
    """The vehicles that strategies drive at present.

    A vehicle may be on its way over several crosswalks at once.  Then it has a strategy object for
    each, and the lowest command applies.

    Args:
        api: the running simulation.
        set_speed: SUMO's ``vehicle.setSpeed``.
        step_s: the length of a step.
        detection_m: distance within which the vehicles see people.
        views: returns the people whom a passage's driver sees; with whether the vehicle is within
            its detection range.
    """

    def __init__(
        self,
        api: Any,
        set_speed: Callable[[str, float], None],
        step_s: float,
        detection_m: float,
        views: Callable[[PassageLog, bool], Sequence[PedestrianView]],
    ) -> None:
        self._vehicle, self._set_speed, self._step_s = api.vehicle, set_speed, step_s
        self._detection_m, self._views = detection_m + ROUNDING_M, views
        self._passages: dict[str, list[PassageLog]] = {}
        self._kept: dict[str, _Kept] = {}
        self._asked: dict[str, float] = {}
        self._sent: dict[str, float] = {}
        self._actuators: dict[str, Actuator] = {}
        self._types: set[str] = set()

    def ignore(self, person_type: str) -> None:
        """Let SUMO ignore people of a type for driven vehicles; the strategy reacts to them."""
        if person_type in self._types:
            return
        self._types.add(person_type)
        for name in self._kept:
            self._ignore_types(name)

    def _ignore_types(self, name: str) -> None:
        types = self._types.union(self._kept[name].ignored_types.split())
        self._vehicle.setParameter(name, IGNORED_TYPES, " ".join(sorted(types)))

    def take(self, passage: PassageLog) -> None:
        """Begin to drive a vehicle over a crosswalk."""
        passages = self._passages.setdefault(passage.name, [])
        passages.append(passage)
        self._set_mode(passage.name)

    def leave(self, passage: PassageLog, *, exists: bool) -> None:
        """Stop driving a vehicle over a crosswalk; after the last one SUMO drives it again."""
        passages = self._passages.get(passage.name, [])
        if passage in passages:
            passages.remove(passage)
            if not passages:
                del self._passages[passage.name]
                self._asked.pop(passage.name, None)
                self._give_back(passage.name, exists=exists)
            elif exists and passage.name in self._kept:
                self._set_mode(passage.name)

    def command(self, time_s: float) -> None:
        """Let every strategy decide, and give SUMO the lowest command for each vehicle."""
        self._asked.clear()
        for name, passages in self._passages.items():
            lowest = None
            for each in passages:
                wanted = self._decision(each, time_s)
                if wanted is not None and (lowest is None or wanted < lowest):
                    lowest = wanted
            if lowest is None:
                self._give_back(name, exists=True)
                continue
            if name not in self._kept:
                self._set_mode(name)
            speed = self._asked[name] = self._speed_after(passages[0], lowest)
            # SUMO keeps a command until the next one.
            if self._sent.get(name) != speed:
                self._sent[name] = speed
                self._set_speed(name, speed)

    def check(self, name: str, speed_mps: float) -> None:
        """Count the last command to a vehicle, and whether SUMO cut it."""
        asked = self._asked.get(name)
        if asked is None:
            return
        cut = abs(speed_mps - asked) > CUT_MPS
        for passage in self._passages.get(name, ()):
            passage.commands += 1
            passage.cut += cut

    def _decision(self, passage: PassageLog, now_s: float) -> float | None:
        """The acceleration that a strategy commands; None leaves the vehicle to SUMO."""
        assert passage.strategy is not None
        x, speed = passage.x_m[-1], passage.speed_mps[-1]
        before = passage.speed_mps[-2] if len(passage.speed_mps) > 1 else speed
        time_s = (len(passage.x_m) - 1) * self._step_s
        near = -self._detection_m <= x <= self._detection_m
        seen = tuple(self._views(passage, near))
        ego = quick_tuple(EgoView, (-x, speed, (speed - before) / self._step_s))
        crossing = passage.driven_way.way.crossing
        observation = quick_tuple(
            Observation, (time_s, self._step_s, ego, passage.vehicle, crossing, seen)
        )
        try:
            answer = passage.strategy.decide(observation)
        except (Exception, SystemExit) as error:
            raise named(passage, now_s, strategy_raised(error, time_s)) from error
        if answer is None and passage.vehicle.obeys_at_once:
            return None
        try:
            return limited(answer, passage.vehicle, time_s)
        except StrategyError as error:
            raise named(passage, now_s, error) from None

    def _speed_after(self, passage: PassageLog, wanted_mps2: float) -> float:
        """The speed at the end of the step of a vehicle that gets this command."""
        speed, name = passage.speed_mps[-1], passage.name
        if passage.vehicle.obeys_at_once:
            return max(0.0, speed + wanted_mps2 * self._step_s)
        actuator = self._actuators.get(name)
        if actuator is None:
            gain = self._vehicle.getAcceleration(name)
            actuator = Actuator(passage.vehicle, self._step_s, speed, gain)
            self._actuators[name] = actuator
        return actuator.speed_after(wanted_mps2, speed)

    def _set_mode(self, name: str) -> None:
        """Set the mode in which SUMO follows commands, limited only by other vehicles."""
        vehicle = self._vehicle
        if name not in self._kept:
            self._kept[name] = _Kept(
                vehicle.getSpeedMode(name),
                vehicle.getLaneChangeMode(name),
                vehicle.getParameter(name, IGNORED_TYPES),
            )
            vehicle.setLaneChangeMode(name, NO_LANE_CHANGE)
            self._ignore_types(name)
        meets = any(each.driven_way.meets_vehicles for each in self._passages[name])
        vehicle.setSpeedMode(name, SPEED_MODE_JUNCTION if meets else SPEED_MODE_MID_BLOCK)

    def _give_back(self, name: str, *, exists: bool) -> None:
        self._actuators.pop(name, None)
        kept = self._kept.pop(name, None)
        self._sent.pop(name, None)
        if kept is None or not exists:
            return
        vehicle = self._vehicle
        vehicle.setSpeed(name, -1.0)
        vehicle.setSpeedMode(name, kept.speed_mode)
        vehicle.setLaneChangeMode(name, kept.lane_change_mode)
        vehicle.setParameter(name, IGNORED_TYPES, kept.ignored_types)


def named(passage: PassageLog, now_s: float, error: StrategyError) -> StrategyError:
    """The same error, with the vehicle and the simulation's time."""
    what = f"vehicle {passage.name} at {passage.driven_way.way.crosswalk}, {now_s:.3f} s: {error}"
    same = StrategyError(what)
    same.traceback = error.traceback
    return same
