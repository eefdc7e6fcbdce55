"""The terms of encounters and simulations, as types and constants that every room shares.

Frame (SI units): x points along the road in the ego's direction and is 0 at the crosswalk's centre
line; y points across the road and is 0 at the kerb on the ego's right and ``length_m`` at the other
kerb.  Nothing here depends on an engine.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from harness.core.freezing import Frozen, frozen

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

Behaviour = Literal["constant", "gap_acceptance", "threshold", "reactive"]
"""How pedestrians decide and walk (docs/method.md, Pedestrians)."""

FailedIn = Literal["strategy", "engine"]
"""What failed in an episode: the strategy that drove, or the engine or its process."""

EngineName = Literal["sumo", "plain"]
"""SUMO, or the same kinematics in plain Python; the engine changes no pair's result."""

Progress = Callable[[int, int], None]
"""Receives the numbers of finished and planned pieces of work."""

StepMotion = Literal["ballistic", "euler"]
"""How a vehicle moves within a step: with constant acceleration, or at the step's last speed."""

PEDESTRIAN_RADIUS_M = 0.25
"""Radius of the disc that represents a pedestrian in every contact and distance."""

STANDING_MPS = 0.1
"""A vehicle or a pedestrian who is slower stands (SUMO's threshold for waiting time)."""

STOP_BEFORE_M = 1.0
"""The stop line is this far before the near edge of the crosswalk (the paper's Hard-Yield)."""

ROUNDING = 1e-9
"""Tolerance of thresholds in m, m/s and s: engines differ in the last bits of their sums.  Of other
numbers it is a relative tolerance, for the same reason."""

SPEED_ROUNDING = 1e-6
"""Relative tolerance: a speed counts as above a limit only if it exceeds it by more than this."""

SECONDS_PER_HOUR = 3600.0
"""Flows are per hour, times in seconds."""


def ignore(*_: object) -> None:
    """A callback that does nothing."""


class Arm(StrEnum):
    """One of the two simulations of a pair: the AV's or the reference driver's."""

    AV = "av"
    HUMAN = "human"


class Side(StrEnum):
    """The kerb from which a pedestrian comes: ``near`` is y = 0, on the ego's right."""

    NEAR = "near"
    FAR = "far"

    @property
    def other(self) -> "Side":
        """The opposite kerb."""
        return Side.FAR if self is Side.NEAR else Side.NEAR


class Ending(StrEnum):
    """How an episode ended; every planned episode has exactly one ending."""

    CROSSED = "crossed"
    CRASHED = "crashed"
    TIMED_OUT = "timed_out"
    FAILED = "failed"


class Contact(StrEnum):
    """The part of the ego that touched the pedestrian: ``front`` if they were ahead of it."""

    FRONT = "front"
    SIDE = "side"


@dataclass(frozen=True, slots=True)
class Vehicle:
    """What the ego is and can do, in m, m/s and m/s²; decelerations are positive numbers.

    ``initial_speed_mps`` is v0, its speed at R0 (``trigger_range_m``) before the crosswalk; its
    driver sees pedestrians from ``detection_range_m`` on.  Its limits are those on this road.
    Strategies return to v0 with ``resume_acceleration_mps2`` (a0).  A command acts after
    ``dead_time_s``; then the acceleration follows it with the lag ``lag_s``, at most
    ``max_jerk_mps3`` per second (``[actuation]``).
    """

    initial_speed_mps: float
    trigger_range_m: float
    detection_range_m: float
    length_m: float
    width_m: float
    max_acceleration_mps2: float
    max_deceleration_mps2: float
    resume_acceleration_mps2: float
    dead_time_s: float = 0.0
    lag_s: float = 0.0
    max_jerk_mps3: float | None = None

    @property
    def obeys_at_once(self) -> bool:
        """Whether the acceleration is the commanded one from the command on."""
        return not self.dead_time_s and not self.lag_s and self.max_jerk_mps3 is None

    def within_limits(self, acceleration_mps2: float) -> float:
        """The acceleration, or the limit of the vehicle that is nearest to it."""
        most_mps2 = self.max_acceleration_mps2
        return max(-self.max_deceleration_mps2, min(acceleration_mps2, most_mps2))

    def free_pass_time_s(self, crossing: "Crossing") -> float:
        """Time in s from the trigger until the rear bumper passes the far edge, driving at v0."""
        road_m = self.trigger_range_m + self.length_m + crossing.width_m / 2
        return road_m / self.initial_speed_mps


LIMITED_BY: Mapping[str, str] = frozen({
    "strategy": "the strategy",
    "actuator": "the actuator",
    "lane": "lanes and curves",
    "leader": "leaders",
    "right_of_way": "right of way",
})  # fmt: skip
"""What decides a driven vehicle's speed in a step of a simulation, with its words."""
STRATEGY, ACTUATOR, LANE, LEADER, RIGHT_OF_WAY = range(len(LIMITED_BY))
"""The places of these, in their order, in the counts of steps."""
BY_SUMO = ("lane", "leader", "right_of_way")
"""Those of which a note says that SUMO decided."""


@dataclass(frozen=True, slots=True)
class Crossing:
    """The crosswalk's constants for an ego in a given lane.

    ``length_m`` is the distance from kerb to kerb (L0) over all lanes; ``width_m`` is the extent
    along the road.  ``lane`` is the number of the ego's lane, counted from 0 at the near kerb, and
    ``lane_centre_m`` is y of its centre.  ``speed_limit_mps`` is the road's speed limit, or v0 if
    the scenario gives none; it is None on recorded roads, whose limit is not known.
    """

    length_m: float
    width_m: float
    lane_centre_m: float
    lane_width_m: float
    lane: int = 0
    speed_limit_mps: float | None = None

    def to_lane_m(self, side: Side) -> float:
        """Distance from a side's kerb to the centre of the ego's lane: L of a pedestrian there."""
        return self.lane_centre_m if side is Side.NEAR else self.length_m - self.lane_centre_m

    def place_of(self, side: Side, remaining_m: float) -> float:
        """y of a pedestrian from ``side`` who is ``remaining_m`` away from the other kerb."""
        return self.length_m - remaining_m if side is Side.NEAR else remaining_m

    @property
    def stop_line_m(self) -> float:
        """Range of the front bumper at the stop line before the near edge of the crosswalk."""
        return self.width_m / 2 + STOP_BEFORE_M


quick_tuple = tuple.__new__
"""Makes a named tuple from its class and values, in half the time of the class's constructor."""


class EgoView(NamedTuple):
    """The ego's state as its strategy sees it.

    ``range_m`` (R) is the distance from the front bumper to the crosswalk's centre line; it is
    negative once the bumper is past the line.
    """

    range_m: float
    speed_mps: float
    acceleration_mps2: float


class PedestrianView(NamedTuple):
    """One pedestrian as a strategy sees them.

    ``index`` is the number of people whom the driver had seen before they first saw this one; it
    stays the same for as long as the driver is on the way to this crosswalk.  (In the ground truth
    and in ``Trace.shown`` it is that of their ``Arrival``.)
    ``lateral_m`` (L) is the distance, in their walking direction, to the centre of the ego's lane;
    it is negative once they are past it.  ``remaining_m`` is the distance to the kerb that they
    walk to.  ``speed_mps`` is 0 while they stand.  ``on_crossing`` is true if they have stepped off
    and are between the kerbs, walking or standing.
    """

    index: int  # type: ignore[assignment]  # the field's own name; tuple.index is not needed
    side: Side
    lateral_m: float
    remaining_m: float
    speed_mps: float
    on_crossing: bool


Views = tuple[PedestrianView, ...]
"""The pedestrians that a strategy sees at one step."""


class Observation(NamedTuple):
    """Everything that a strategy sees at one step.

    ``time_s`` is the time since the trigger and ``step_s`` the simulation's step.  ``pedestrians``
    has the pedestrians whom the vehicle detects.  An observation is immutable.
    """

    time_s: float
    step_s: float
    ego: EgoView
    vehicle: Vehicle
    crossing: Crossing
    pedestrians: Views


class Strategy(Protocol):
    """A strategy drives one ego through one episode; each episode gets a new object.

    The harness calls the class with the parameters of its ``[strategies.<name>]`` table as keyword
    arguments.  If the constructor has one of the following arguments, it is passed too:

    - ``model``: the interaction model;
    - ``rng``: a ``numpy.random.Generator`` whose stream belongs to the pair;
    - ``step_s``: the simulation's step.

    A strategy may have a boolean attribute ``fallback``, which is recorded at the end of the
    episode.  The class of a built-in strategy may list the parameters that define its
    aggressiveness: ``AGGRESSIVENESS = {"margin_s": -1.0}``.  A negative sign means that a smaller
    value is bolder.
    """

    def decide(self, observation: Observation, /) -> float:
        """Return the commanded acceleration in m/s²."""


StrategyFactory = Callable[..., Strategy]
"""Makes a strategy: its class, called as ``Strategy`` says."""


class Leg(NamedTuple):
    """A part of a walk in the road frame, from ``time_s`` until the next leg begins.

    It begins at (``x_m``, ``y_m``) with the velocity (``x_mps``, ``y_mps``).  ``y_mps2`` is the
    acceleration across the road; the velocity along the road is constant.
    """

    time_s: float
    x_m: float
    y_m: float
    x_mps: float
    y_mps: float
    y_mps2: float


class Arrival(NamedTuple):
    """One planned pedestrian: their arrival time, kerb and quantile of the walking speed.

    ``critical_gap_s`` is the shortest gap that they accept; it is None if only the kerb rule
    applies.  With behaviour ``threshold``, ``threshold_s`` is the least margin of time with which
    they decide to go, and ``latency_s`` the time from that decision until they set off.  ``path``
    is the whole walk of a timed pedestrian; it is None for all others.  Timed pedestrians and
    SUMO's people have no ``quantile``.  ``detection_quantile`` is the quantile of the time to their
    first detection; it is None if detection is certain.  ``looks_from_s`` is given for a pedestrian
    who has been at the kerb before they may decide: they decide at steps from this time on, and not
    on arrival.
    ``walking_class`` is the number of their class of walking speeds, if they are in one.
    ``leader`` is the first member of their group, if that is somebody else: with behaviour
    ``threshold`` the group decides by the leader's walking speed.
    """

    index: int  # type: ignore[assignment]  # the field's own name; tuple.index is not needed
    arrival_s: float
    side: Side
    quantile: float | None
    critical_gap_s: float | None = None
    path: tuple[Leg, ...] | None = None
    detection_quantile: float | None = None
    looks_from_s: float | None = None
    threshold_s: float | None = None
    latency_s: float | None = None
    walking_class: int | None = None
    leader: "Arrival | None" = None


def advantage_s(range_m: Any, speed_mps: Any, lateral_m: Any, walking_mps: Any) -> Any:
    """T_adv = abs(R/v − L/v_p) in s (Chen, Zhao, Peng 2017) of those who move: numbers or arrays.

    Whoever asks decides from which speed on somebody moves, and what T_adv is of those who stand.
    """
    return abs(range_m / speed_mps - lateral_m / walking_mps)


def arrives_s(arrivals: Sequence[Arrival], number: int) -> float:
    """The time at which the arrival with this number comes; infinite if there are not so many."""
    return arrivals[number].arrival_s if number < len(arrivals) else math.inf


@dataclass(frozen=True, slots=True)
class Walk:
    """The walk of one arrival in one arm.

    ``start_s`` is the time at which they stepped off, ``speed_mps`` their walking speed, and
    (``range_m``, ``vehicle_speed_mps``) the ego's state at that time.  All four are None for a
    pedestrian who never stepped off.  Without ``legs`` they walk along x = 0 from kerb to kerb at
    ``speed_mps``; with ``legs``, ``speed_mps`` is their initial desired speed.  Of SUMO's people it
    is the mean over the crosswalk, None if they were no farther at the end.
    """

    arrival: Arrival
    start_s: float | None = None
    speed_mps: float | None = None
    range_m: float | None = None
    vehicle_speed_mps: float | None = None
    legs: tuple[Leg, ...] | None = None


class ModelUse(NamedTuple):
    """How often the interaction model was used in an episode, for pedestrians or drivers.

    ``clamped`` counts the uses in which the ego was faster or farther away than any vehicle in the
    model's data.  The largest excesses are ``speed_excess_mps`` and ``range_excess_m``.
    ``near_clamped`` counts the uses in which the ego was slower or nearer than every vehicle in the
    data.
    """

    uses: int = 0
    clamped: int = 0
    near_clamped: int = 0
    speed_excess_mps: float = 0.0
    range_excess_m: float = 0.0

    def joined(self, other: "ModelUse") -> "ModelUse":
        """The counts of both, added, and the larger of their excesses."""
        return ModelUse(
            self.uses + other.uses,
            self.clamped + other.clamped,
            self.near_clamped + other.near_clamped,
            max(self.speed_excess_mps, other.speed_excess_mps),
            max(self.range_excess_m, other.range_excess_m),
        )


NO_MODEL_USE = ModelUse()
"""The counts of an episode in which nobody asked the model."""


@dataclass(frozen=True, slots=True)
class Trace(Frozen):
    """One simulated episode: the ego's states at every step and the pedestrians' walks.

    ``x_m`` and ``speed_mps`` have shape (steps + 1,): the state at times 0, step_s, 2 step_s, …
    ``motion`` says how the vehicle moves within a step: with constant acceleration (``ballistic``),
    or at the speed of the step's end (``euler``, SUMO's default).  ``ending`` is how the *engine*
    ended the episode: ``crossed``, ``timed_out`` or ``failed``; ``measures`` detects
    contacts afterwards.  A failed episode has a ``reason``, ``failed_in`` (what failed) and, if a
    strategy raised an exception, its ``traceback``.  In simulations the trace begins
    ``trace_offset_s``, at most a step, after the front bumper passed the trigger.  ``shown`` has
    the pedestrians that the strategy saw at each step; it is None if the strategy saw the ground
    truth.
    """

    vehicle: Vehicle
    crossing: Crossing
    step_s: float
    x_m: FloatArray
    speed_mps: FloatArray
    walks: tuple[Walk, ...]
    ending: Ending
    reason: str | None = None
    sumo_collision: bool | None = None
    fallback: bool = False
    traceback: str | None = None
    failed_in: FailedIn | None = None
    trace_offset_s: float = 0.0
    shown: tuple[Views, ...] | None = None
    conditionings: ModelUse = NO_MODEL_USE
    motion: StepMotion = "ballistic"
