"""Runs one hour of one arm: every vehicle its strategy, everybody the same road.

The encounter's loop (``harness.episode.loop``) stays one of its own: with one ego it reads and
sets one state and knows all of the step beforehand, which is what makes it fast.  Walkers,
strategies, the kerb rule and the limits of a command are the same objects and functions here.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from harness.encounter import (
    Arrival,
    EgoView,
    Observation,
    PedestrianView,
    Side,
    Strategy,
    Walk,
)
from harness.engine.control import COLLISION_REACH_M
from harness.engine.road import SumoRoad
from harness.episode.cell_constants import CellConstants
from harness.episode.deciding import ROUNDING_M, keeps_waiting, limited, strategy_raised
from harness.episode.walkers import ChooseSpeed, ReactiveWalker, Walker
from harness.errors import StrategyError
from harness.measures.efficiency import STANDING_MPS
from harness.scenario import TrafficSection
from harness.traffic.demand import Scheduled
from harness.traffic.vehicles import LaneOnRoad, Moving

QUEUED_MPS = 5 / 3.6
"""Slower than this counts as queued (SUMO's queue output: 5 km/h)."""

SAMPLE_S = 1.0
"""How often the queues are looked at."""

LEAST_CLEARING_S = 900.0

MakeStrategy = Callable[[Scheduled], tuple[str, Strategy]]


@dataclass(slots=True)
class HourLog:
    """What became of an hour; times are steps from the beginning of the warm-up.

    ``queues`` has, for each second of the counted time, the queued vehicles of each lane.
    ``let_go``: of each who had to wait, whether the first vehicle that kept them waiting let them
    go.
    """

    vehicles: list[Moving] = field(default_factory=list)
    walks: list[Walk] = field(default_factory=list)
    cleared: dict[int, float] = field(default_factory=dict)
    queues: list[list[int]] = field(default_factory=list)
    let_go: dict[int, bool] = field(default_factory=dict)
    last_step: int = 0
    in_system_half: int = 0
    in_system_end: int = 0


def clearing_s(traffic: TrafficSection) -> float:
    """How long after the counted time the road may take to empty; a permanent queue never does."""
    return 0.0 if traffic.saturated else max(traffic.duration_s, LEAST_CLEARING_S)


class Hour:
    """One arm of one pair on the road.

    Args:
        road: SUMO, bound to the same site, vehicle and step.
        lanes: with their schedules, by number.
        arrivals: everyone who comes, by time from the beginning of the warm-up.
        choose_speed: see ``Episode``.
        make: the name and a fresh object of a vehicle's strategy.
        rules: the cell's constants.
        traffic: durations and following.
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
    ) -> None:
        self.road, self.lanes, self.rules, self.traffic = road, lanes, rules, traffic
        self.arrivals, self.choose_speed, self.make = arrivals, choose_speed, make
        vehicle, crossing, self.step_s = rules.vehicle, rules.crossing, rules.step_s
        self.passed_at_m = vehicle.length_m + crossing.width_m / 2 - ROUNDING_M
        self.half_width_m = crossing.width_m / 2
        self.begin_step = round(traffic.warm_up_s / self.step_s)
        self.end_step = self.begin_step + round(traffic.duration_s / self.step_s)
        self.insert_x_m = [self._insertion(lane.begins_x_m) for lane in road.lanes]
        self.looks_in = ((self.begin_step + self.end_step) // 2, self.end_step)
        self.sample_steps = max(1, round(SAMPLE_S / self.step_s))
        self.log = HourLog()
        self.walkers: list[Walker] = []
        self.came: list[Walker] = []
        self.next_arrival = 0
        self.next_look_s = math.inf
        self.on_road: dict[str, Moving] = {}
        self.blockers: dict[int, Moving] = {}
        across = sorted(lanes, key=lambda lane: lane.lane.centre_m)
        self.on_way = {Side.NEAR: across, Side.FAR: across[::-1]}

    def run(self) -> HourLog:
        """Simulate warm-up, counted time, and whatever it takes until the road is empty.

        Who has not passed after ``clearing_s`` has not passed.

        Raises:
            EngineError: SUMO lost the hour; StrategyError: a strategy failed in one vehicle.
        """
        road = self.road
        last = self.end_step + round(clearing_s(self.traffic) / self.step_s)
        with road.watched():
            road.begin(self.arrivals)
            for n in range(last):
                if n >= self.end_step and not any(lane.waiting() for lane in self.lanes):
                    break
                self._step(n)
        road.end()
        for lane in self.lanes:
            for vehicle in lane.driven:
                vehicle.came_until = len(self.came)
            if not self.traffic.saturated:
                self.log.vehicles += lane.due
        self.log.walks = [walker.walk for walker in self.came]
        return self.log

    def _insertion(self, begins_x_m: float) -> float:
        """Where vehicles enter: as far upstream as there is road, whole steps at v0 before R0."""
        vehicle = self.rules.vehicle
        per_step = vehicle.initial_speed_mps * self.step_s
        room = -begins_x_m - vehicle.trigger_range_m
        return -vehicle.trigger_range_m - math.floor(room / per_step + 1e-6) * per_step

    def _step(self, n: int) -> None:
        now, then = n * self.step_s, (n + 1) * self.step_s
        for walker in self.walkers:
            if walker.due_s <= now:
                self._update_walkers(now)
                break
        self._drive(now, n)
        for lane in self.lanes:
            self._let_in(lane, n + 1)
        places = [(walker.index, walker.walk_until(then)) for walker in self.walkers]
        gone = self.road.step(places)
        for name in gone:
            self.on_road.pop(name).gone_step = n + 1
        self._read()
        if self.walkers:
            self._note_collisions()
        self._happen(now, then)
        for lane in self.lanes:
            self._sort(lane, n + 1)
        self.log.last_step = n + 1
        if n + 1 in self.looks_in:
            waiting = sum(lane.waiting() for lane in self.lanes)
            self.log.in_system_half, self.log.in_system_end = self.log.in_system_end, waiting
        if (n + 1 - self.begin_step) % self.sample_steps == 0:
            self._look_at_queues(n + 1)

    def _drive(self, now: float, n: int) -> None:
        """Every strategy decides on what it sees at the beginning of the step."""
        rules, step = self.rules, self.step_s
        vehicle = rules.vehicle
        detection = vehicle.detection_range_m + ROUNDING_M
        everyone: tuple[PedestrianView, ...] | None = None
        for lane in self.lanes:
            if not lane.driven:
                continue
            if everyone is None:
                everyone = tuple([walker.view() for walker in self.walkers])
            seen, crossing = lane.seen_from(everyone), lane.lane.crossing
            for moving in lane.driven:
                x, speed = moving.x_m, moving.speed_mps
                assert moving.first_step is not None
                time_s = (n - moving.first_step) * step
                view = EgoView(-x, speed, moving.acceleration_mps2)
                visible = seen if abs(x) <= detection else ()
                observation = Observation(time_s, step, view, vehicle, crossing, visible)
                try:
                    answer = moving.strategy.decide(observation)
                except Exception as error:
                    raise _of_vehicle(moving, now, strategy_raised(error, time_s)) from error
                if answer is None:
                    if not moving.by_engine:
                        self.road.hand_over(moving.name)
                        moving.by_engine = True
                    continue
                try:
                    target = speed + limited(answer, vehicle, time_s) * step
                except StrategyError as error:
                    raise _of_vehicle(moving, now, error) from None
                if moving.by_engine:
                    self.road.release(moving.name)
                    moving.by_engine = False
                self.road.drive(moving.name, target if target > 0 else 0.0)

    def _let_in(self, lane: LaneOnRoad, step: int) -> None:
        """Put the next vehicle on the road for the end of this step, if it is due and has room."""
        while (planned := lane.next_scheduled) is not None and planned.step <= step:
            if self.traffic.saturated and lane.due:
                break
            name, strategy = self.make(planned)
            sumo = self.road.name_of(planned.number)
            x = self.insert_x_m[lane.number]
            lane.due.append(Moving(planned, sumo, name, strategy, x))
            lane.next_scheduled = next(lane.schedule, None)
        if not lane.due or (self.traffic.saturated and step > self.end_step):
            return
        moving = lane.due[0]
        speed = self._entry_speed(lane, moving.insert_x_m)
        if speed is None:
            return
        lane.due.popleft()
        moving.inserted_step = step
        moving.x_m, moving.speed_mps = moving.insert_x_m, speed
        self.road.add(moving.name, lane.number, moving.insert_x_m, speed)
        self.on_road[moving.name] = moving
        self.log.vehicles.append(moving)
        lane.coming.append(moving)

    def _entry_speed(self, lane: LaneOnRoad, x_m: float) -> float | None:
        """v0, or what is safe behind a slow leader; None while there is no room.

        Room is a length, minGap and tau at v0.  Safe: v = −bτ + sqrt(b²τ² + v_l² + 2 b g), g the
        gap less minGap (Krauss 1998).
        """
        vehicle, traffic = self.rules.vehicle, self.traffic
        top = vehicle.initial_speed_mps
        if not lane.coming and not lane.driven:
            return top
        x, speed = self._state_of(lane.coming[-1] if lane.coming else lane.driven[-1])
        gap = x + speed * self.step_s - vehicle.length_m - x_m - traffic.min_gap_m
        if gap < top * traffic.tau_s - 1e-6:
            return None
        braking = vehicle.max_deceleration_mps2 * traffic.tau_s
        safe = -braking + math.sqrt(braking**2 + speed**2 + 2 * vehicle.max_deceleration_mps2 * gap)
        return min(top, safe)

    def _state_of(self, moving: Moving) -> tuple[float, float]:
        x = moving.insert_x_m + self.road.distance_of(moving.name)
        return x, self.road.speed_of(moving.name)

    def _read(self) -> None:
        """The states at the step's end of all that somebody may look at."""
        distance_of, speed_of, step = self.road.distance_of, self.road.speed_of, self.step_s
        for lane in self.lanes:
            for moving in lane.driven:
                moving.next_x_m = moving.insert_x_m + distance_of(moving.name)
                after = moving.next_speed_mps = speed_of(moving.name)
                moving.acceleration_mps2 = (after - moving.speed_mps) / step
            if lane.coming:
                moving = lane.coming[0]
                moving.next_x_m = moving.insert_x_m + distance_of(moving.name)
                after = moving.next_speed_mps = speed_of(moving.name)
                moving.acceleration_mps2 = (after - moving.speed_mps) / step

    def _sort(self, lane: LaneOnRoad, step: int) -> None:
        """After a step: who has passed leaves, who has come to R0 is taken over."""
        for moving in lane.driven:
            moving.moved()
            moving.xs.append(moving.x_m)
            moving.speeds.append(moving.speed_mps)
        if lane.coming:
            lane.coming[0].moved()
        while lane.driven and lane.driven[0].x_m >= self.passed_at_m:
            moving = lane.driven.pop(0)
            moving.passed = True
            moving.came_until = len(self.came)
            self.road.release(moving.name)
        trigger = -self.rules.vehicle.trigger_range_m - ROUNDING_M
        while lane.coming and lane.coming[0].x_m >= trigger:
            self._take_over(lane.coming.popleft(), lane, step)
            if lane.coming:
                head = lane.coming[0]
                head.x_m, head.speed_mps = self._state_of(head)

    def _take_over(self, moving: Moving, lane: LaneOnRoad, step: int) -> None:
        moving.first_step = step
        over = max(0.0, moving.x_m + self.rules.vehicle.trigger_range_m)
        speed, gain = moving.speed_mps, moving.acceleration_mps2
        if over > ROUNDING_M:
            # Back in time to R0: over = v t − a t²/2.
            root = math.sqrt(max(0.0, speed**2 - 2 * gain * over))
            moving.late_s = min(2 * over / (speed + root), self.step_s)
        moving.xs.append(moving.x_m)
        moving.speeds.append(speed)
        moving.met = list(self.walkers)
        moving.came_from = len(self.came)
        lane.driven.append(moving)

    def _update_walkers(self, now: float) -> None:
        """Those who wait look again; those who have reached the other kerb leave."""
        for walker in tuple(self.walkers):
            if walker.due_s > now:
                continue
            if walker.start_s is None:
                self._look(walker, now, 0.0)
            else:
                self.walkers.remove(walker)
                self.log.cleared[walker.index] = walker.due_s
                self.road.remove(walker.index)

    def _happen(self, now: float, then: float) -> None:
        """Everyone who arrives or looks again in (now, then] sees the vehicles where they are."""
        while self.next_arrival < len(self.arrivals):
            arrival = self.arrivals[self.next_arrival]
            if arrival.arrival_s > then:
                break
            self.next_arrival += 1
            walker = self._walker(arrival)
            self.came.append(walker)
            self.walkers.append(walker)
            self._look(walker, arrival.arrival_s, arrival.arrival_s - now)
            walker.walk_until(then)
        if self.next_look_s > then:
            return
        for walker in self.walkers:
            if walker.look_s > then:
                continue
            while walker.look_s <= then:
                self._look_again(walker, walker.look_s - now)
            walker.walk_until(then)
        self.next_look_s = min((walker.look_s for walker in self.walkers), default=math.inf)

    def _walker(self, arrival: Arrival) -> Walker:
        crossing = self.rules.crossing
        if self.rules.behaviour == "reactive":
            return ReactiveWalker(arrival, crossing, self.rules.vehicle, self.choose_speed)
        return Walker(arrival, crossing)

    def _first(self, lane: LaneOnRoad, elapsed_s: float) -> tuple[float, float, Moving] | None:
        """x, speed and vehicle of the first in a lane that has not passed, so far into the step."""
        for moving in lane.driven:
            gain = moving.acceleration_mps2
            x = moving.x_m + moving.speed_mps * elapsed_s + gain * elapsed_s**2 / 2
            if x < self.passed_at_m:
                return x, moving.speed_mps + gain * elapsed_s, moving
        if not lane.coming:
            return None
        head = lane.coming[0]
        gain = head.acceleration_mps2
        x = head.x_m + head.speed_mps * elapsed_s + gain * elapsed_s**2 / 2
        return x, head.speed_mps + gain * elapsed_s, head

    def _threat(self, x_m: float, speed_mps: float, gain_mps2: float, wait_s: float) -> bool:
        """The kerb rule before this vehicle, but for one that stands or stops before the edge."""
        to_edge = -x_m - self.half_width_m
        if not keeps_waiting(to_edge, speed_mps, wait_s):
            return False
        if to_edge <= ROUNDING_M:
            return True
        return not (gain_mps2 < 0 and speed_mps**2 <= -2 * gain_mps2 * to_edge)

    def _look(self, walker: Walker, time_s: float, elapsed_s: float) -> None:
        """Step off now, or wait for the next step."""
        arrival = walker.arrival
        wait_s = arrival.critical_gap_s
        if wait_s is None:
            wait_s = self.rules.kerb_wait_s
        nearest: Moving | None = None
        first_s = math.inf
        for lane in self.lanes:
            first = self._first(lane, elapsed_s)
            if first is None:
                continue
            x, speed, moving = first
            if self._threat(x, speed, moving.acceleration_mps2, wait_s):
                reaches_s = (-x - self.half_width_m) / speed if speed > 0 else 0.0
                if nearest is None or reaches_s < first_s:
                    nearest, first_s = moving, reaches_s
        if nearest is not None:
            self.blockers.setdefault(walker.index, nearest)
            return
        kerb = 0.0 if arrival.side is Side.NEAR else self.rules.crossing.length_m
        for lane in self.on_way[arrival.side]:
            first = self._first(lane, elapsed_s)
            if first is not None:
                x, speed, _ = first
                across = abs(lane.lane.centre_m - kerb)
                walking_mps = self.choose_speed(arrival, -x, speed, across)
                walker.step_off(time_s, walking_mps, (-x, speed))
                break
        else:
            walking_mps = self.choose_speed(arrival, -1.0, 0.0, None)
            walker.step_off(time_s, walking_mps, (None, None))
        self.next_look_s = min(self.next_look_s, walker.look_s)
        blocker = self.blockers.pop(walker.index, None)
        if blocker is not None:
            at = blocker.x_m + blocker.speed_mps * elapsed_s
            self.log.let_go[walker.index] = not blocker.passed and at < -self.half_width_m

    def _look_again(self, walker: Walker, elapsed_s: float) -> None:
        """A reactive pedestrian, before the first lane still ahead of them that has a vehicle."""
        side = walker.side
        kerb = 0.0 if side is Side.NEAR else self.rules.crossing.length_m
        walked = abs(walker.walk_until(walker.look_s) - kerb)
        for lane in self.on_way[side]:
            across = abs(lane.lane.centre_m - kerb)
            first = self._first(lane, elapsed_s) if across > walked else None
            if first is not None:
                walker.look(-first[0], first[1], across)
                return
        walker.look(-1.0, 0.0, None)

    def _note_collisions(self) -> None:
        """SUMO reports hits only of vehicles whose front is on the junction, or beyond."""
        nearest = -self.half_width_m - COLLISION_REACH_M
        if any(lane.driven and lane.driven[0].next_x_m > nearest for lane in self.lanes):
            for name in self.road.collided():
                if name in self.on_road:
                    self.on_road[name].collided = True

    def _look_at_queues(self, step: int) -> None:
        counts = []
        for lane in self.lanes:
            queued = len(lane.due) + sum(car.speed_mps < QUEUED_MPS for car in lane.driven)
            for moving in lane.coming:
                speed = self.road.speed_of(moving.name)
                queued += speed < QUEUED_MPS
                standing = speed < STANDING_MPS
                moving.stops += standing and not moving.standing
                moving.standing = standing
            counts.append(queued)
        if self.begin_step < step <= self.end_step:
            self.log.queues.append(counts)


def _of_vehicle(moving: Moving, now: float, error: StrategyError) -> StrategyError:
    """The same error, with the vehicle and the hour's time."""
    what = f"vehicle {moving.plan.number}, {now:.3f} s into the hour: {error}"
    named = StrategyError(what)
    named.traceback = error.traceback
    return named
