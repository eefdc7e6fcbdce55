"""A vehicle on its way, a lane with its vehicles in order, and the record of an hour."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from harness.core.encounter import PedestrianView, Side, Strategy, Walk
from harness.engine.road import SumoRoad
from harness.episode.cell_constants import CellConstants
from harness.episode.deciding import ROUNDING_M
from harness.episode.traffic.demand import Scheduled
from harness.episode.traffic.lanes import Lane
from harness.episode.walkers import Walker
from harness.scenario import TrafficSection

LEAST_CLEARING_S = 900.0


@dataclass(slots=True, eq=False)
class HourVehicle:
    """A vehicle from its schedule until it has left the road; times are steps of the hour.

    ``x_m``, ``speed_mps``: the state at the beginning of the step; ``next_x_m``,
    ``next_speed_mps``: at its end, once it is read, with ``acceleration_mps2``, which until then is
    the last step's.  ``xs``, ``speeds``: the states from ``first_step`` on, when its strategy took
    over, ``trace_offset_s`` after its bumper was at R0, until its rear has left the crosswalk.
    """

    plan: Scheduled
    name: str
    automated: bool
    strategy_name: str
    strategy: Strategy
    insert_x_m: float
    inserted_step: int | None = None
    x_m: float = 0.0
    speed_mps: float = 0.0
    acceleration_mps2: float = 0.0
    next_x_m: float = 0.0
    next_speed_mps: float = 0.0
    first_step: int | None = None
    trace_offset_s: float = 0.0
    passed: bool = False
    by_engine: bool = False
    gone_step: int | None = None
    collided: bool = False
    stops: int = 0
    """Stops before R0, seen at the queues' samples."""
    standing: bool = False
    xs: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    path: list[tuple[int, float, float]] = field(default_factory=list)
    """Step, x and speed at the samples before ``first_step`` and after it has passed, if noted."""
    met: list[Walker] = field(default_factory=list)
    """Everyone at the crosswalk when its strategy took over."""
    came_from: int = 0
    came_until: int = 0
    """The hour's walks that began while it drove: numbers in order of arrival."""


class LaneOnRoad:
    """One lane during an hour.

    ``due``: scheduled, not yet on the road; ``coming``: upstream of R0, driven by SUMO; ``driven``:
    from R0 until past the crosswalk, driven by their strategies.  Each in order.  ``passed_at_m``:
    x at which the rear has left the crosswalk.
    """

    def __init__(
        self, number: int, lane: Lane, schedule: Iterator[Scheduled], rules: CellConstants
    ) -> None:
        self.number, self.lane, self.schedule = number, lane, schedule
        self.centre_m = lane.centre_m
        self.passed_at_m = rules.vehicle.length_m + rules.crossing.width_m / 2 - ROUNDING_M
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
            own is not side or ahead != 0 for side, (own, ahead) in self._shift.items()
        )

    def plan_next(self) -> None:
        """Look up who is scheduled next, and in which step; nobody ever: in an infinite one."""
        self.next_scheduled = next(self.schedule, None)
        self.next_step = math.inf if self.next_scheduled is None else self.next_scheduled.step

    def first(self, elapsed_s: float) -> tuple[float, float, HourVehicle] | None:
        """x, speed and vehicle of the first that has not passed, so far into the step."""
        for car in self.driven:
            gain = car.acceleration_mps2
            x = car.x_m + car.speed_mps * elapsed_s + gain * elapsed_s**2 / 2
            if x < self.passed_at_m:
                return x, car.speed_mps + gain * elapsed_s, car
        if not self.coming:
            return None
        head = self.coming[0]
        gain = head.acceleration_mps2
        x = head.x_m + head.speed_mps * elapsed_s + gain * elapsed_s**2 / 2
        return x, head.speed_mps + gain * elapsed_s, head

    def seen_from(self, views: tuple[PedestrianView, ...]) -> tuple[PedestrianView, ...]:
        """Views from the ego's lane as this lane's vehicles see them."""
        if not self._own_frame:
            return views
        shift = self._shift
        seen = []
        for index, side, lateral_m, remaining_m, speed_mps, on_crossing in views:
            own, ahead_m = shift[side]
            lateral_m += ahead_m
            seen.append(PedestrianView(index, own, lateral_m, remaining_m, speed_mps, on_crossing))
        return tuple(seen)


@dataclass(slots=True)
class HourLog:
    """The events of an hour; times are steps from the beginning of the warm-up.

    ``queues`` has, for each second of the counted time, the queued vehicles of each lane.
    ``let_go``: of each who had to wait, whether the first vehicle that kept them waiting let them
    go.
    """

    vehicles: list[HourVehicle] = field(default_factory=list)
    walks: list[Walk] = field(default_factory=list)
    queues: list[list[int]] = field(default_factory=list)
    let_go: dict[int, bool] = field(default_factory=dict)
    last_step: int = 0


def state_of(road: SumoRoad, car: HourVehicle) -> tuple[float, float]:
    """x and speed of a vehicle on the road."""
    x = car.insert_x_m + road.distance_of(car.name)
    return x, road.speed_of(car.name)


def clearing_s(traffic: TrafficSection) -> float:
    """How long after the counted time the road may take to empty; a permanent queue never does."""
    return 0.0 if traffic.saturated else max(traffic.duration_s, LEAST_CLEARING_S)
