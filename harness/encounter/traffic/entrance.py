"""Takes scheduled vehicles and inserts each at a safe speed as soon as there is room."""

import math
from collections.abc import Callable

from harness.core.encounter import Arm, Strategy, Vehicle
from harness.encounter.cell_constants import CellConstants
from harness.encounter.deciding import ROUNDING_M
from harness.encounter.traffic.demand import Scheduled
from harness.encounter.traffic.lanes import Direction
from harness.encounter.traffic.vehicles import HourVehicle, LaneOnRoad, state_of
from harness.engine.road import SumoRoad
from harness.scenario import TrafficSection

MakeStrategy = Callable[[Scheduled], tuple[bool, str, Strategy]]
"""Returns whether a vehicle is an AV, the name of its strategy, and a new strategy object."""


class Entrance:
    """Inserts the vehicles of an hour, lane by lane.

    ``x_m`` has each lane's position of entry.
    """

    def __init__(
        self,
        road: SumoRoad,
        rules: CellConstants,
        traffic: TrafficSection,
        make: MakeStrategy,
    ) -> None:
        self._road, self._traffic, self._make = road, traffic, make
        self._step_s, self._types = rules.step_s, rules.types or (rules.vehicle,)
        self._driven = rules.driven
        half_m = rules.crossing.width_m / 2
        self._passed_at_m = [kind.length_m + half_m - ROUNDING_M for kind in self._types]
        vehicle = rules.vehicle
        per_step_m = vehicle.initial_speed_mps * rules.step_s
        self.x_m = [lane.entry_x_m(vehicle.trigger_range_m, per_step_m) for lane in road.lanes]

    def let_in(self, lane: LaneOnRoad, step: int, until_step: int) -> HourVehicle | None:
        """Insert a lane's next vehicle at the end of this step, if it is due and has room.

        Saturated lanes get no vehicle after ``until_step``.
        """
        saturated = self._traffic.saturated
        while (planned := lane.next_scheduled) is not None and planned.step <= step:
            if saturated and lane.due:
                break
            automated, name, strategy = self._make(planned)
            x_m = self.x_m[lane.number]
            kind, sumo_name = planned.kind, self._road.name_of(planned.number)
            lane.due.append(
                HourVehicle(
                    planned,
                    sumo_name,
                    automated,
                    name,
                    strategy,
                    x_m,
                    self._vehicle(planned, automated=automated),
                    self._passed_at_m[kind],
                )
            )
            lane.plan_next()
        if not lane.due or (saturated and step > until_step):
            return None
        car = lane.due[0]
        speed = self._entry_speed(lane, car)
        if speed is None:
            return None
        lane.due.popleft()
        car.inserted_step = step
        car.x_m, car.speed_mps = car.insert_x_m, speed
        self._road.add(
            car.name,
            lane.number,
            car.insert_x_m,
            speed,
            automated=car.automated,
            kind=car.plan.kind,
        )
        if car.vehicle.max_deceleration_mps2 != self._types[car.plan.kind].max_deceleration_mps2:
            # SUMO's types have the limits of the ego's direction.
            self._road.limit(car.name, car.vehicle)
        lane.coming.append(car)
        return car

    def _vehicle(self, planned: Scheduled, *, automated: bool) -> Vehicle:
        driver = Arm.AV if automated else Arm.HUMAN
        oncoming = planned.lane.direction is Direction.ONCOMING
        return self._driven.get((driver, oncoming), self._types)[planned.kind]

    def _entry_speed(self, lane: LaneOnRoad, car: HourVehicle) -> float | None:
        """v0, or a lower speed that is safe behind a slow leader; None while there is no room.

        There is room if the leader's rear is at least minGap + v0 τ ahead.  The safe speed is
        v = −bτ + sqrt(b²τ² + v_l² b/max(b, b_l) + 2 b g), where g is the gap minus minGap and b_l
        is the leader's deceleration (Krauss 1998, as in SUMO).
        """
        vehicle, traffic = car.vehicle, self._traffic
        top = vehicle.initial_speed_mps
        if not lane.coming and not lane.driven:
            return top
        leader = lane.coming[-1] if lane.coming else lane.driven[-1]
        x, speed = state_of(self._road, leader)
        ahead = leader.vehicle
        gap = x + speed * self._step_s - ahead.length_m - car.insert_x_m - traffic.min_gap_m
        if gap < top * traffic.tau_s - 1e-6:
            return None
        own = vehicle.max_deceleration_mps2
        braking, harder = own * traffic.tau_s, max(own, ahead.max_deceleration_mps2)
        safe = -braking + math.sqrt(braking**2 + speed**2 * (own / harder) + 2 * own * gap)
        return min(top, safe)
