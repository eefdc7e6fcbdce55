"""The pedestrians of an encounter: arrivals and vehicles in; when they step off, and walks, out."""

import math
from collections.abc import Callable, Sequence

from harness.core.vocabulary import Arrival, Side, Views, arrives_s
from harness.encounter.cell_constants import CellConstants
from harness.encounter.deciding import Approaching, KerbLane, Threat, blocking, must_wait, threats
from harness.encounter.walkers import (
    ChooseSpeed,
    ReactiveWalker,
    SeenCar,
    TimedWalker,
    Walker,
    chosen_speed,
)


class Crowd:
    """All pedestrians.  Each looks at the first vehicle in each lane that has not passed.

    Args:
        arrivals: all arrivals, by time.
        lanes: the lanes of the road.
        choose_speed: returns the walking speed of a pedestrian who steps off.
        rules: the cell's constants.
        leave: called with the index of each pedestrian who has reached the other kerb.
        look_back: whether pedestrians also look at vehicles on lanes that they have crossed, as in
            encounters.
    """

    def __init__(
        self,
        arrivals: Sequence[Arrival],
        lanes: Sequence[KerbLane],
        choose_speed: ChooseSpeed,
        rules: CellConstants,
        leave: Callable[[int], None],
        *,
        look_back: bool = False,
    ) -> None:
        self.walkers: list[Walker] = []
        """The pedestrians at the crosswalk."""
        self.came: list[Walker] = []
        """The pedestrians who have arrived so far, in order of arrival."""
        self.let_go: dict[int, bool] = {}
        """For each pedestrian who had to wait: whether they went before the first vehicle that
        blocked them."""
        self._arrivals, self._lanes, self._rules = arrivals, lanes, rules
        self._choose_speed, self._leave = choose_speed, leave
        self._next_arrival_s = arrives_s(arrivals, 0)
        self._next_look_s = math.inf
        self.next_s = self._next_arrival_s
        """The time at which a pedestrian next arrives or looks again."""
        self._blockers: dict[int, Approaching] = {}
        self._half_width_m = rules.crossing.width_m / 2
        across = sorted(lanes, key=lambda lane: lane.centre_m)
        self._on_way = {Side.NEAR: across, Side.FAR: across[::-1]}
        self._kerb_m = {Side.NEAR: 0.0, Side.FAR: rules.crossing.length_m}
        self._look_back = look_back

    def begin_step(self, now_s: float) -> None:
        """Let waiting pedestrians look again; remove everybody who reached the other kerb."""
        finished = []
        blockers: dict[float, Approaching | None] = {}  # by the gap that a pedestrian needs
        coming: list[Threat] | None = None
        for walker in self.walkers:
            if walker.due_s <= now_s:
                if walker.start_s is not None:
                    finished.append(walker)
                    continue
                if walker.arrival.threshold_s is not None:
                    if coming is None:
                        coming = threats(self._lanes, 0.0, self._rules.pedestrians.threshold)
                    self._weigh(walker, now_s, self._threat(walker, coming, 0.0))
                    continue
                wait_s = self._wait_s(walker)
                if wait_s not in blockers:
                    blockers[wait_s] = self._blocker(wait_s, 0.0)
                self._decide(walker, now_s, 0.0, blockers[wait_s])
        for walker in finished:
            self.walkers.remove(walker)
            self._leave(walker.index)

    def advance(self, now_s: float, then_s: float) -> None:
        """Pedestrians who arrive or look again in (now, then] see the vehicles at that time."""
        while self._next_arrival_s <= then_s:
            arrival = self._arrivals[len(self.came)]
            walker = self._walker(arrival)
            self.came.append(walker)
            self.walkers.append(walker)
            self._next_arrival_s = arrives_s(self._arrivals, len(self.came))
            self._admit(walker, arrival.arrival_s - now_s)
            self._next_look_s = min(self._next_look_s, walker.look_s)
            walker.walk_until(then_s)
        if self._next_look_s <= then_s:
            for walker in self.walkers:
                if walker.look_s > then_s:
                    continue
                while walker.look_s <= then_s:
                    self._look_again(walker, walker.look_s - now_s)
                walker.walk_until(then_s)
            self._next_look_s = min((walker.look_s for walker in self.walkers), default=math.inf)
        self.next_s = min(self._next_arrival_s, self._next_look_s)

    def views(self) -> Views:
        """The pedestrians at the crosswalk, as a strategy sees them now."""
        seen = []
        for walker in self.walkers:  # a comprehension takes longer for one or two
            seen.append(walker.view())
        return tuple(seen)

    def walk_until(self, then_s: float) -> list[tuple[int, float]]:
        """Move all pedestrians on to a time; return the index and y of each."""
        return [(walker.index, walker.walk_until(then_s)) for walker in self.walkers]

    def _walker(self, arrival: Arrival) -> Walker:
        crossing, behaviour = self._rules.crossing, self._rules.pedestrians.behaviour
        if arrival.path is not None:
            return TimedWalker(arrival, crossing)
        if behaviour == "reactive":
            return ReactiveWalker(arrival, crossing, self._choose_speed)
        return Walker(arrival, crossing)

    def _admit(self, walker: Walker, elapsed_s: float) -> None:
        """Begin an arrival: they look for a gap, or wait."""
        arrival = walker.arrival
        if arrival.looks_from_s is not None:
            walker.due_s = arrival.looks_from_s
        elif not isinstance(walker, TimedWalker):
            blocker = None
            if arrival.threshold_s is not None:
                coming = threats(self._lanes, elapsed_s, self._rules.pedestrians.threshold)
                blocker = self._threat(walker, coming, elapsed_s)
            blocker = blocker or self._blocker(self._wait_s(walker), elapsed_s)
            self._decide(walker, arrival.arrival_s, elapsed_s, blocker)

    def _wait_s(self, walker: Walker) -> float:
        """The gap in s that a pedestrian needs."""
        critical_gap_s = walker.arrival.critical_gap_s
        return self._rules.pedestrians.kerb_wait_s if critical_gap_s is None else critical_gap_s

    def _blocker(self, wait_s: float, elapsed_s: float) -> Approaching | None:
        """The earliest vehicle that blocks a pedestrian who needs that gap; None without one."""
        nearest: Approaching | None = None
        first_s = math.inf
        for lane in self._lanes:
            first = lane.first(elapsed_s)
            if first is None:
                continue
            x_m, speed_mps, vehicle = first
            to_edge_m = -x_m - self._half_width_m
            if must_wait(to_edge_m, speed_mps, vehicle.acceleration_mps2, wait_s):
                reaches_s = to_edge_m / speed_mps if speed_mps > 0 else 0.0
                if nearest is None or reaches_s < first_s:
                    nearest, first_s = vehicle, reaches_s
        return nearest

    def _threat(self, walker: Walker, coming: list[Threat], elapsed_s: float) -> Approaching | None:
        """The vehicle for which they do not decide by their threshold; None if they decide."""
        threshold_s, kerb_m = walker.arrival.threshold_s, self._kerb_m[walker.side]
        assert threshold_s is not None
        # The walking speed is drawn only if the vehicles alone let them decide.
        blocker = blocking(coming, threshold_s, kerb_m, math.inf)
        if blocker is None and coming:
            speed, _ = self._speed_before_traffic(walker, elapsed_s, walker.arrival.leader)
            blocker = blocking(coming, threshold_s, kerb_m, speed)
        return blocker

    def _weigh(self, walker: Walker, now_s: float, blocker: Approaching | None) -> None:
        """Let a pedestrian decide by their threshold; they set off their latency later."""
        if blocker is not None:
            self._blockers.setdefault(walker.index, blocker)
            return
        latency_s = walker.arrival.latency_s
        assert latency_s is not None
        walker.due_s, walker.look_s = math.inf, now_s + latency_s
        self._note_look(walker)

    def _decide(
        self, walker: Walker, time_s: float, elapsed_s: float, nearest: Approaching | None
    ) -> None:
        """Let a pedestrian step off now, or wait for the next step."""
        if nearest is not None:
            self._blockers.setdefault(walker.index, nearest)
            return
        walker.step_off(time_s, *self._speed_before_traffic(walker, elapsed_s))
        self._note_look(walker)
        blocker = self._blockers.pop(walker.index, None)
        if blocker is not None:
            at = blocker.x_m + blocker.speed_mps * elapsed_s
            self.let_go[walker.index] = not blocker.passed and at < -self._half_width_m

    def _note_look(self, walker: Walker) -> None:
        if walker.look_s < self._next_look_s:
            self._next_look_s = walker.look_s
            self.next_s = min(self._next_arrival_s, walker.look_s)

    def _speed_before_traffic(
        self, walker: Walker, elapsed_s: float, leader: Arrival | None = None
    ) -> tuple[float, SeenCar | None]:
        """The speed at which they step off, and the vehicle that it depends on.

        If a leader is given, it is the speed at which the leader would step off.
        """
        seen = self._first_on_way(walker, -math.inf, elapsed_s)
        return chosen_speed(self._choose_speed, leader or walker.arrival, seen), seen

    def _look_again(self, walker: Walker, elapsed_s: float) -> None:
        if walker.start_s is None and walker.arrival.latency_s is not None:
            # They set off now, unless the kerb rule holds them back; then they decide anew.
            time_s, walker.look_s, walker.due_s = walker.look_s, math.inf, -math.inf
            blocker = self._blocker(self._rules.pedestrians.kerb_wait_s, elapsed_s)
            self._decide(walker, time_s, elapsed_s, blocker)
            return
        walked_m = -math.inf
        if not self._look_back:
            walked_m = abs(walker.walk_until(walker.look_s) - self._kerb_m[walker.side])
        walker.look(self._first_on_way(walker, walked_m, elapsed_s))

    def _first_on_way(self, walker: Walker, walked_m: float, elapsed_s: float) -> SeenCar | None:
        """The first vehicle ahead; lanes within ``walked_m`` of the kerb are left out."""
        for lane in self._on_way[walker.side]:
            across_m = abs(lane.centre_m - self._kerb_m[walker.side])
            first = lane.first(elapsed_s) if across_m > walked_m else None
            if first is not None:
                return SeenCar(-first[0], first[1], across_m, first[2].vehicle)
        return None
