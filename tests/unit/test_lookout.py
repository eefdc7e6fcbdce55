"""Vehicles before the chosen crosswalks: who is looked at, against looking at all at each step."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from harness.encounter.simulation.looking import Lookout, WatchedLane
from harness.site.crosswalks import LanePlace

RANGE_M, STEP_S = 30.0, 0.1
WAYS = {
    # A road, the junction's lane and the road beyond it; the crosswalk lies on the exit at 3 m.
    "straight": [("in_0", 60.0), (":j_0_0", 14.0), ("out_0", 50.0)],
    # Another approach that ends at the same road; its lane in the junction has two parts.
    "turning": [("side_0", 25.0), (":j_1_0", 6.0), (":j_4_0", 8.0), ("out_0", 50.0)],
}


def way_of(name: str) -> Any:
    before_m = sum(length for _, length in WAYS[name][:-1]) + 3.0
    lanes, at_m = [], -before_m
    for lane, length in WAYS[name]:
        lanes.append(LanePlace(lane.rpartition("_")[0], lane, at_m, at_m + length))
        at_m += length
    return SimpleNamespace(way=SimpleNamespace(crosswalk=":j_c0", lanes=tuple(lanes), name=name))


def setting_of() -> Any:
    ways = [way_of(name) for name in WAYS]
    lanes: dict[str, list[Any]] = {}
    for each in ways:
        for lane in each.way.lanes:
            if lane.end_m > -RANGE_M and lane.start_m < 0.0:
                lanes.setdefault(lane.lane, []).append(each)
    return SimpleNamespace(lanes=lambda: lanes, range_m=RANGE_M, ways=ways)


class Road:
    """Vehicles at random speeds, some of which appear on the way; every call is counted."""

    def __init__(self, seed: int) -> None:
        self.rng, self.x_m = np.random.default_rng(seed), dict[str, tuple[Any, float]]()
        self.setting, self.calls, self.count = setting_of(), 0, 0

    def step(self) -> None:
        moved = {n: (w, x + self.rng.uniform(0, 2)) for n, (w, x) in self.x_m.items()}
        self.x_m = {n: (w, x) for n, (w, x) in moved.items() if x < 40.0}
        if self.rng.random() < 0.05:
            way = self.setting.ways[self.rng.integers(2)].way
            first = way.lanes[0]
            # Now and then one departs in the middle of a road, beyond R0.
            at_m = first.start_m + (self.rng.uniform(0, 24) if self.rng.random() < 0.3 else 0.0)
            self.x_m[f"v{self.count}"] = way, at_m
            self.count += 1

    def lane_of(self, name: str) -> tuple[str, float]:
        way, x_m = self.x_m[name]
        part = next(each for each in way.lanes if each.start_m <= x_m < each.end_m)
        return part.lane, x_m - part.start_m

    def on_lane(self, lane: str) -> tuple[str, ...]:
        self.calls += 1
        return tuple(name for name in self.x_m if self.lane_of(name)[0] == lane)


@pytest.mark.parametrize("seed", range(5))
def test_everybody_is_found_in_the_step_in_which_they_pass_r0(seed: int) -> None:
    """As by looking at each lane and vehicle at each step, with fewer calls."""
    road, found = Road(seed), dict[str, float]()

    def judge(name: str, position_m: float, lane: WatchedLane, time_s: float) -> bool:
        x_m = max(start_m + position_m for ways in lane.ways.values() for _, start_m in ways)
        if x_m < -RANGE_M:
            return False
        if x_m < 0.0:
            found.setdefault(name, time_s)
        return True

    lookout = Lookout(
        road.setting, STEP_S, road.on_lane, lambda name: road.lane_of(name)[1], lambda _: 1, judge
    )
    wanted: dict[str, float] = {}
    for number in range(1, 3000):
        road.step()
        lookout.look(number * STEP_S)
        for name, (_, x_m) in road.x_m.items():
            if -RANGE_M <= x_m < 0.0:
                wanted.setdefault(name, number * STEP_S)
    assert found == wanted
    assert len(wanted) > 80
    assert road.calls < 0.9 * 2999 * len(lookout.lanes)


def test_lanes_with_neighbours_and_roads_are_looked_at_at_each_step() -> None:
    road = Road(0)

    def lookout(lanes_of_edge: int) -> Lookout:
        return Lookout(
            road.setting,
            STEP_S,
            road.on_lane,
            lambda _: 0.0,
            lambda _: lanes_of_edge,
            lambda *_: True,
        )

    always = {lane.name for lane in lookout(1).lanes if lane.until > 1}
    assert always == {"in_0", "side_0", "out_0"}
    assert all(lane.until > 1 for lane in lookout(2).lanes)
