"""The whole scenario, and the quantities that follow from several of its keys."""

import math

from pydantic import Field, JsonValue

from harness.core.encounter import Crossing, Leg, Side, Vehicle
from harness.measures.motion.walking import timed_path
from harness.scenario.people import PedestriansSection, TimedSection
from harness.scenario.sections import (
    ArmsSection,
    ConflictsSection,
    CrossingSection,
    EgoSection,
    ExperimentSection,
    LimitsSection,
    ModelSection,
    ObstacleSection,
    PerceptionSection,
    Section,
    TrafficSection,
)
from harness.scenario.simulation import SimulationSection


class Scenario(Section):
    """One complete experiment: a run needs nothing else."""

    crossing: CrossingSection = CrossingSection()
    ego: EgoSection = EgoSection()
    pedestrians: PedestriansSection = PedestriansSection()
    perception: PerceptionSection = PerceptionSection()
    model: ModelSection = ModelSection()
    arms: ArmsSection = ArmsSection()
    strategies: dict[str, dict[str, JsonValue]] = Field(default_factory=dict)
    """Parameters of each strategy, by the strategy's name."""
    conflicts: ConflictsSection = ConflictsSection()
    experiment: ExperimentSection = ExperimentSection()
    limits: LimitsSection = LimitsSection()
    traffic: TrafficSection | None = None
    simulation: SimulationSection | None = None

    @property
    def known_traffic(self) -> TrafficSection:
        """The ``[traffic]`` table of a scenario that is known to have one."""
        assert self.traffic is not None
        return self.traffic

    @property
    def known_simulation(self) -> SimulationSection:
        """The ``[simulation]`` table of a scenario that is known to have one."""
        assert self.simulation is not None
        return self.simulation

    @property
    def walks_by_model(self) -> bool:
        """Whether any walking speed is drawn from the interaction model."""
        people = self.pedestrians
        comes = (people.flow_per_hour > 0 or people.first_at_trigger) and people.max_count != 0
        return comes and people.walking_speed is None

    def vehicle(self) -> Vehicle:
        """The ego's constants; the detection range defaults to the trigger range."""
        values = self.ego.model_dump(exclude={"lane"})
        if values["detection_range_m"] is None:
            values["detection_range_m"] = values["trigger_range_m"]
        return Vehicle(**values)

    def crosswalk(self) -> Crossing:
        """The crosswalk's constants for the ego's lane."""
        crossing, number = self.crossing, self.ego.lane
        centre_m = crossing.lane_centre_m(number)
        if crossing.read is not None:
            centre_m = crossing.read.lane_centre_m
        return self._seen_from(number, centre_m, crossing.width_of_lane_m)

    def crosswalk_from_lanes(self, *, oncoming: bool) -> tuple[Crossing, ...]:
        """The crosswalk's constants for each lane of a direction, counted from its near kerb."""
        crossing = self.crossing
        if crossing.read is None:
            count = crossing.oncoming_lanes if oncoming else crossing.lanes
            lanes = [(crossing.lane_centre_m(n), crossing.width_of_lane_m) for n in range(count)]
        else:
            far_m = crossing.length_m
            lanes = [
                (far_m - way.centre_m if oncoming else way.centre_m, way.width_m)
                for way in crossing.read.ways
                if way.oncoming is oncoming
            ]
        return tuple(self._seen_from(number, *lane) for number, lane in enumerate(lanes))

    @property
    def speed_limit_mps(self) -> float:
        """The road's speed limit, or v0 if none is given."""
        return self.crossing.road_speed_limit_mps or self.ego.initial_speed_mps

    def _seen_from(self, lane: int, centre_m: float, width_m: float) -> Crossing:
        crossing, limit_mps = self.crossing, None
        if crossing.read is None:
            limit_mps = self.speed_limit_mps
        return Crossing(
            length_m=crossing.length_m,
            width_m=crossing.width_m,
            lane_centre_m=centre_m,
            lane_width_m=width_m,
            lane=lane,
            speed_limit_mps=limit_mps,
        )

    def least_headway_s(self) -> float:
        """Shortest headway of vehicles that do not disturb each other at v0; whole steps.

        The following distance of SUMO's Krauss model at v0: tau_s + (length + min_gap_m)/v0.
        """
        traffic = self.known_traffic
        spaced_m = self.ego.length_m + traffic.min_gap_m
        headway_s = traffic.tau_s + spaced_m / self.ego.initial_speed_mps
        step_s = self.experiment.step_s
        return math.ceil(headway_s / step_s - 1e-9) * step_s

    def timed_walks(self) -> tuple[tuple[Side, tuple[Leg, ...]], ...]:
        """Side and path of each timed pedestrian of ``timed_case``; of all if it is not given."""
        case = self.pedestrians.timed_case
        return tuple(
            (Side(timed.side), path_of(timed, self))
            for timed in self.pedestrians.timed
            if case is None or timed.name == case
        )

    def obstacles(self) -> tuple[ObstacleSection, ...]:
        """The obstacles of ``timed_case``; all of them if it is not given."""
        case = self.pedestrians.timed_case
        return tuple(o for o in self.crossing.obstacles if case is None or o.case in (None, case))


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
