"""A car that never yields crashes exactly when geometry says so.

The geometry is worked out here: the ego is the rectangle from its bumper back over its length,
the pedestrian a disc of radius 0.25 m, both at constant velocity.  The distance from a point on
a straight path to a convex set is a convex function of time, so its minimum is found by
narrowing an interval and the first contact by bisection, without any of the harness's formulas.
SUMO's own verdict never says more (docs/simulations.md has its rule).
"""

from collections import Counter
from collections.abc import Iterator
from math import hypot
from typing import NamedTuple

import pytest

from harness.core.encounter import Side, Trace
from harness.measures import measure
from harness.strategies.constant_speed import ConstantSpeed
from tests.scenes import play, scenario

RADIUS, LENGTH, WIDTH = 0.25, 5.0, 1.8
L0, LANE_CENTRE, HALF_BAND = 9.0, 9.0 / 4, 2.0
GRAZING_M = 1e-6


class Case(NamedTuple):
    range_m: float
    speed: float
    side: Side
    walking: float
    arrival: float

    def front(self, time: float) -> float:
        return -self.range_m + self.speed * time

    def y(self, time: float) -> float:
        progress = self.walking * (time - self.arrival)
        return progress if self.side is Side.NEAR else L0 - progress

    def distance(self, time: float) -> float:
        """From the pedestrian's centre to the rectangle; 0 inside."""
        front, y = self.front(time), self.y(time)
        along = max(0.0 - front, (front - LENGTH) - 0.0, 0.0)
        across = max(abs(y - LANE_CENTRE) - WIDTH / 2, 0.0)
        return hypot(along, across)


def nearest(case: Case) -> tuple[float, float]:
    """Time of the smallest distance during the walk, and that distance."""
    low, high = case.arrival, case.arrival + L0 / case.walking
    for _ in range(80):  # (2/3)^80 of the walk: 1e-13 s
        third = (high - low) / 3
        if case.distance(low + third) <= case.distance(high - third):
            high -= third
        else:
            low += third
    time = (low + high) / 2
    return time, case.distance(time)


def first_contact(case: Case) -> float | None:
    """By bisection between the start, when they are apart, and the nearest moment."""
    time, smallest = nearest(case)
    if smallest > RADIUS:
        return None
    apart, touching = case.arrival, time
    assert case.distance(apart) > RADIUS
    while touching - apart > 1e-11:
        middle = (apart + touching) / 2
        if case.distance(middle) <= RADIUS:
            touching = middle
        else:
            apart = middle
    return touching


def cases(speeds: list[float], walking: list[float], every_s: float) -> Iterator[Case]:
    """Arrivals on a grid, from well before any contact to after the ego is on the crosswalk."""
    for speed in speeds:
        range_m = 30.0 if speed <= 5 else 60.0
        for side in Side:
            for pace in walking:
                # Their disc leaves the ego's path at the latest 7.9 m from their kerb.
                first = max(0.0, range_m / speed - 7.9 / pace - 0.3)
                last = (range_m - HALF_BAND) / speed + 0.3
                for n in range(int(first / every_s), int(last / every_s) + 1):
                    yield Case(range_m, speed, side, pace, n * every_s)


def simulate(case: Case, sumo) -> Trace:
    ego = {"trigger_range_m": case.range_m, "initial_speed_mps": case.speed}
    scene = scenario(ego=ego)
    return play(ConstantSpeed(), [(case.arrival, case.side, case.walking)], scene, sumo(scene))


def check(all_cases: list[Case], sumo) -> Counter[str]:
    """Compare every case; returns how many there were of each kind."""
    seen: Counter[str] = Counter()
    for case in all_cases:
        if abs(case.front(case.arrival) + HALF_BAND) < GRAZING_M:
            continue  # at the very edge: a last bit decides whether they go
        trace = simulate(case, sumo)
        (record,) = measure([trace])
        goes = case.front(case.arrival) < -HALF_BAND
        assert (trace.walks[0].start_s is not None) is goes, case
        if not goes:
            assert record.contact is None, case
            assert record.ending == "crossed", case
            seen["kept waiting"] += 1
            continue
        assert trace.walks[0].start_s == case.arrival
        if abs(nearest(case)[1] - RADIUS) < GRAZING_M:
            continue
        expected = first_contact(case)
        seen["contact" if expected is not None else "no contact"] += 1
        if expected is None:
            assert (record.contact, record.contact_time_s) == (None, None), case
            assert record.ending == "crossed", case
            # Free flow: the rear leaves the far edge after R0 + 5 m + 2 m at constant speed.
            free = (case.range_m + LENGTH + HALF_BAND) / case.speed
            assert record.pass_time_s == pytest.approx(free, abs=1e-9), case
            seen["SUMO alone"] += bool(trace.sumo_collision)
        else:
            assert record.ending == "crashed", case
            assert record.contact_time_s == pytest.approx(expected, abs=1e-7), case
            assert record.contact_speed_mps == pytest.approx(case.speed, abs=1e-9), case
            front = case.front(expected)
            if abs(front) > GRAZING_M:
                assert record.contact == ("front" if front < 0 else "side"), case
            seen[f"contact {record.contact}"] += 1
            seen["seen by SUMO"] += bool(trace.sumo_collision)
    return seen


def test_the_geometry_of_this_file() -> None:
    # 5 m/s from 30 m: the bumper is at x = 0 at 6 s.  A walker at 1 m/s who is then at the lane's
    # centre (near side: 2.25 m on their way) is touched 0.25 m earlier, at 5.95 s.
    hit = Case(30.0, 5.0, Side.NEAR, 1.0, 6 - 2.25)
    assert first_contact(hit) == pytest.approx(5.95, abs=1e-9)
    # From the far side the lane's centre is 6.75 m away.
    assert first_contact(Case(30.0, 5.0, Side.FAR, 1.0, 0.0)) == pytest.approx(5.95, abs=1e-9)
    # Into the flank: their disc meets the side at y = 1.1 m at 6.5 s, the bumper 2.5 m beyond them.
    flank = Case(30.0, 5.0, Side.NEAR, 1.0, 5.4)
    assert first_contact(flank) == pytest.approx(6.5, abs=1e-9)
    assert flank.front(6.5) == pytest.approx(2.5)
    # One who has walked 4 m, 0.6 m past the side, when the bumper comes.
    time, distance = nearest(Case(30.0, 5.0, Side.NEAR, 1.0, 2.0))
    assert distance > RADIUS
    assert first_contact(Case(30.0, 5.0, Side.NEAR, 1.0, 2.0)) is None
    assert time < 6


def test_contact_exactly_where_geometry_says(sumo) -> None:
    seen = check(list(cases([3.0, 5.0, 8.3, 13.0], [1.2], 0.05)), sumo)
    assert seen["contact front"] > 50
    assert seen["contact side"] > 20
    assert seen["no contact"] > 100
    assert seen["kept waiting"] > 10
    # SUMO looks once or twice a step, and at a car on the junction alone: it misses some.
    assert seen["SUMO alone"] == 0
    assert 0.5 * seen["contact"] < seen["seen by SUMO"] < seen["contact"]


@pytest.mark.slow
def test_contact_at_more_speeds(sumo) -> None:
    seen = check(list(cases([2.0, 4.1, 5.0, 6.7, 10.0, 20.0], [0.5, 0.93, 1.2, 2.5], 0.05)), sumo)
    assert seen["contact"] > 1500
    # They may still be where they were a step ago when SUMO looks: a hit more, now and then.
    assert seen["SUMO alone"] < 0.01 * seen["contact"]
