"""Vehicles on their ways over chosen crosswalks, and what a passage notes while it is driven.

A vehicle's places are values of SUMO's odometer, so that two crosswalks in a row are two places on
one axis.
"""

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from harness.core.actuation import Actuator
from harness.core.vocabulary import LIMITED_BY, STRATEGY, Crossing, FloatArray, Strategy, Vehicle
from harness.encounter.driver import Driver, attribute_of
from harness.engine.ids import edge_of
from harness.site.town import Connection, Crosswalk
from harness.site.zone import Zone

PASSED = "passed"

SIGHT_M = 200.0
"""The harness's people see vehicles that are this near."""
LOOK_S = 1.0
"""Time between two looks at vehicles that have begun no passage, and at the watched edges."""

_LEAST_MPS = 0.1
"""The least v0 of a passage, however low the limit of its road."""
_SAME_M = 15.0
"""The stop lines of a vehicle's lanes at one junction are this near to each other."""


class Link(NamedTuple):
    """A connection ahead, by the odometer; ``yields``: SUMO keeps the right of way."""

    begin_m: float
    end_m: float
    connection: Connection
    yields: bool


class LanesAhead(NamedTuple):
    """What lies ahead of a vehicle; another one whenever it comes onto another road lane.

    Attributes:
        limits: (odometer, speed in m/s) where each lane ahead begins, for this vehicle.
        least_mps: the lowest of the limits.
        links: the connections ahead, by the odometer.
    """

    limits: tuple[tuple[float, float], ...] = ()
    least_mps: float = math.inf
    links: tuple[Link, ...] = ()


@dataclass(frozen=True, slots=True)
class Facts:
    """What a vehicle is: it stays as long as the vehicle exists.

    Attributes:
        type_id, automated: its vType; whether it is an AV, in either arm.
        vehicle: its constants; v0 and R0 are those of each passage.
        speed_factor, max_mps: its own factor of speed limits, and its type's largest speed.
    """

    type_id: str
    automated: bool
    vehicle: Vehicle
    speed_factor: float
    max_mps: float

    def limit_mps(self, lane_mps: float) -> float:
        """The vehicle's own limit on a lane with this speed limit."""
        return min(self.max_mps, lane_mps * self.speed_factor)


@dataclass(slots=True, eq=False)
class CarRecord:
    """What is noted of a vehicle at the end of every step of its passages.

    Attributes:
        odometers_m, speeds_mps: its states.
        limited: the number of driven steps by what limited them (``LIMITED_BY``).
        held_by: what made SUMO drive slower than commanded in the last driven step; None: nothing.
    """

    # Unlike lists, arrays take no time of the garbage collector.
    odometers_m: "array[float]" = field(default_factory=lambda: array("d"))
    speeds_mps: "array[float]" = field(default_factory=lambda: array("d"))
    limited: list[int] = field(default_factory=lambda: [0] * len(LIMITED_BY))
    held_by: int | None = None


@dataclass(slots=True, eq=False)
class Driven:
    """How a vehicle is driven, from when a strategy takes it over until SUMO has it back.

    Attributes:
        actuator: passes commands on.
        yields: whether SUMO keeps its duty to yield; None until that has been decided.
        asked_mps: the command that SUMO has; NaN until the first.
        limited_by: what decided the command.
    """

    actuator: Actuator
    yields: bool | None = None
    asked_mps: float = math.nan
    limited_by: int = STRATEGY


@dataclass(slots=True, eq=False)
class Car:
    """A vehicle that is, or soon will be, on its way over a chosen crosswalk.

    Attributes:
        name: SUMO's id.
        facts: what does not change.
        lane, ahead: the lane that it was last seen on, and what lies ahead of it from there.
        next_m: the odometer from which a passage begins or ends.
        odometer_m, speed_mps, acceleration_mps2: its state when it was last read: at the end of the
            last step, once it has begun a passage.
        passages: its passages that have not ended, in order.
        record: what has been noted of it.
        driven: how it is driven; None: SUMO drives.
    """

    name: str
    facts: Facts
    lane: str = ""
    ahead: LanesAhead = field(default_factory=LanesAhead)
    next_m: float = -math.inf
    odometer_m: float = 0.0
    speed_mps: float = 0.0
    acceleration_mps2: float = 0.0
    passages: "list[Passage]" = field(default_factory=list)
    record: CarRecord = field(default_factory=CarRecord)
    driven: Driven | None = None

    def note(self, odometer_m: float, speed_mps: float) -> None:
        """Note the state at the end of a step."""
        self.odometer_m, self.speed_mps, record = odometer_m, speed_mps, self.record
        record.odometers_m.append(odometer_m)
        record.speeds_mps.append(speed_mps)


class Meeting(NamedTuple):
    """Where a vehicle meets a crosswalk, by its odometer.

    Attributes:
        crosswalk: the crosswalk.
        connection, zone: the connection on which the vehicle meets it, and its body's zone there.
        stop_m: the odometer at the stop line.
        first_m, last_m: the odometer where the body first and last touches the crosswalk.
        centre_m: the odometer at x = 0 of the zone's straight frame.
    """

    crosswalk: Crosswalk
    connection: Connection
    zone: Zone
    stop_m: float
    first_m: float
    last_m: float
    centre_m: float

    @classmethod
    def of(cls, at: Crosswalk, connection: Connection, zone: Zone, stop_m: float) -> "Meeting":
        """The meeting of a vehicle whose odometer at the stop line is ``stop_m``."""
        places_m = (stop_m + s for s in (zone.first_m, zone.last_m, zone.centre_m))
        return cls(at, connection, zone, stop_m, *places_m)

    def is_like(self, other: "Meeting") -> bool:
        """Whether it is with the same crosswalk at the same time."""
        return self.crosswalk is other.crosswalk and abs(self.stop_m - other.stop_m) < _SAME_M


@dataclass(slots=True, eq=False)
class Passage:
    """One vehicle's way over one chosen crosswalk, from R0 until its rear has left.

    Attributes:
        car: the vehicle.
        at: where it meets the crosswalk, which changes with its lane.
        vehicle: the car's constants; once it has begun, with v0 and R0 of this passage and the
            size of its zone: the straight frame's body covers the same part of the crosswalk.
        driver: who drives, or ``sumo``.
        strategy: the strategy that drives, until the passage has ended.
        not_driven: why no strategy drives it, or None.
        begin_s, first: time of its first state, and its place among those of the car; NaN and 0
            until it has begun.
        xs_m, speeds_mps: once it has ended, its states in the straight frame at every step.
        trace_offset_s: time from R0 until the first of them.
        limited: number of driven steps by what limited them (``LIMITED_BY``), once it has ended.
        ended: how it ended; None while it goes on.
        fallback: whether its strategy fell back, once it has ended; None if no strategy drove.
        collided: whether SUMO saw a collision.
        driven_by: what the strategy sees and how it commands, once it drives.
    """

    car: Car
    at: Meeting
    vehicle: Vehicle
    driver: str = "sumo"
    strategy: Strategy | None = None
    not_driven: str | None = None
    begin_s: float = math.nan
    first: int = 0
    xs_m: FloatArray = field(default_factory=lambda: np.empty(0))
    speeds_mps: FloatArray = field(default_factory=lambda: np.empty(0))
    trace_offset_s: float = 0.0
    limited: Sequence[int] = (0,) * len(LIMITED_BY)
    ended: str | None = None
    fallback: bool | None = None
    collided: bool = False
    driven_by: Driver | None = None

    @property
    def crossing(self) -> Crossing:
        """The crosswalk's constants in the straight frame."""
        return self.at.zone.crossing

    @property
    def off_lane(self) -> bool:
        """Whether the vehicle still has to change lane before the crosswalk's junction."""
        lane, before = self.car.lane, self.at.connection.from_lane
        return lane != before and edge_of(lane) == edge_of(before)

    # What the harness's people see of it (``encounter.deciding.Approaching``)

    @property
    def x_m(self) -> float:
        """x as the people at the crosswalk see it: its near edge is at − half the width."""
        return self.car.odometer_m - self.at.first_m - self.at.crosswalk.width_m / 2

    @property
    def begun(self) -> bool:
        """Whether it has passed R0."""
        return not math.isnan(self.begin_s)

    @property
    def passed_at_m(self) -> float:
        """``x_m`` at which the rear has left."""
        return self.at.last_m - self.at.first_m - self.at.crosswalk.width_m / 2

    @property
    def passed(self) -> bool:
        """Whether its rear has left."""
        return self.ended == PASSED

    @property
    def speed_mps(self) -> float:
        """The vehicle's speed."""
        return self.car.speed_mps

    @property
    def acceleration_mps2(self) -> float:
        """The vehicle's acceleration."""
        return self.car.acceleration_mps2

    def begin(self, time_s: float, range_m: float) -> None:
        """Begin with the last state and R0 = ``range_m``, at the limit before the junction."""
        self.begin_s, facts, record = time_s, self.car.facts, self.car.record
        self.first, self.limited = len(record.speeds_mps) - 1, tuple(record.limited)
        self.vehicle = replace(
            facts.vehicle,
            initial_speed_mps=max(facts.limit_mps(self.at.connection.limit_mps), _LEAST_MPS),
            length_m=self.at.zone.body_m,
            width_m=self.at.zone.width_m,
            trigger_range_m=range_m,
        )

    def end(self, why: str) -> None:
        """End with the car's last state."""
        record, self.ended = self.car.record, why
        self.xs_m = np.array(record.odometers_m[self.first :]) - self.at.centre_m
        self.speeds_mps = np.array(record.speeds_mps[self.first :])
        if self.strategy is None:
            self.limited = (0,) * len(LIMITED_BY)
        else:
            self.limited = np.subtract(record.limited, self.limited).tolist()
            self.fallback = bool(attribute_of(self.strategy, "fallback"))
            self.strategy = None

    def move_to(self, other: "Passage") -> None:
        """Go on, and be measured, on the connection of a lane to which the vehicle changed.

        v0 and R0 stay.
        """
        self.at, zone = other.at, other.at.zone
        if self.begun:
            self.vehicle = replace(self.vehicle, length_m=zone.body_m, width_m=zone.width_m)
