"""The vocabulary of one encounter: what is planned, what a strategy sees, what is kept.

Frame (SI units): x along the road in the ego's direction, 0 at the crosswalk's centre line; y
across it, 0 at the kerb on the ego's right, ``length_m`` at the other kerb.  Nothing here knows
an engine.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

Behaviour = Literal["constant", "gap_acceptance", "reactive", "sumo"]
"""How pedestrians decide and walk (docs/method.md, Pedestrians)."""

FailedIn = Literal["strategy", "engine"]
"""Where an episode failed: in the strategy that drove, or in the engine or its process."""

PEDESTRIAN_RADIUS_M = 0.25
"""Radius of the disc that stands for a pedestrian in every contact and distance."""


class Arm(StrEnum):
    """Which of the two vehicles of a pair met the pedestrians."""

    AV = "av"
    HUMAN = "human"


class Side(StrEnum):
    """The kerb a pedestrian comes from: ``near`` is y = 0, on the ego's right."""

    NEAR = "near"
    FAR = "far"

    @property
    def other(self) -> "Side":
        """The kerb across the road."""
        return Side.FAR if self is Side.NEAR else Side.NEAR


class Ending(StrEnum):
    """How an episode ended; every planned episode has exactly one."""

    CROSSED = "crossed"
    CRASHED = "crashed"
    TIMED_OUT = "timed_out"
    ENGINE_FAILED = "engine_failed"


class Contact(StrEnum):
    """Where the ego touched the pedestrian: ``front`` if they were ahead of the bumper."""

    FRONT = "front"
    SIDE = "side"


SPEED_ROUNDING = 1e-6
"""By this share a speed may be above a limit before it counts as above."""


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The ego's constants: metres, m/s, m/s²; decelerations are positive numbers."""

    initial_speed_mps: float
    trigger_range_m: float
    detection_range_m: float
    length_m: float
    width_m: float
    max_acceleration_mps2: float
    max_deceleration_mps2: float
    resume_acceleration_mps2: float

    def free_pass_time_s(self, crossing: "Crossing") -> float:
        """Time from the trigger until the rear bumper leaves the far edge at v0, in s."""
        road_m = self.trigger_range_m + self.length_m + crossing.width_m / 2
        return road_m / self.initial_speed_mps


@dataclass(frozen=True, slots=True)
class Crossing:
    """The crosswalk as the ego meets it in its lane.

    ``length_m`` is from kerb to kerb (L0), over all lanes; ``width_m`` along the road.
    ``lane_centre_m`` is y of the centre of the ego's lane, number ``lane`` from the near kerb (0).
    ``speed_limit_mps`` is the road's, None where the network itself says it.
    """

    length_m: float
    width_m: float
    lane_centre_m: float
    lane_width_m: float
    lane: int = 0
    speed_limit_mps: float | None = None

    def to_lane_m(self, side: Side) -> float:
        """From that side's kerb to the centre of the ego's lane: L of someone who stands there."""
        return self.lane_centre_m if side is Side.NEAR else self.length_m - self.lane_centre_m

    def place_of(self, side: Side, remaining_m: float) -> float:
        """y of someone from that side who has ``remaining_m`` left to the other kerb."""
        return self.length_m - remaining_m if side is Side.NEAR else remaining_m

    @property
    def stop_line_m(self) -> float:
        """Range of the front bumper at Hard-Yield's stop line, 1 m before the near edge."""
        return self.width_m / 2 + 1.0


quick_tuple = tuple.__new__
"""Makes a named tuple of a class and all its values, in half the time its own constructor takes."""


class EgoView(NamedTuple):
    """The ego as its strategy knows it; ``range_m`` is negative past the centre line."""

    range_m: float
    speed_mps: float
    acceleration_mps2: float


class PedestrianView(NamedTuple):
    """What a strategy sees of one pedestrian.

    ``lateral_m`` (L): distance along their direction to the centre of the ego's lane, negative
    once past it.  ``remaining_m``: to the far kerb.  ``speed_mps`` is 0 while they stand.
    ``on_crossing``: they have stepped off and are between the kerbs, walking or standing.
    """

    index: int  # type: ignore[assignment]  # the field's own name; tuple.index is not needed
    side: Side
    lateral_m: float
    remaining_m: float
    speed_mps: float
    on_crossing: bool


class Observation(NamedTuple):
    """Everything a strategy sees at one step; immutable, and cheap because made every step."""

    time_s: float
    step_s: float
    ego: EgoView
    vehicle: Vehicle
    crossing: Crossing
    pedestrians: tuple[PedestrianView, ...]


class Strategy(Protocol):
    """Drives one ego through one episode; a new object is made for each episode.

    The class is called with the parameters of its ``[strategies.<name>]`` table as keyword
    arguments.  A constructor that names ``model`` gets the interaction model, one that names
    ``rng`` a ``numpy.random.Generator`` of its own, keyed by pair, one that names ``step_s`` the
    simulation's step.  A boolean attribute ``fallback``, where there is one, is recorded at the
    end of the episode.  A classmethod ``prepare``, where there is one, is called with the same
    parameters once per process before the first object is made.  A built-in strategy may name the
    parameters that are its aggressiveness in the class: ``AGGRESSIVENESS = {"margin_s": -1.0}``
    (the sign: less of it is bolder).
    """

    def decide(self, observation: Observation, /) -> float | None:
        """The wanted acceleration in m/s²; None hands the ego to SUMO's own driver."""
        ...


StrategyFactory = Callable[..., Strategy]


class Leg(NamedTuple):
    """A stretch of a walk in the road frame, from ``time_s`` until the next leg begins.

    It begins at (``x_m``, ``y_m``) with that velocity.  Only the velocity across the road may
    change on the way, at ``y_mps2``.
    """

    time_s: float
    x_m: float
    y_m: float
    x_mps: float
    y_mps: float
    y_mps2: float


class Arrival(NamedTuple):
    """One planned pedestrian: when they reach which kerb, and their speed's quantile.

    ``critical_gap_s`` is the shortest gap they accept, None where the kerb rule alone decides.
    ``path`` is the whole walk of a timed pedestrian, who has no quantile; None for all others.
    ``detection_quantile`` is that of the time to their first detection, the larger the later; None
    where detection is certain.
    """

    index: int  # type: ignore[assignment]  # the field's own name; tuple.index is not needed
    arrival_s: float
    side: Side
    quantile: float | None
    critical_gap_s: float | None = None
    path: tuple[Leg, ...] | None = None
    detection_quantile: float | None = None


@dataclass(frozen=True, slots=True)
class Walk:
    """What became of one arrival in one arm.

    ``start_s``, ``speed_mps`` and the state (``range_m``, ``vehicle_speed_mps``) they saw when
    they stepped off are None for someone who never got to go.  Without ``legs`` they walk along
    x = 0 from kerb to kerb at ``speed_mps``; else ``speed_mps`` is what they wanted at first.
    """

    arrival: Arrival
    start_s: float | None = None
    speed_mps: float | None = None
    range_m: float | None = None
    vehicle_speed_mps: float | None = None
    legs: tuple[Leg, ...] | None = None


class Conditionings(NamedTuple):
    """How often the interaction model was asked in an episode, for a walking speed or a driver's.

    ``clamped``: with the ego faster or farther away than in any of its data, by at most
    ``speed_excess_mps`` and ``range_excess_m``.  ``near_clamped``: with it slower or nearer.
    """

    asked: int = 0
    clamped: int = 0
    near_clamped: int = 0
    speed_excess_mps: float = 0.0
    range_excess_m: float = 0.0

    def joined(self, other: "Conditionings") -> "Conditionings":
        """These and others of the same episode."""
        return Conditionings(
            self.asked + other.asked,
            self.clamped + other.clamped,
            self.near_clamped + other.near_clamped,
            max(self.speed_excess_mps, other.speed_excess_mps),
            max(self.range_excess_m, other.range_excess_m),
        )


NOTHING_ASKED = Conditionings()


@dataclass(frozen=True, slots=True)
class Trace:
    """One simulated episode: the ego's states at every step and the pedestrians' walks.

    ``x_m`` and ``speed_mps`` have shape (steps + 1,), the state at times 0, step_s, 2 step_s …;
    in between the acceleration is constant.  ``ending`` is how the *engine* left off
    (``crossed``, ``timed_out`` or ``engine_failed`` with a ``reason``, whose fault it was
    (``failed_in``) and, where a strategy raised, its ``traceback``); contacts are found
    afterwards, by ``measures``.  In traffic the trace begins ``trace_offset_s``, less than a step,
    after the front bumper was at the trigger.  ``shown`` is what the strategy was shown of the
    pedestrians at each step, None where it was shown the ground truth.
    """

    vehicle: Vehicle
    crossing: Crossing
    step_s: float
    x_m: FloatArray
    speed_mps: FloatArray
    walks: tuple[Walk, ...]
    ending: Ending
    reason: str | None
    sumo_collision: bool | None
    fallback: bool
    traceback: str | None = None
    failed_in: FailedIn | None = None
    trace_offset_s: float = 0.0
    shown: tuple[tuple[PedestrianView, ...], ...] | None = None
    conditionings: Conditionings = NOTHING_ASKED

    def __post_init__(self) -> None:
        """The arrays are read-only from here on."""
        self.x_m.setflags(write=False)
        self.speed_mps.setflags(write=False)


Parameters = dict[str, Any]
