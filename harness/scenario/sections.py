"""The tables of a scenario file and their keys, with the limits of each key.

``[pedestrians]`` and ``[traffic]`` have modules of their own.  A section is frozen.  Each key is
checked on its own; ``consistency`` checks them together.
"""

import math
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from pydantic_core import PydanticCustomError

from harness.core.actuation import GRAVITY_MPS2
from harness.core.documents import NonNegative, Positive, Share
from harness.core.errors import InputError
from harness.core.vocabulary import ROUNDING, Arm, Vehicle

MAX_TRIGGER_RANGE_M = 300.0
"""Longest range at which the ego can be inserted: the length of every network's approach road."""

MAX_SPEED_MPS = 60.0
"""Highest v0, and highest speed limit before a crosswalk of a simulation."""

BEFORE_CROSSWALK_M = 1.5
"""SUMO's approach lane ends this far before the crosswalk: the ego is not inserted beyond it."""

FOOTPATH_M = 10.0
"""Length of a footpath of a network of the harness, from the kerb to its outer end."""

MAX_BEFORE_KERB_M = 8.0
"""Greatest distance from a timed pedestrian's start to their kerb, within ``FOOTPATH_M``."""

SUMO_DRIVER = "sumo_driver"
"""The strategy that leaves the driving to SUMO."""

Acceleration = Annotated[float, Field(ge=0.1, le=20)]
"""The greatest acceleration or deceleration of a vehicle, in m/s²."""
Step = Annotated[float, Field(ge=0.001, le=1, multiple_of=0.001)]
"""A simulation step: whole milliseconds, SUMO's resolution."""
Flow = Annotated[float, Field(ge=0, le=100_000)]
"""Vehicles or people per hour."""


class Section(BaseModel):
    """A table of a scenario file; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    def changed(self, keys: Iterable[str] = ()) -> list[str]:
        """Those of these keys, or of all, whose value is not the default."""
        default, keys = type(self)(), keys or type(self).model_fields
        return [key for key in keys if getattr(self, key) != getattr(default, key)]


VALIDATED = "validated"
"""The mark in the annotation of a key that has an effect on recorded passages."""


class Only(NamedTuple):
    """When a key has an effect, if not always; it stands in the key's annotation.

    Attributes:
        words: what comes after "only".
        holds: tests it for a scenario in which the key differs from its default.
    """

    words: str
    holds: Callable[[Any], Any]


Effect = tuple[str, InputError | None]
"""A dotted key that is set, and its refusal if it has no effect."""


def effects(section: Section, scenario: Section, path: str = "") -> Iterator[Effect]:
    """The keys of a section that are set: each whose value is not its default."""
    for name, field in type(section).model_fields.items():
        key, value = f"{path}{name}", getattr(section, name)
        if isinstance(value, Section):
            yield from effects(value, scenario, f"{key}.")
            continue
        default = field.get_default(call_default_factory=True, validated_data=vars(section))
        if value != default:
            conditions = (each for each in field.metadata if isinstance(each, Only))
            only = next((each for each in conditions if not each.holds(scenario)), None)
            own = f"its default{f' {default}' if isinstance(default, float | str) else ''}"
            words = only and f"{own}; another value only {only.words}"
            yield key, only and InputError(key, "has no effect", words)


def marked(section: type[Section], mark: object) -> list[str]:
    """The keys of a section that have a mark in their annotation."""
    return [name for name, field in section.model_fields.items() if mark in field.metadata]


ENCOUNTERS = Only("in encounters", lambda s: s.kind == "encounters")
OWN_ROAD = Only("without [simulation], which has its own", lambda s: s.simulation is None)
_ROAD_LIMITS = Only(
    "in encounters, or on a road with grade or friction",
    lambda s: s.kind == "encounters" or s.crossing.grade or s.crossing.friction,
)
_DRIVEN = Only("where a strategy drives", lambda s: s.arms.av != SUMO_DRIVER or s.perception.human)
_NOISE = Only(
    "with position_sd_m or speed_sd_mps",
    lambda s: s.perception.changed(["position_sd_m", "speed_sd_mps"]),
)
_HIDDEN = Only("with crossing.obstacles", lambda s: s.crossing.obstacles)
_ERRORS = Only("with another key of [perception]", lambda s: len(s.perception.changed()) > 1)
_REFERENCE = Only("with a strategy in arms.human", lambda s: s.arms.human != SUMO_DRIVER)
_NOT_DRAWN = {"latency_s", "update_s", "correlation_s", "occlusion", "human"}
"""The keys of perception that draw nothing at random by themselves."""
_LATE = Only("with another key of [actuation]", lambda s: s.actuation.applies_to(Arm.HUMAN))
_NO_PATH = Only("without model.path", lambda s: s.model.path is None)
_WALKS = Only("if walking speeds are drawn from the model", lambda s: s.walks_by_model)


class ObstacleSection(Section):
    """``[[crossing.obstacles]]``: a rectangle in the road frame that hides what is behind it.

    (``x_m``, ``y_m``) is its centre and ``length_m`` its extent along the road.  With ``case`` it
    stands there only in the timed case of that name.
    """

    x_m: Annotated[float, Field(ge=-1000, le=1000)]
    """Position of its centre along the road; 0 at the crosswalk's centre line."""
    y_m: Annotated[float, Field(ge=-1000, le=1000)]
    """Position of its centre across the road; 0 at the near kerb."""
    length_m: Annotated[float, Field(gt=0, le=1000)]
    """Its extent along the road."""
    width_m: Annotated[float, Field(gt=0, le=1000)]
    """Its extent across the road."""
    case: str | None = None
    """Name of the timed case in which it stands; if not given, it stands there in all of them."""

    @property
    def x_bounds_m(self) -> tuple[float, float]:
        """x of its two ends."""
        return self.x_m - self.length_m / 2, self.x_m + self.length_m / 2

    @property
    def y_bounds_m(self) -> tuple[float, float]:
        """y of its two sides."""
        return self.y_m - self.width_m / 2, self.y_m + self.width_m / 2


class CrossingSection(Section):
    """``[crossing]``: position and geometry of the crosswalk."""

    latitude_deg: Annotated[Annotated[float, Field(ge=-80, le=84)] | None, OWN_ROAD] = None
    """Latitude of the crosswalk's centre; if not given, the network has no geographic position."""
    longitude_deg: Annotated[Annotated[float, Field(ge=-180, le=180)] | None, OWN_ROAD] = None
    """Longitude of the crosswalk's centre; give both or neither."""
    bearing_deg: Annotated[float, Field(ge=0, lt=360), OWN_ROAD] = 316.5
    """The ego's direction, clockwise from true north."""
    length_m: Annotated[float, Field(ge=2.5, le=40), OWN_ROAD] = 9.0
    """L0, from kerb to kerb; there must be at least 0.25 m between the ego and each kerb."""
    width_m: Annotated[float, Field(ge=1, le=20), OWN_ROAD] = 4.0
    """Extent of the crosswalk along the road."""
    lanes: Annotated[int, Field(ge=1, le=6), OWN_ROAD] = 1
    """Lanes in the ego's direction."""
    oncoming_lanes: Annotated[int, Field(ge=0, le=6), OWN_ROAD] = 1
    """Lanes towards the ego; 0 is a one-way road."""
    lane_width_m: Annotated[Annotated[float, Field(ge=1, le=20)] | None, OWN_ROAD] = None
    """Width of each lane; if not given, the lanes share ``length_m`` equally.  The unused width is
    a median, or on a one-way road a strip of half of it at each kerb."""
    road_speed_limit_mps: Annotated[Annotated[float, Field(gt=0, le=100)] | None, OWN_ROAD] = None
    """Speed limit for SUMO's car following and for SUMO's outputs; if not given, v0."""
    obstacles: Annotated[tuple[ObstacleSection, ...], Field(strict=False), ENCOUNTERS] = ()
    """Parked cars, hedges and the like that hide pedestrians."""
    grade: Annotated[float, Field(ge=-0.4, le=0.4), OWN_ROAD, VALIDATED] = 0.0
    """Rise over run in the ego's direction, positive uphill; it changes how hard vehicles can brake
    and accelerate, in both arms."""
    friction: Annotated[Annotated[float, Field(ge=0.01, le=2)] | None, OWN_ROAD, VALIDATED] = None
    """Friction coefficient of tyre and road, which limits braking and accelerating, in both arms;
    if not given, only the vehicle limits them."""

    @property
    def width_of_lane_m(self) -> float:
        """``lane_width_m``, or ``length_m`` divided equally among the lanes of both directions."""
        if self.lane_width_m is not None:
            return self.lane_width_m
        return self.length_m / (self.lanes + self.oncoming_lanes)

    @property
    def beside_lanes_m(self) -> float:
        """Part of ``length_m`` without lanes: the median, or both kerb strips of a one-way road."""
        if self.lane_width_m is None:
            return 0.0
        rest = self.length_m - (self.lanes + self.oncoming_lanes) * self.lane_width_m
        return rest if rest > ROUNDING else 0.0

    @property
    def kerb_strip_m(self) -> float:
        """Width of the strip between each kerb and the lanes; above 0 only on one-way roads."""
        return 0.0 if self.oncoming_lanes else self.beside_lanes_m / 2

    def lane_centre_m(self, lane: int) -> float:
        """Distance from a direction's near kerb to the centre of its lane number ``lane``, in m."""
        return self.kerb_strip_m + (lane + 0.5) * self.width_of_lane_m

    def lane_borders_m(self) -> tuple[float, ...]:
        """y of every line between two lanes, or between a lane and a median or strip, in m."""
        width, strip = self.width_of_lane_m, self.kerb_strip_m
        near = [strip + lane * width for lane in range(self.lanes + 1)]
        far = [self.length_m - strip - lane * width for lane in range(self.oncoming_lanes + 1)]
        inside = {round(y, 9) for y in (*near, *far)} - {0.0, round(self.length_m, 9)}
        return tuple(sorted(inside))


class EgoSection(Section):
    """``[ego]``: the vehicle, the same in both arms."""

    lane: Annotated[int, Field(ge=0), ENCOUNTERS] = 0
    """The ego's lane, counted from the near kerb; below ``crossing.lanes``."""
    initial_speed_mps: Annotated[float, Field(ge=0.1, le=MAX_SPEED_MPS), OWN_ROAD] = 5.0
    """v0."""
    trigger_range_m: Annotated[float, Field(gt=0, le=MAX_TRIGGER_RANGE_M)] = 30.0
    """R0: t = 0 when the front bumper is this far from the centre line; at least half the
    crosswalk's width plus ``BEFORE_CROSSWALK_M``."""
    detection_range_m: Annotated[Positive | None, VALIDATED] = None
    """Range up to which pedestrians are detected; if not given, the trigger range."""
    length_m: Annotated[float, Field(ge=1, le=25), OWN_ROAD] = 5.0
    """Length of the vehicle."""
    width_m: Annotated[float, Field(ge=0.5, le=5), OWN_ROAD, VALIDATED] = 1.8
    """Width of the vehicle; at most the width of its lane."""
    max_acceleration_mps2: Annotated[Acceleration, _ROAD_LIMITS, VALIDATED] = 3.0
    """Greatest acceleration that a strategy can command."""
    max_deceleration_mps2: Annotated[Acceleration, OWN_ROAD, VALIDATED] = 4.5
    """Greatest deceleration that a strategy can command."""
    resume_acceleration_mps2: Annotated[Acceleration, VALIDATED] = 1.0
    """a0: acceleration back to v0 once the crossing is clear."""


class PerceptionSection(Section):
    """``[perception]``: perception errors of AVs; by default they see the ground truth.

    With ``human = true`` human drivers have them too.
    """

    latency_s: Annotated[float, Field(ge=0, le=60), _DRIVEN] = 0.0
    """Latency: age of the pedestrian data that the strategy sees; whole steps."""
    update_s: Annotated[Annotated[float, Field(gt=0, le=60)] | None, _DRIVEN] = None
    """Time between two updates of the sensor; whole steps; if not given, it updates every step."""
    detection_probability: Annotated[Share, _DRIVEN] = 1.0
    """Probability at each update that a pedestrian is detected; from then on they are tracked."""
    dropout_probability: Annotated[Share, _DRIVEN] = 0.0
    """Probability at each update that a track is lost; the pedestrian must be detected again."""
    position_sd_m: Annotated[float, Field(ge=0, le=100), _DRIVEN] = 0.0
    """Standard deviation of the position error."""
    speed_sd_mps: Annotated[float, Field(ge=0, le=100), _DRIVEN] = 0.0
    """Standard deviation of the speed error."""
    correlation_s: Annotated[NonNegative, _NOISE] = 1.0
    """Correlation time of the errors."""
    occlusion: Annotated[bool, _HIDDEN] = True
    """Whether obstacles hide pedestrians from the AV."""
    human: Annotated[bool, _ERRORS, _REFERENCE] = False
    """Whether human drivers have the same errors."""

    @property
    def draws(self) -> bool:
        """Whether any error is drawn at random."""
        return bool({*self.changed()} - _NOT_DRAWN)

    def is_perfect(self, step_s: float) -> bool:
        """Whether the strategy sees the ground truth at every step, apart from what is hidden."""
        every_step = self.update_s is None or self.update_s < 1.5 * step_s
        return every_step and not self.draws and not self.latency_s


class ModelSection(Section):
    """``[model]``: the interaction model, a shipped one by ``name`` or a file by ``path``."""

    name: Annotated[str, _NO_PATH, VALIDATED] = "dut"
    """Name of a shipped interaction model."""
    path: Annotated[str | None, VALIDATED] = None
    """Path of a model file of your own; replaces ``name``."""
    pedestrian_reading: Annotated[Literal["marginal", "unconditional"], _WALKS] = "marginal"
    """Which conditional distribution walking speeds are drawn from (docs/method.md)."""
    extrapolate: bool = False
    """Clamp a v0 or R0 that lies outside the model's data; otherwise it is refused."""


def _strategy_name(strategy: Any) -> Any:
    """The name ``package.module:Class`` of a Python class, from which it can be imported again.

    A class of a script or notebook is ``__main__:Class``: only its own process can find it.
    """
    if not isinstance(strategy, type):
        return strategy
    module, name = strategy.__module__, strategy.__qualname__
    attribute: Any = sys.modules.get(module)
    for part in name.split("."):
        attribute = getattr(attribute, part, None)
    if attribute is not strategy:
        allowed = "a class of a module, script or notebook, not one made inside a function"
        raise PydanticCustomError("strategy_class", allowed)
    return f"{module}:{name}"


StrategyName = Annotated[str, BeforeValidator(_strategy_name)]


class ArmsSection(Section):
    """``[arms]``: which strategy drives in each arm; in Python it may also be a class."""

    av: StrategyName = "soft_yield"
    """The strategy that drives the AV."""
    human: StrategyName = "human_gmm"
    """The strategy that drives the vehicle of the reference arm."""

    def driver(self, arm: Arm) -> str:
        """The strategy of an arm, by name."""
        return self.av if arm is Arm.AV else self.human


class ConflictsSection(Section):
    """``[conflicts]``: thresholds of the measures beyond which an episode counts as a conflict."""

    ttc_s: NonNegative = 1.5
    """A minimum time to collision below this is a conflict."""
    time_advantage_s: Annotated[NonNegative, ENCOUNTERS] = 1.5
    """A minimum time advantage below this is a conflict."""
    pet_s: NonNegative = 1.5
    """A post-encroachment time below this is a conflict."""
    drac_mps2: NonNegative = 3.35
    """A deceleration rate to avoid a crash above this is a conflict."""


class ExperimentSection(Section):
    """``[experiment]``: number of pairs, seed, simulation step and time limits."""

    pairs: Annotated[int, Field(ge=1, le=10_000_000)] = 50
    """N, the number of pairs; each is simulated twice, once per arm."""
    seed: Annotated[int, Field(ge=0, lt=2**63), VALIDATED] = 1
    """Seed from which every random number derives; with ``[simulation]`` SUMO's own seeds, too."""
    step_s: Annotated[Step, OWN_ROAD, VALIDATED] = 0.1
    """Simulation step; whole milliseconds."""
    timeout_s: Annotated[float, Field(gt=0, le=3600), ENCOUNTERS] = 60.0
    """An episode in which the ego has not passed by this time is timed out; whole steps."""
    decide_limit_s: Annotated[float, Field(ge=0.1, le=3600)] = 10.0
    """Wall time that a strategy may take for one decision."""


class SimulationSection(Section):
    """``[simulation]``: a SUMO configuration, which each pair simulates twice.

    Its vehicles, people, traffic lights and options are SUMO's; strategies drive at the chosen
    crosswalks.  With ``pedestrians.flow_per_hour`` people of the harness come there too.
    """

    file: str
    """The SUMO configuration (.sumocfg); it and its files are read where they are."""
    crossings: Annotated[tuple[str, ...], Field(strict=False, min_length=1)]
    """Ids of the crosswalks, as ``harness crossings`` lists them."""
    av_share: Share = 1.0
    """Share of the vehicles of ``av_types`` that ``arms.av`` drives in the AV's arm."""
    av_types: Annotated[tuple[str, ...], Field(strict=False, min_length=1)] = ("passenger",)
    """Vehicle types or vehicle classes that may be AVs."""
    begin_s: NonNegative | None = None
    """Time from which trips and passages count; if not given, the simulation's begin."""
    end_s: Positive | None = None
    """Time until which trips and passages count; if not given, the simulation's end."""
    step_s: Step | None = None
    """Step of both arms, whole ms; if not given, the configuration's, which is then at most 1 s."""


class ActuationSection(Section):
    """``[actuation]``: how late the AV's vehicle obeys commands; by default it obeys at once.

    With ``human = true`` the vehicle of the human's arm obeys as late.
    """

    dead_time_s: Annotated[float, Field(ge=0, le=5)] = 0.0
    """Time from a command until it begins to act; it need not be whole steps."""
    lag_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Time constant with which the acceleration then follows the command (first order)."""
    max_jerk_mps3: Annotated[float, Field(gt=0, le=10_000)] | None = None
    """Greatest rate at which the acceleration changes; if not given, only the lag limits it."""
    human: Annotated[bool, _LATE] = False
    """Whether the vehicle of the human's arm obeys as late."""

    def applies_to(self, driver: Arm) -> bool:
        """Whether the vehicles of a driver obey late."""
        at_once = self.model_copy(update={"human": False}) == ActuationSection()
        return not at_once and (driver is Arm.AV or self.human)


def on_road(vehicle: Vehicle, crossing: CrossingSection, *, oncoming: bool = False) -> Vehicle:
    """A vehicle with its limits on this road.

    With the angle α of the road and its friction μ it brakes with at most
    min(b, μ g cos α) + g sin α and accelerates with at most min(a, μ g cos α) − g sin α.
    """
    friction = crossing.friction
    if not crossing.grade and friction is None:
        return vehicle
    angle = math.atan(-crossing.grade if oncoming else crossing.grade)
    grip = math.inf if friction is None else friction * GRAVITY_MPS2 * math.cos(angle)
    slope = GRAVITY_MPS2 * math.sin(angle)
    most = min(vehicle.max_acceleration_mps2, grip) - slope
    return replace(
        vehicle,
        max_acceleration_mps2=most,
        max_deceleration_mps2=min(vehicle.max_deceleration_mps2, grip) + slope,
        resume_acceleration_mps2=min(vehicle.resume_acceleration_mps2, most),
    )
