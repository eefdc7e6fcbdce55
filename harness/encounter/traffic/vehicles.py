"""The state of an hour: its vehicles, its lanes with their vehicles in order, and its log."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from harness.core.actuation import Actuator
from harness.core.encounter import PedestrianView, Side, Strategy, Vehicle, Walk
from harness.encounter.cell_constants import CellConstants
from harness.encounter.traffic.demand import Scheduled
from harness.encounter.traffic.lanes import Lane
from harness.encounter.walkers import Walker
from harness.engine.road import SumoRoad
from harness.scenario import TrafficSection
from harness.strategies.perception.updates import Updates, Views

LEAST_CLEARING_S = 900.0


@dataclass(slots=True, eq=False)
class HourVehicle:
    """A vehicle, from its schedule until it has left the road; times are steps of the hour.

    Attributes:
        vehicle: the constants of its type.
        passed_at_m: x at which its rear has left the crosswalk.
        x_m, speed_mps: the state at the beginning of the step.
        next_x_m, next_speed_mps: the state at the end of the step, once it has been read.
        acceleration_mps2: the acceleration of this step, once it has been read; before that, that
            of the last step.
        first_step: when its strategy took over.
        actuator: what passes its strategy's commands on to it, if it obeys late.
        trace_offset_s: time from the moment its front bumper reached R0 until ``first_step``.
        xs, speeds: the states from ``first_step`` until its rear has left the crosswalk.
    """

    plan: Scheduled
    name: str
    automated: bool
    strategy_name: str
    strategy: Strategy
    insert_x_m: float
    vehicle: Vehicle
    passed_at_m: float
    inserted_step: int | None = None
    x_m: float = 0.0
    speed_mps: float = 0.0
    acceleration_mps2: float = 0.0
    next_x_m: float = 0.0
    next_speed_mps: float = 0.0
    first_step: int | None = None
    actuator: Actuator | None = None
    trace_offset_s: float = 0.0
    passed: bool = False
    gone_step: int | None = None
    collided: bool = False
    stops: int = 0
    """Stops before R0, observed once per second."""
    standing: bool = False
    xs: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    path: list[tuple[int, float, float]] = field(default_factory=list)
    """Step, x and speed once per second outside of its passage, if they are recorded."""
    met: list[Walker] = field(default_factory=list)
    """The pedestrians at the crosswalk when its strategy took over."""
    updates: Updates | None = None
    """The updates of its sensor; None if its driver sees the ground truth."""
    shown: list[Views] | None = None
    """What its driver was shown at each step, with a sensor."""
    came_from: int = 0
    came_until: int = 0
    """The pedestrians who arrived during its passage: a half-open range of arrival numbers."""


class LaneOnRoad:
    """A lane during an hour, with its vehicles in order.

    Attributes:
        due: vehicles that are due and not yet on the road.
        coming: vehicles upstream of R0, which SUMO drives.
        driven: vehicles from R0 until they have passed, which their strategies drive.
    """

    def __init__(
        self, number: int, lane: Lane, schedule: Iterator[Scheduled], rules: CellConstants
    ) -> None:
        self.number, self.lane, self.schedule = number, lane, schedule
        self.centre_m = lane.centre_m
        half_m = lane.crossing.lane_width_m / 2
        self.edges_m = (lane.centre_m - half_m, lane.centre_m + half_m)
        self.plan_next()
        self.due: deque[HourVehicle] = deque()
        self.coming: deque[HourVehicle] = deque()
        self.driven: list[HourVehicle] = []
        self._shift = {
            side: (
                lane.own_side(side),
                lane.crossing.to_lane_m(lane.own_side(side)) - rules.crossing.to_lane_m(side),
            )
            for side in Side
        }
        self._own_frame = any(
            lane_side is not side or ahead_m != 0
            for side, (lane_side, ahead_m) in self._shift.items()
        )

    def plan_next(self) -> None:
        """Set the next scheduled vehicle and its step; the step is infinite if there is none."""
        self.next_scheduled = next(self.schedule, None)
        self.next_step = math.inf if self.next_scheduled is None else self.next_scheduled.step

    def ahead(self, elapsed_s: float) -> Iterator[tuple[float, float, HourVehicle]]:
        """See ``LaneAhead.ahead``."""
        for car in self.driven:
            gain = car.acceleration_mps2
            x = car.x_m + car.speed_mps * elapsed_s + gain * elapsed_s**2 / 2
            if x < car.passed_at_m:
                yield x, car.speed_mps + gain * elapsed_s, car
        if self.coming:
            head = self.coming[0]
            gain = head.acceleration_mps2
            x = head.x_m + head.speed_mps * elapsed_s + gain * elapsed_s**2 / 2
            yield x, head.speed_mps + gain * elapsed_s, head

    def first(self, elapsed_s: float) -> tuple[float, float, HourVehicle] | None:
        """See ``LaneAhead.first``."""
        return next(self.ahead(elapsed_s), None)

    def seen_from(self, views: tuple[PedestrianView, ...]) -> tuple[PedestrianView, ...]:
        """The views of this lane's vehicles, from the views of the ego's lane."""
        if not self._own_frame:
            return views
        shift = self._shift
        shifted = []
        for index, side, lateral_m, remaining_m, speed_mps, on_crossing in views:
            lane_side, ahead_m = shift[side]
            lateral_m += ahead_m
            shifted.append(
                PedestrianView(index, lane_side, lateral_m, remaining_m, speed_mps, on_crossing)
            )
        return tuple(shifted)


@dataclass(slots=True)
class HourLog:
    """The events of an hour; times are steps from the beginning of the warm-up.

    Attributes:
        vehicles: all vehicles.
        walks: the walks of all pedestrians, by arrival.
        queues: for each second of the counted time, the number of queued vehicles of each lane.
        queues_m: with a vehicle mix, the lengths of these queues in m: the sum of each vehicle's
            length and ``min_gap_m``.
        let_go: for each pedestrian who had to wait, whether they went before the first vehicle that
            kept them waiting.
        last_step: the last simulated step.
    """

    vehicles: list[HourVehicle] = field(default_factory=list)
    walks: list[Walk] = field(default_factory=list)
    queues: list[list[int]] = field(default_factory=list)
    queues_m: list[list[float]] = field(default_factory=list)
    let_go: dict[int, bool] = field(default_factory=dict)
    last_step: int = 0


def state_of(road: SumoRoad, car: HourVehicle) -> tuple[float, float]:
    """x and speed of a vehicle on the road."""
    x = car.insert_x_m + road.distance_of(car.name)
    return x, road.speed_of(car.name)


def clearing_s(traffic: TrafficSection) -> float:
    """The time allowed for the road to empty after the counted time; 0 for saturated lanes."""
    return 0.0 if traffic.saturated else max(traffic.duration_s, LEAST_CLEARING_S)
