"""The simulation of an hour of traffic in one arm: lanes, arrivals and strategies in, a log out.

An encounter has its own loop (``harness.encounter.loop``), which is faster because it has a single
vehicle.  Pedestrians (``harness.encounter.crowd``), strategies and command limits are the same.
"""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from harness.core.actuation import actuator_of
from harness.core.encounter import Arm, Arrival, EgoView, Observation
from harness.core.errors import StrategyError
from harness.encounter.cell_constants import CellConstants
from harness.encounter.crowd import Crowd
from harness.encounter.deciding import ROUNDING_M, limited, strategy_raised
from harness.encounter.traffic.entrance import Entrance, MakeStrategy
from harness.encounter.traffic.seeing import HourSight
from harness.encounter.traffic.vehicles import (
    HourLog,
    HourVehicle,
    LaneOnRoad,
    clearing_s,
    state_of,
)
from harness.encounter.walkers import ChooseSpeed
from harness.engine.control import COLLISION_REACH_M
from harness.engine.road import SumoRoad
from harness.measures.efficiency import STANDING_MPS
from harness.scenario import TrafficSection
from harness.strategies.perception.sensor import Sensor

QUEUED_MPS = 5 / 3.6
"""A vehicle below this speed is queued (5 km/h, as in SUMO's queue output)."""

SAMPLE_S = 1.0
"""Time between two samples of the queues."""


class Hour:
    """An hour of one arm of a pair.

    Args:
        road: SUMO, for the same site, vehicle and step length.
        lanes: all lanes with their schedules, by number.
        arrivals: all pedestrians, by arrival time from the beginning of the warm-up.
        choose_speed: see ``run_episode``.
        make: makes the strategy of a vehicle.
        rules: the cell's constants.
        traffic: durations and car following.
        sensors: the sensor of each driver; without any, all see the ground truth.
        pair: index of the pair, which keys the sensors' streams.
        paths: whether to record vehicles' positions outside of their passages.
    """

    def __init__(
        self,
        road: SumoRoad,
        lanes: Sequence[LaneOnRoad],
        arrivals: Sequence[Arrival],
        choose_speed: ChooseSpeed,
        make: MakeStrategy,
        rules: CellConstants,
        traffic: TrafficSection,
        *,
        sensors: Mapping[Arm, Sensor | None] = MappingProxyType({}),
        pair: int = 0,
        paths: bool = False,
    ) -> None:
        self.road, self.lanes, self.rules, self.traffic = road, lanes, rules, traffic
        self.arrivals, self.paths = arrivals, paths
        vehicle, self.step_s = rules.vehicle, rules.step_s
        self.begin_step = round(traffic.warm_up_s / self.step_s)
        self.end_step = self.begin_step + round(traffic.duration_s / self.step_s)
        self.sample_steps = max(1, round(SAMPLE_S / self.step_s))
        self.trigger_x_m = -vehicle.trigger_range_m - ROUNDING_M
        self.detection_m = vehicle.detection_range_m + ROUNDING_M
        self.hits_from_m = -rules.crossing.width_m / 2 - COLLISION_REACH_M
        self.entrance = Entrance(road, rules, traffic, make)
        self.crowd = Crowd(arrivals, lanes, choose_speed, rules, road.remove)
        self.log = HourLog(let_go=self.crowd.let_go)
        self.on_road: dict[str, HourVehicle] = {}
        seeing = any(sensors.values())
        self.sight = HourSight(sensors, pair, road, self.on_road) if seeing else None

    def run(self) -> HourLog:
        """Simulate the warm-up, the counted time, and the time until the road is empty.

        The simulation ends at the latest ``clearing_s`` after the counted time.

        Raises:
            EngineError: SUMO failed.
            StrategyError: a strategy failed in a vehicle.
        """
        road = self.road
        last = self.end_step + round(clearing_s(self.traffic) / self.step_s)
        lanes = self.lanes
        with road.watched():
            road.begin(self.arrivals)
            for n in range(last):
                if n >= self.end_step and not self.on_road and not any(lane.due for lane in lanes):
                    break
                self._step(n)
        road.end()
        for lane in lanes:
            for vehicle in lane.driven:
                vehicle.came_until = len(self.crowd.came)
            if not self.traffic.saturated:
                self.log.vehicles += lane.due
        self.log.walks = [walker.walk for walker in self.crowd.came]
        return self.log

    def _step(self, n: int) -> None:
        now, then, after = n * self.step_s, (n + 1) * self.step_s, n + 1
        crowd, road, lanes = self.crowd, self.road, self.lanes
        if crowd.walkers:
            crowd.begin_step(now)
        self._drive(now, n)
        for lane in lanes:
            if lane.due or lane.next_step <= after:
                self._let_in(lane, after)
        departed = road.step(crowd.walk_until(then))
        if departed:
            for name in departed:
                self.on_road.pop(name).gone_step = after
        self._read()
        if crowd.walkers:
            self._note_collisions()
        if crowd.next_s <= then:
            crowd.advance(now, then)
        for lane in lanes:
            if lane.driven or lane.coming:
                self._move(lane, after)
        self.log.last_step = after
        if (after - self.begin_step) % self.sample_steps == 0:
            self._sample(after)

    def _drive(self, now: float, n: int) -> None:
        """Let every strategy decide, from its observation at the beginning of the step."""
        step, drive = self.step_s, self.road.drive
        detection, everyone, sight = self.detection_m, None, self.sight
        for lane in self.lanes:
            if not lane.driven:
                continue
            if everyone is None:
                everyone = self.crowd.views()
                if sight is not None:
                    sight.begin_step(self.crowd.walkers, self.rules.crossing)
            views, crossing = lane.seen_from(everyone), lane.lane.crossing
            for car in lane.driven:
                x, speed, vehicle = car.x_m, car.speed_mps, car.vehicle
                time_s = (n - car.first_step) * step  # type: ignore[operator]  # it is driven
                view = EgoView(-x, speed, car.acceleration_mps2)
                if sight is not None and car.updates is not None:
                    visible = sight.shown(car, n - car.first_step, views)  # type: ignore[operator]
                else:
                    visible = views if -detection <= x <= detection else ()
                observation = Observation(time_s, step, view, vehicle, crossing, visible)
                try:
                    answer = car.strategy.decide(observation)
                except (Exception, SystemExit) as error:
                    raise _in_vehicle(car, now, strategy_raised(error, time_s)) from error
                actuator = car.actuator
                try:
                    wanted = limited(answer, vehicle, time_s)
                except StrategyError as error:
                    raise _in_vehicle(car, now, error) from None
                if actuator is None:
                    target = speed + wanted * step
                else:
                    target = actuator.speed_after(wanted, speed)
                drive(car.name, target if target > 0 else 0.0)

    def _let_in(self, lane: LaneOnRoad, step: int) -> None:
        car = self.entrance.let_in(lane, step, self.end_step)
        if car is not None:
            self.on_road[car.name] = car
            self.log.vehicles.append(car)

    def _read(self) -> None:
        """Read the states at the step's end of all vehicles that pedestrians may look at."""
        step, distance_of, speed_of = self.step_s, self.road.distance_of, self.road.speed_of
        for lane in self.lanes:
            for car in (*lane.driven, lane.coming[0]) if lane.coming else lane.driven:
                name = car.name
                car.next_x_m = car.insert_x_m + distance_of(name)
                speed = car.next_speed_mps = speed_of(name)
                car.acceleration_mps2 = (speed - car.speed_mps) / step

    def _move(self, lane: LaneOnRoad, step: int) -> None:
        """Release vehicles that have passed, and let strategies take over vehicles at R0."""
        driven, coming = lane.driven, lane.coming
        for car in driven:
            x = car.x_m = car.next_x_m
            speed = car.speed_mps = car.next_speed_mps
            car.xs.append(x)
            car.speeds.append(speed)
        while driven and driven[0].x_m >= driven[0].passed_at_m:
            car = driven.pop(0)
            car.passed = True
            car.came_until = len(self.crowd.came)
            self.road.release(car.name)
        if not coming:
            return
        head = coming[0]
        head.x_m, head.speed_mps = head.next_x_m, head.next_speed_mps
        while head.x_m >= self.trigger_x_m:
            self._take_over(coming.popleft(), lane, step)
            if not coming:
                return
            head = coming[0]
            head.x_m, head.speed_mps = state_of(self.road, head)

    def _take_over(self, car: HourVehicle, lane: LaneOnRoad, step: int) -> None:
        car.first_step = step
        car.actuator = actuator_of(car.vehicle, self.step_s, car.speed_mps, car.acceleration_mps2)
        over = max(0.0, car.x_m + self.rules.vehicle.trigger_range_m)
        speed, gain = car.speed_mps, car.acceleration_mps2
        if over > ROUNDING_M:
            # Time since R0, from over = v t − a t²/2.
            root = math.sqrt(max(0.0, speed**2 - 2 * gain * over))
            car.trace_offset_s = min(2 * over / (speed + root), self.step_s)
        car.xs.append(car.x_m)
        car.speeds.append(speed)
        car.met = list(self.crowd.walkers)
        car.came_from = len(self.crowd.came)
        if self.sight is not None:
            self.sight.take_over(car)
        lane.driven.append(car)

    def _note_collisions(self) -> None:
        """Record the collisions that SUMO reports; it reports none before ``hits_from_m``."""
        for lane in self.lanes:
            if lane.driven and lane.driven[0].next_x_m > self.hits_from_m:
                break
        else:
            return
        for name in self.road.collided():
            if name in self.on_road:
                self.on_road[name].collided = True

    def _sample(self, step: int) -> None:
        """Record queues, stops before R0 and positions, once per second."""
        queues = [self._queued_in(lane) for lane in self.lanes]
        if self.begin_step < step <= self.end_step:
            self.log.queues.append(queues)
            if self.traffic.types:
                self.log.queues_m.append([self._queue_m(lane) for lane in self.lanes])
        if self.paths:
            for car in self.on_road.values():
                # During a passage the trace has the positions.
                if car.first_step is None or car.passed:
                    car.path.append((step, *state_of(self.road, car)))

    def _queued_in(self, lane: LaneOnRoad) -> int:
        """The number of queued vehicles of a lane, including those that wait to enter it."""
        queued = len(lane.due) + sum(car.speed_mps < QUEUED_MPS for car in lane.driven)
        for car in lane.coming:
            speed = self.road.speed_of(car.name)
            queued += speed < QUEUED_MPS
            standing = speed < STANDING_MPS
            car.stops += standing and not car.standing
            car.standing = standing
        return queued

    def _queue_m(self, lane: LaneOnRoad) -> float:
        """The length of a lane's queue: the sum of each queued vehicle's length and minGap."""
        queued = [car for car in lane.driven if car.speed_mps < QUEUED_MPS]
        queued += [car for car in lane.coming if self.road.speed_of(car.name) < QUEUED_MPS]
        gap_m = self.traffic.min_gap_m
        return sum(car.vehicle.length_m + gap_m for car in (*lane.due, *queued))


def _in_vehicle(car: HourVehicle, now: float, error: StrategyError) -> StrategyError:
    """The error with the vehicle's number and the time in the hour."""
    what = f"vehicle {car.plan.number}, {now:.3f} s into the hour: {error}"
    named = StrategyError(what)
    named.traceback = error.traceback
    return named
