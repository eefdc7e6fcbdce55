"""The scenario: every key of a scenario file with its default, frozen and checked by itself."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, JsonValue

from harness.encounter import Behaviour, Crossing, Leg, Side, Vehicle
from harness.motion.walking import timed_path

MAX_TRIGGER_RANGE_M = 300.0
"""Longest range at which the ego can be inserted: the approach road of every network is as long."""

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class CrossingSection(_Section):
    """``[crossing]``: the place and shape of the crosswalk."""

    latitude_deg: Annotated[float, Field(ge=-80, le=84)] = 42.278415
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] = -83.735580
    bearing_deg: Annotated[float, Field(ge=0, lt=360)] = 316.5
    length_m: Annotated[float, Field(ge=4, le=40)] = 9.0
    width_m: Annotated[float, Field(ge=1, le=20)] = 4.0
    pedestrian_priority: bool = True


class EgoSection(_Section):
    """``[ego]``: the vehicle, the same in both arms."""

    initial_speed_mps: Annotated[float, Field(gt=0, le=60)] = 5.0
    trigger_range_m: Annotated[float, Field(gt=0, le=MAX_TRIGGER_RANGE_M)] = 30.0
    detection_range_m: Positive | None = None
    length_m: Annotated[float, Field(ge=1, le=25)] = 5.0
    width_m: Annotated[float, Field(ge=0.5, le=5)] = 1.8
    max_acceleration_mps2: Annotated[float, Field(gt=0, le=20)] = 3.0
    max_deceleration_mps2: Annotated[float, Field(gt=0, le=20)] = 4.5
    resume_acceleration_mps2: Annotated[float, Field(gt=0, le=20)] = 1.0


class TimedSection(_Section):
    """``[[pedestrians.timed]]``: someone whom a car that never brakes would hit."""

    name: str = ""
    side: Literal["near", "far"]
    start_lateral_m: Positive
    acceleration_distance_m: NonNegative = 0.0
    speed_mps: Annotated[float, Field(gt=0, le=10)]
    impact_share: Share


class GapAcceptanceSection(_Section):
    """``[pedestrians.gap_acceptance]``: the distribution of critical gaps."""

    distribution: Literal["lognormal", "logistic"] = "lognormal"
    mean_s: Positive = 4.0
    std_s: NonNegative = 2.5


class PedestriansSection(_Section):
    """``[pedestrians]``: who comes, from where, how they decide and walk."""

    flow_per_hour: Annotated[float, Field(ge=0, le=100_000)] = 250.0
    max_count: Annotated[int, Field(ge=0)] | None = None
    first_at_trigger: bool = False
    near_side_share: Share = 0.5
    kerb_wait_s: NonNegative = 2.0
    pairing: Literal["quantile", "speed"] = "quantile"
    behaviour: Behaviour = "constant"
    gap_acceptance: GapAcceptanceSection = GapAcceptanceSection()
    timed: Annotated[tuple[TimedSection, ...], Field(strict=False)] = ()
    timed_case: str | None = None


class ModelSection(_Section):
    """``[model]``: the interaction model, a shipped one by ``name`` or a file by ``path``."""

    name: str = "dut"
    path: str | None = None
    pedestrian_reading: Literal["marginal", "curve"] = "marginal"


class ArmsSection(_Section):
    """``[arms]``: which strategy drives in each arm."""

    av: str = "soft_yield"
    human: str = "human_gmm"


class ConflictsSection(_Section):
    """``[conflicts]``: thresholds of the measures beyond which an episode counts as a conflict."""

    ttc_s: NonNegative = 1.5
    time_advantage_s: NonNegative = 1.5
    pet_s: NonNegative = 1.5
    drac_mps2: NonNegative = 3.35


class ExperimentSection(_Section):
    """``[experiment]``: how many pairs, from which seed, at which step."""

    pairs: Annotated[int, Field(ge=1, le=10_000_000)] = 50
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1
    step_s: Annotated[float, Field(ge=0.001, le=1)] = 0.1
    timeout_s: Annotated[float, Field(gt=0, le=3600)] = 60.0


class LimitsSection(_Section):
    """``[limits]``: below which a strategy is allowed; for comparing, no part of a simulation."""

    mu0: Positive | None = None
    kappa0: Annotated[float, Field(gt=0, le=1)] | None = None


class Scenario(_Section):
    """One experiment, complete: what a run of it needs and nothing else."""

    crossing: CrossingSection = CrossingSection()
    ego: EgoSection = EgoSection()
    pedestrians: PedestriansSection = PedestriansSection()
    model: ModelSection = ModelSection()
    arms: ArmsSection = ArmsSection()
    strategies: dict[str, dict[str, JsonValue]] = Field(default_factory=dict)
    conflicts: ConflictsSection = ConflictsSection()
    experiment: ExperimentSection = ExperimentSection()
    limits: LimitsSection = LimitsSection()

    def vehicle(self) -> Vehicle:
        """The ego's constants; the detection range defaults to the trigger range."""
        values = self.ego.model_dump()
        if values["detection_range_m"] is None:
            values["detection_range_m"] = values["trigger_range_m"]
        return Vehicle(**values)

    def crosswalk(self) -> Crossing:
        """The crosswalk's constants."""
        return Crossing(self.crossing.length_m, self.crossing.width_m)

    def timed_walks(self) -> tuple[tuple[Side, tuple[Leg, ...]], ...]:
        """Side and path of every timed pedestrian of the case, or of all where none is named."""
        case = self.pedestrians.timed_case
        return tuple(
            (Side(timed.side), path_of(timed, self))
            for timed in self.pedestrians.timed
            if case is None or timed.name == case
        )


def path_of(timed: TimedSection, scenario: Scenario) -> tuple[Leg, ...]:
    """The walk of a timed pedestrian; see ``timed_path``."""
    return timed_path(
        Side(timed.side),
        timed.start_lateral_m,
        timed.acceleration_distance_m,
        timed.speed_mps,
        timed.impact_share,
        scenario.vehicle(),
        scenario.crosswalk(),
    )
