"""The whole scenario, and the quantities that follow from several of its keys."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, JsonValue, PlainSerializer, model_validator

from harness.core.documents import as_plain
from harness.core.freezing import frozen
from harness.core.vocabulary import PEDESTRIAN_RADIUS_M, ROUNDING, Arm, Crossing, Leg, Side, Vehicle
from harness.scenario import sections
from harness.scenario.pedestrians import PedestriansSection, TimedSection
from harness.scenario.traffic import TrafficSection

_Tables = Annotated[
    Mapping[str, Mapping[str, JsonValue]], AfterValidator(frozen), PlainSerializer(as_plain)
]


class Scenario(sections.Section):
    """One complete experiment: a run needs nothing else."""

    crossing: sections.CrossingSection = sections.CrossingSection()
    ego: sections.EgoSection = sections.EgoSection()
    pedestrians: PedestriansSection = PedestriansSection()
    perception: sections.PerceptionSection = sections.PerceptionSection()
    actuation: sections.ActuationSection = sections.ActuationSection()
    model: sections.ModelSection = sections.ModelSection()
    arms: sections.ArmsSection = sections.ArmsSection()
    strategies: _Tables = Field(default_factory=lambda: frozen({}))
    """Parameters of each strategy, by the strategy's name."""
    conflicts: sections.ConflictsSection = sections.ConflictsSection()
    experiment: sections.ExperimentSection = sections.ExperimentSection()
    traffic: TrafficSection | None = None
    simulation: sections.SimulationSection | None = None

    @model_validator(mode="before")
    @classmethod
    def _whose_people(cls, keys: Any) -> Any:
        """The keys; with ``[simulation]`` SUMO's people come, the harness's if a flow is given."""
        people = keys.get("pedestrians", {})
        if keys.get("simulation") is None or not isinstance(people, Mapping):
            return keys
        return {**keys, "pedestrians": {"flow_per_hour": 0.0, **people}}

    @property
    def known_traffic(self) -> TrafficSection:
        """The ``[traffic]`` table of a scenario that is known to have one."""
        assert self.traffic is not None
        return self.traffic

    @property
    def known_simulation(self) -> sections.SimulationSection:
        """The ``[simulation]`` table of a scenario that is known to have one."""
        assert self.simulation is not None
        return self.simulation

    @property
    def kind(self) -> Literal["encounters", "simulations"]:
        """The kind of run: the key of every literal table of kinds."""
        return "simulations" if self.traffic or self.simulation else "encounters"

    @property
    def walks_by_model(self) -> bool:
        """Whether any walking speed is drawn from the interaction model."""
        return self.pedestrians.anyone_comes and self.pedestrians.walking_speed is None

    @property
    def av_drives_alone(self) -> bool:
        """Whether no reference drives in the AV's arm, so that it is the same with any reference.

        In simulations the reference may drive vehicles that are not of ``av_types``.
        """
        return self.simulation is None and (self.traffic is None or self.traffic.av_share == 1)

    def vehicle(self, driver: Arm | None = None, *, oncoming: bool = False) -> Vehicle:
        """The ego's constants on this road; the detection range defaults to the trigger range.

        With a driver the vehicle obeys as late as that driver's does.
        """
        values = self.ego.model_dump(exclude={"lane"})
        if values["detection_range_m"] is None:
            values["detection_range_m"] = values["trigger_range_m"]
        vehicle = sections.on_road(Vehicle(**values), self.crossing, oncoming=oncoming)
        if driver is None or not self.actuation.applies_to(driver):
            return vehicle
        return replace(vehicle, **self.actuation.model_dump(exclude={"human"}))

    def mirrored(self) -> "Scenario":
        """The scenario in which people of the near kerb come from the far one, and vice versa."""
        people = self.pedestrians
        exchanged = people.model_copy(update={"near_side_share": 1 - people.near_side_share})
        return self.model_copy(update={"pedestrians": exchanged})

    def crosswalk(self, lane: int | None = None) -> Crossing:
        """The crosswalk's constants for a lane, counted from its near kerb; None: the ego's."""
        crossing, lane = self.crossing, self.ego.lane if lane is None else lane
        return Crossing(
            length_m=crossing.length_m,
            width_m=crossing.width_m,
            lane_centre_m=crossing.lane_centre_m(lane),
            lane_width_m=crossing.width_of_lane_m,
            lane=lane,
            speed_limit_mps=self.speed_limit_mps,
        )

    @property
    def speed_limit_mps(self) -> float:
        """The road's speed limit, or v0 if none is given."""
        limit_mps = self.crossing.road_speed_limit_mps
        return self.ego.initial_speed_mps if limit_mps is None else limit_mps

    def least_headway_s(self) -> float:
        """Shortest headway at which a vehicle does not disturb the next at v0; whole steps.

        The following distance of SUMO's Krauss model at v0: tau_s + (length + min_gap_m)/v0.  The
        mean headway must be longer.
        """
        traffic, ego, step_s = self.known_traffic, self.ego, self.experiment.step_s
        headway_s = traffic.tau_s + (ego.length_m + traffic.min_gap_m) / ego.initial_speed_mps
        return math.ceil(headway_s / step_s - ROUNDING) * step_s

    def timed_walks(self) -> tuple[tuple[Side, tuple[Leg, ...]], ...]:
        """Side and path of each timed pedestrian of ``timed_case``; of all cases if not given."""
        case = self.pedestrians.timed_case
        return tuple(
            (Side(timed.side), path_of(timed, self))
            for timed in self.pedestrians.timed
            if case is None or timed.name == case
        )

    def obstacles(self) -> tuple[sections.ObstacleSection, ...]:
        """The obstacles of ``timed_case``; all of them if it is not given."""
        case = self.pedestrians.timed_case
        return tuple(o for o in self.crossing.obstacles if case is None or o.case in (None, case))


def path_of(timed: TimedSection, scenario: Scenario) -> tuple[Leg, ...]:
    """The walk of a pedestrian who is hit at a given share of the car's width if it does not brake.

    They accelerate uniformly from rest to v_p over the distance d_a and keep that speed.  The
    front touches their disc at T = (R0 − radius)/v0; their centre is then at
    L = width · (½ − share) from the car's centre line.  So they start at T − t.
    Here t is the time they need for d = start − L:
    sqrt(2 d/a) with a = v_p²/2d_a while d ≤ d_a, else 2 d_a/v_p + (d − d_a)/v_p.

    Returns:
        One leg, or two if they accelerate.  The time of the first leg is negative if they have to
        start before the trigger.

    Source: Euro NCAP, Test Protocol AEB/LSS VRU Systems (v4.5.1, 2024), cases CPNA and CPFA.
    """
    vehicle, crossing = scenario.vehicle(), scenario.crosswalk()
    contact_s = (vehicle.trigger_range_m - PEDESTRIAN_RADIUS_M) / vehicle.initial_speed_mps
    distance_m = timed.start_lateral_m - vehicle.width_m * (0.5 - timed.impact_share)
    direction, speed_mps = (1.0 if timed.side == "near" else -1.0), timed.speed_mps
    y_m = crossing.lane_centre_m - direction * timed.start_lateral_m
    velocity = direction * speed_mps
    if timed.acceleration_distance_m == 0:
        return (Leg(contact_s - distance_m / speed_mps, 0.0, y_m, 0.0, velocity, 0.0),)
    acceleration = speed_mps**2 / (2 * timed.acceleration_distance_m)
    accelerating_s = speed_mps / acceleration
    if distance_m <= timed.acceleration_distance_m:
        walking_s = math.sqrt(2 * distance_m / acceleration)
    else:
        walking_s = accelerating_s + (distance_m - timed.acceleration_distance_m) / speed_mps
    start_s = contact_s - walking_s
    steady_y_m = y_m + direction * timed.acceleration_distance_m
    return (
        Leg(start_s, 0.0, y_m, 0.0, 0.0, direction * acceleration),
        Leg(start_s + accelerating_s, 0.0, steady_y_m, 0.0, velocity, 0.0),
    )
