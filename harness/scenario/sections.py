"""Every key of a scenario file but those of ``[pedestrians]``, with its meaning and default.

A section is frozen; each of its keys is checked by itself.
"""

import sys
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from pydantic_core import PydanticCustomError

from harness.core.encounter import Arm

MAX_TRIGGER_RANGE_M = 300.0
"""Longest range at which the ego can be inserted: the approach road of every network is as long."""

ROUNDING_M = 1e-9
"""Lanes that fill the road to within this leave nothing beside them."""

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]


class Section(BaseModel):
    """A table of a scenario file; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class ObstacleSection(Section):
    """``[[crossing.obstacles]]``: a rectangle in the road frame that hides what is behind it.

    (``x_m``, ``y_m``) is its centre, ``length_m`` along the road.  ``case``: it stands there in the
    timed case of that name alone.
    """

    x_m: Annotated[float, Field(ge=-1000, le=1000)]
    """Its centre along the road; 0 at the crosswalk's centre line."""
    y_m: Annotated[float, Field(ge=-1000, le=1000)]
    """Its centre across the road; 0 at the near kerb."""
    length_m: Annotated[float, Field(gt=0, le=1000)]
    """Its extent along the road."""
    width_m: Annotated[float, Field(gt=0, le=1000)]
    """Its extent across the road."""
    case: str | None = None
    """The timed case it stands in; without it, all of them."""

    @property
    def x_bounds_m(self) -> tuple[float, float]:
        """x of its two ends."""
        return self.x_m - self.length_m / 2, self.x_m + self.length_m / 2

    @property
    def y_bounds_m(self) -> tuple[float, float]:
        """y of its two sides."""
        return self.y_m - self.width_m / 2, self.y_m + self.width_m / 2


class ReadLaneSection(Section):
    """``[[crossing.read.ways]]``: a car lane over the crosswalk, of either direction."""

    oncoming: bool
    """Whether it leads towards the ego."""
    centre_m: float
    """Distance from the ego's near kerb to the lane's centre."""
    width_m: float
    """Width of the lane."""


class ReadPassedSection(Section):
    """``[[crossing.read.passed]]``: what else the ego's way leads past."""

    kind: Literal["traffic light", "crosswalk"]
    """A traffic light, or another crosswalk."""
    id: str
    """The light's or the crossing's id in the network."""
    x_m: float
    """Its place on the way; 0 at the crosswalk's centre line."""


class ReadSection(Section):
    """``[crossing.read]``: what a network of the user's own says; the harness fills it in.

    It belongs to the network of that ``sha256`` and to that ``edge`` and ``approach``.
    """

    net: str
    """The network's file."""
    sha256: str
    """Hash of that file."""
    edge: str
    """The crossing's id."""
    approach: str | None
    """The lane's id."""
    lane: int
    """The lane's number from the near kerb."""
    lane_centre_m: float
    """Distance from the near kerb to the lane's centre."""
    angle_deg: float
    """Angle between road and crosswalk."""
    ways: Annotated[tuple[ReadLaneSection, ...], Field(strict=False)] = ()
    """Every lane that is straight over the crosswalk, each direction from its near kerb on."""
    passed: Annotated[tuple[ReadPassedSection, ...], Field(strict=False)] = ()
    """Traffic lights and other crosswalks on the ego's way; no strategy is shown them."""


class CrossingSection(Section):
    """``[crossing]``: the place and shape of the crosswalk, or where its network says them."""

    net: str | None = None
    """A SUMO network of your own, which then says length, width, lanes, bearing and place."""
    edge: str | None = None
    """The id of a crossing in ``net``."""
    approach: str | None = None
    """The ego's lane in ``net``; without it, the outermost car lane that leads there."""
    ignore_signal: bool = False
    """Keep a traffic light that rules the crossing in ``net`` green."""
    read: ReadSection | None = None
    """Facts that the harness read in ``net``; it fills them in itself."""
    latitude_deg: Annotated[float, Field(ge=-80, le=84)] | None = None
    """Latitude of the crosswalk's centre; without it, the network has no place on the ground."""
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] | None = None
    """Longitude of the crosswalk's centre; both or neither."""
    bearing_deg: Annotated[float, Field(ge=0, lt=360)] = 316.5
    """The ego's direction, clockwise from true north."""
    length_m: Annotated[float, Field(ge=2.5, le=40)] = 9.0
    """L0, from kerb to kerb; 0.25 m are left between the ego and each kerb."""
    width_m: Annotated[float, Field(ge=1, le=20)] = 4.0
    """Extent of the crosswalk along the road."""
    pedestrian_priority: bool = True
    """A marked crosswalk; SUMO's own driver and pedestrians go by it."""
    lanes: Annotated[int, Field(ge=1, le=6)] = 1
    """Lanes in the ego's direction."""
    oncoming_lanes: Annotated[int, Field(ge=0, le=6)] = 1
    """Lanes towards the ego; 0 is a one-way road."""
    lane_width_m: Annotated[float, Field(ge=1, le=20)] | None = None
    """Width of each lane; without it, the lanes share ``length_m`` evenly.  The rest is a median,
    or half at each kerb of a one-way road."""
    road_speed_limit_mps: Annotated[float, Field(gt=0, le=100)] | None = None
    """Limit that SUMO's own driver and outputs go by; without it, v0."""
    obstacles: Annotated[tuple[ObstacleSection, ...], Field(strict=False)] = ()
    """Parked cars and hedges that hide people."""

    @property
    def width_of_lane_m(self) -> float:
        """``lane_width_m``, or ``length_m`` shared evenly among the lanes of both directions."""
        return self.lane_width_m or self.length_m / (self.lanes + self.oncoming_lanes)

    @property
    def beside_lanes_m(self) -> float:
        """Width that the lanes leave of ``length_m``: a median, or both strips if one-way."""
        if self.lane_width_m is None:
            return 0.0
        rest = self.length_m - (self.lanes + self.oncoming_lanes) * self.lane_width_m
        return rest if rest > ROUNDING_M else 0.0

    @property
    def kerb_strip_m(self) -> float:
        """Width of the strip between each kerb and the lanes: half of the rest if one-way."""
        return 0.0 if self.oncoming_lanes else self.beside_lanes_m / 2

    def lane_centre_m(self, lane: int) -> float:
        """From the near kerb of a direction to the centre of its lane of that number, in m."""
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

    lane: Annotated[int, Field(ge=0)] = 0
    """The ego's lane, counted from the near kerb; below ``crossing.lanes``."""
    initial_speed_mps: Annotated[float, Field(gt=0, le=60)] = 5.0
    """v0."""
    trigger_range_m: Annotated[float, Field(gt=0, le=MAX_TRIGGER_RANGE_M)] = 30.0
    """R0: t = 0 when the front bumper is this far from the centre line; at least half the
    crosswalk's width and 1.5 m."""
    detection_range_m: Positive | None = None
    """How far pedestrians are perceived; without it, the trigger range."""
    length_m: Annotated[float, Field(ge=1, le=25)] = 5.0
    """Length of the vehicle."""
    width_m: Annotated[float, Field(ge=0.5, le=5)] = 1.8
    """Width of the vehicle; at most the lane's."""
    max_acceleration_mps2: Annotated[float, Field(gt=0, le=20)] = 3.0
    """Limit of every strategy's command."""
    max_deceleration_mps2: Annotated[float, Field(gt=0, le=20)] = 4.5
    """Limit of every strategy's command."""
    resume_acceleration_mps2: Annotated[float, Field(gt=0, le=20)] = 1.0
    """a0: back to v0 once the crossing is clear."""


class PerceptionSection(Section):
    """``[perception]``: how the AV's strategy is shown the pedestrians; by default as they are.

    ``human``: the human's arm is shown the same way.
    """

    latency_s: Annotated[float, Field(ge=0, le=60)] = 0.0
    """Age of the news about pedestrians that the strategy is shown; whole steps."""
    update_s: Annotated[float, Field(gt=0, le=60)] | None = None
    """Time between two looks at the pedestrians; whole steps; without it, every step."""
    detection_probability: Share = 1.0
    """Chance at each look to detect somebody; from then on they are tracked."""
    dropout_probability: Share = 0.0
    """Chance at each look that a track is lost and must be found again."""
    position_sd_m: Annotated[float, Field(ge=0, le=100)] = 0.0
    """Standard deviation of the error of the place."""
    speed_sd_mps: Annotated[float, Field(ge=0, le=100)] = 0.0
    """Standard deviation of the error of the speed."""
    correlation_s: NonNegative = 1.0
    """How long errors stay alike."""
    occlusion: bool = True
    """People behind an obstacle are not seen."""
    human: bool = False
    """The human's arm is shown the same way."""

    def is_perfect(self, step_s: float) -> bool:
        """Whether it shows the ground truth at every step, except for whom obstacles hide."""
        no_faults = {"update_s": None, "correlation_s": 1.0, "occlusion": True, "human": False}
        every_step = self.update_s is None or self.update_s < 1.5 * step_s
        return every_step and self.model_copy(update=no_faults) == PerceptionSection()


class ModelSection(Section):
    """``[model]``: the interaction model, a shipped one by ``name`` or a file by ``path``."""

    name: str = "dut"
    """A shipped interaction model."""
    path: str | None = None
    """A model file of your own, in the place of ``name``."""
    pedestrian_reading: Literal["marginal", "curve", "unconditional"] = "marginal"
    """The conditions under which walking speeds are drawn."""
    extrapolate: bool = False
    """Clamp a v0 or R0 outside the model's data, which is else refused."""


def _strategy_name(strategy: Any) -> Any:
    """A class in Python as ``package.module:Class``, by which it is found again.

    One of a script or notebook is ``__main__:Class``: only its own process finds it.
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
    """``[arms]``: which strategy drives in each arm; in Python also as a class."""

    av: StrategyName = "soft_yield"
    """The strategy that drives in the AV's arm."""
    human: StrategyName = "human_gmm"
    """The strategy that drives in the reference's arm."""

    def driver(self, arm: Arm) -> str:
        """The strategy of an arm, by name."""
        return self.av if arm is Arm.AV else self.human


class ConflictsSection(Section):
    """``[conflicts]``: thresholds of the measures beyond which an episode counts as a conflict."""

    ttc_s: NonNegative = 1.5
    """A smaller least time to collision is a conflict."""
    time_advantage_s: NonNegative = 1.5
    """A smaller least time advantage is a conflict."""
    pet_s: NonNegative = 1.5
    """A smaller post-encroachment time is a conflict."""
    drac_mps2: NonNegative = 3.35
    """A greater deceleration rate to avoid a crash is a conflict."""


class ExperimentSection(Section):
    """``[experiment]``: how many pairs, from which seed, at which step."""

    pairs: Annotated[int, Field(ge=1, le=10_000_000)] = 50
    """N; in traffic, hours."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1
    """Root of every random number."""
    step_s: Annotated[float, Field(ge=0.001, le=1)] = 0.1
    """Simulation step; whole milliseconds."""
    timeout_s: Annotated[float, Field(gt=0, le=3600)] = 60.0
    """An episode that has not crossed by then is timed out; whole milliseconds."""
    decide_limit_s: Annotated[float, Field(ge=0.1, le=3600)] = 10.0
    """Wall time a strategy may take for one answer."""


class LimitsSection(Section):
    """``[limits]``: a strategy within them is allowed; used to compare, not to simulate."""

    mu0: Positive | None = None
    """Limit of μ, for ``harness compare``."""
    kappa0: Annotated[float, Field(gt=0, le=1)] | None = None
    """Limit of κ, for ``harness compare``."""


QUARTER_S = 900.0
"""How long each value of a list of flows holds."""

Flow = Annotated[float, Field(ge=0, le=100_000)]


class TrafficSection(Section):
    """``[traffic]``: vehicles over hours in place of one ego.

    ``following``, ``tau_s`` and ``min_gap_m`` are SUMO's car-following model and its headway.
    """

    flow_per_hour: Flow | Annotated[tuple[Flow, ...], Field(strict=False, min_length=1)] = 600.0
    """Vehicles in the first direction; a list has one value for each quarter of an hour."""
    oncoming_per_hour: Flow | Annotated[tuple[Flow, ...], Field(strict=False, min_length=1)] = 600.0
    """Vehicles in the other direction, likewise."""
    av_share: Share = 1.0
    """Share of the vehicles that ``arms.av`` drives in the AV's arm."""
    duration_s: Annotated[float, Field(gt=0, le=7 * 86_400)] = 3600.0
    """How long vehicles and people are counted; whole steps."""
    warm_up_s: Annotated[float, Field(ge=0, le=86_400)] = 300.0
    """How long vehicles and people come before that; whole steps."""
    following: Literal["Krauss", "IDM"] = "Krauss"
    """SUMO's car-following model."""
    tau_s: Positive = 1.0
    """Its headway; at least a step."""
    min_gap_m: NonNegative = 2.0
    """Its least gap to a leader that stands."""
    occupancy: Positive = 1.5
    """Persons in a vehicle, for the delay of all persons."""
    saturated: bool = False
    """A vehicle waits in every lane at all times: measures the capacity."""

    def has_vehicles(self, *, oncoming: bool) -> bool:
        """Whether any vehicle comes in a direction."""
        flow = self.oncoming_per_hour if oncoming else self.flow_per_hour
        return self.saturated or (max(flow) if isinstance(flow, tuple) else flow) > 0
