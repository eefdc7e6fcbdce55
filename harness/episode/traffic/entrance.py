"""Scheduled vehicles in; vehicles on the road out, as soon as there is room, at a safe speed."""

import math
from collections.abc import Callable

from harness.core.encounter import Strategy, Vehicle
from harness.engine.road import SumoRoad
from harness.episode.traffic.demand import Scheduled
from harness.episode.traffic.vehicles import HourVehicle, LaneOnRoad, state_of
from harness.scenario import TrafficSection

MakeStrategy = Callable[[Scheduled], tuple[bool, str, Strategy]]
"""Returns whether a vehicle is an AV, the name of its strategy, and a new strategy object."""


class Entrance:
    """Inserts the vehicles of an hour, lane by lane.

    ``x_m`` has each lane's position of entry (``Stream.entry_x_m``); None if there is none.
    """

    def __init__(
        self,
        road: SumoRoad,
        vehicle: Vehicle,
        traffic: TrafficSection,
        step_s: float,
        make: MakeStrategy,
    ) -> None:
        self._road, self._vehicle, self._traffic = road, vehicle, traffic
        self._step_s, self._make = step_s, make
        per_step_m = vehicle.initial_speed_mps * step_s
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
            assert x_m is not None
            lane.due.append(
                HourVehicle(
                    planned, self._road.name_of(planned.number), automated, name, strategy, x_m
                )
            )
            lane.plan_next()
        if not lane.due or (saturated and step > until_step):
            return None
        car = lane.due[0]
        speed = self._entry_speed(lane, car.insert_x_m)
        if speed is None:
            return None
        lane.due.popleft()
        car.inserted_step = step
        car.x_m, car.speed_mps = car.insert_x_m, speed
        self._road.add(car.name, lane.number, car.insert_x_m, speed, automated=car.automated)
        lane.coming.append(car)
        return car

    def _entry_speed(self, lane: LaneOnRoad, x_m: float) -> float | None:
        """v0, or a lower speed that is safe behind a slow leader; None while there is no room.

        There is room if the leader's rear is minGap and the headway τ at v0 ahead.  The safe speed
        is v = −bτ + sqrt(b²τ² + v_l² + 2 b g), where g is the gap less minGap (Krauss 1998).
        """
        vehicle, traffic = self._vehicle, self._traffic
        top = vehicle.initial_speed_mps
        if not lane.coming and not lane.driven:
            return top
        x, speed = state_of(self._road, lane.coming[-1] if lane.coming else lane.driven[-1])
        gap = x + speed * self._step_s - vehicle.length_m - x_m - traffic.min_gap_m
        if gap < top * traffic.tau_s - 1e-6:
            return None
        braking = vehicle.max_deceleration_mps2 * traffic.tau_s
        safe = -braking + math.sqrt(braking**2 + speed**2 + 2 * vehicle.max_deceleration_mps2 * gap)
        return min(top, safe)
