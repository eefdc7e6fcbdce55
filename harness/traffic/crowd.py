"""The pedestrians of an hour: they come, look at the traffic, wait, step off and leave.

They decide by the encounter's own rules and walkers, before the first vehicle that has not passed
in each lane.
"""

import math
from collections.abc import Callable, Sequence

from harness.encounter import Arrival, PedestrianView, Side
from harness.episode.cell_constants import CellConstants
from harness.episode.deciding import keeps_waiting
from harness.episode.walkers import ChooseSpeed, ReactiveWalker, Walker
from harness.traffic.vehicles import HourVehicle, LaneOnRoad


class Crowd:
    """Everyone who comes in one hour.

    Args:
        arrivals: all of them, by time from the beginning of the warm-up.
        lanes: the road.
        choose_speed: see ``Episode``.
        rules: the cell's constants.
        leave: called with the index of each who has reached the other kerb.
    """

    def __init__(
        self,
        arrivals: Sequence[Arrival],
        lanes: Sequence[LaneOnRoad],
        choose_speed: ChooseSpeed,
        rules: CellConstants,
        leave: Callable[[int], None],
    ) -> None:
        self.walkers: list[Walker] = []
        """Everyone at the crosswalk."""
        self.came: list[Walker] = []
        """Everyone who came so far, in order of arrival."""
        self.let_go: dict[int, bool] = {}
        self._arrivals, self._lanes, self._rules = arrivals, lanes, rules
        self._choose_speed, self._leave = choose_speed, leave
        self._next_arrival_s = arrivals[0].arrival_s if arrivals else math.inf
        self._next_look_s = math.inf
        self.next_s = self._next_arrival_s
        """When somebody next comes, or looks again by themselves."""
        self._blockers: dict[int, HourVehicle] = {}
        self._half_width_m = rules.crossing.width_m / 2
        across = sorted(lanes, key=lambda lane: lane.lane.centre_m)
        self._on_way = {Side.NEAR: across, Side.FAR: across[::-1]}

    def begin_step(self, now: float) -> None:
        """People who wait look again; people who have reached the other kerb leave."""
        gone = []
        blockers: dict[float, HourVehicle | None] = {}  # for all who wait equally long
        for walker in self.walkers:
            if walker.due_s <= now:
                if walker.start_s is not None:
                    gone.append(walker)
                    continue
                wait_s = self._wait_s(walker)
                if wait_s not in blockers:
                    blockers[wait_s] = self._blocker(wait_s, 0.0)
                self._decide(walker, now, 0.0, blockers[wait_s])
        for walker in gone:
            self.walkers.remove(walker)
            self._leave(walker.index)

    def end_step(self, now: float, then: float) -> None:
        """Everyone who arrives or looks again in (now, then] sees the vehicles where they are."""
        while self._next_arrival_s <= then:
            arrival = self._arrivals[len(self.came)]
            walker = self._walker(arrival)
            self.came.append(walker)
            self.walkers.append(walker)
            coming = len(self.came) < len(self._arrivals)
            self._next_arrival_s = self._arrivals[len(self.came)].arrival_s if coming else math.inf
            elapsed_s = arrival.arrival_s - now
            blocker = self._blocker(self._wait_s(walker), elapsed_s)
            self._decide(walker, arrival.arrival_s, elapsed_s, blocker)
            walker.walk_until(then)
        if self._next_look_s <= then:
            for walker in self.walkers:
                if walker.look_s > then:
                    continue
                while walker.look_s <= then:
                    self._look_again(walker, walker.look_s - now)
                walker.walk_until(then)
            self._next_look_s = min((walker.look_s for walker in self.walkers), default=math.inf)
        self.next_s = min(self._next_arrival_s, self._next_look_s)

    def walk_until(self, then: float) -> list[tuple[int, float]]:
        """Everyone walks on to that time: index and y of each."""
        return [(walker.index, walker.walk_until(then)) for walker in self.walkers]

    def views(self) -> tuple[PedestrianView, ...]:
        """Everyone as the ego's lane sees them."""
        return tuple([walker.view() for walker in self.walkers])

    def _walker(self, arrival: Arrival) -> Walker:
        crossing = self._rules.crossing
        if self._rules.behaviour == "reactive":
            return ReactiveWalker(arrival, crossing, self._rules.vehicle, self._choose_speed)
        return Walker(arrival, crossing)

    def _wait_s(self, walker: Walker) -> float:
        """The gap they need."""
        critical_gap_s = walker.arrival.critical_gap_s
        return self._rules.kerb_wait_s if critical_gap_s is None else critical_gap_s

    def _blocker(self, wait_s: float, elapsed_s: float) -> HourVehicle | None:
        """The vehicle that keeps somebody with that gap waiting: the first one there, or None."""
        nearest: HourVehicle | None = None
        first_s = math.inf
        for lane in self._lanes:
            first = lane.first(elapsed_s)
            if first is None:
                continue
            x, speed, moving = first
            to_edge = -x - self._half_width_m
            if keeps_waiting(to_edge, speed, moving.acceleration_mps2, wait_s):
                reaches_s = to_edge / speed if speed > 0 else 0.0
                if nearest is None or reaches_s < first_s:
                    nearest, first_s = moving, reaches_s
        return nearest

    def _decide(
        self, walker: Walker, time_s: float, elapsed_s: float, nearest: HourVehicle | None
    ) -> None:
        """Step off now, or wait for the next step."""
        if nearest is not None:
            self._blockers.setdefault(walker.index, nearest)
            return
        self._step_off(walker, time_s, elapsed_s)
        blocker = self._blockers.pop(walker.index, None)
        if blocker is not None:
            at = blocker.x_m + blocker.speed_mps * elapsed_s
            self.let_go[walker.index] = not blocker.passed and at < -self._half_width_m

    def _step_off(self, walker: Walker, time_s: float, elapsed_s: float) -> None:
        """At a speed given the first vehicle in the first lane on their way that has one."""
        arrival = walker.arrival
        kerb = 0.0 if arrival.side is Side.NEAR else self._rules.crossing.length_m
        for lane in self._on_way[arrival.side]:
            first = lane.first(elapsed_s)
            if first is not None:
                x, speed, _ = first
                across = abs(lane.lane.centre_m - kerb)
                walking_mps = self._choose_speed(arrival, -x, speed, across)
                walker.step_off(time_s, walking_mps, (-x, speed))
                break
        else:
            walking_mps = self._choose_speed(arrival, -1.0, 0.0, None)
            walker.step_off(time_s, walking_mps, (None, None))
        if walker.look_s < self._next_look_s:
            self._next_look_s = walker.look_s
            self.next_s = min(self._next_arrival_s, walker.look_s)

    def _look_again(self, walker: Walker, elapsed_s: float) -> None:
        """A reactive pedestrian, before the first lane still ahead of them that has a vehicle."""
        side = walker.side
        kerb = 0.0 if side is Side.NEAR else self._rules.crossing.length_m
        walked = abs(walker.walk_until(walker.look_s) - kerb)
        for lane in self._on_way[side]:
            across = abs(lane.lane.centre_m - kerb)
            first = lane.first(elapsed_s) if across > walked else None
            if first is not None:
                walker.look(-first[0], first[1], across)
                return
        walker.look(-1.0, 0.0, None)
