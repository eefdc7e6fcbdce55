"""Gap-Yield: who is in its way, how it yields, and that it can always stop for a newcomer.

At the CCTC the path is 1.1 to 3.4 m from the near kerb (lane centre 2.25 m, half a width of 0.9 m
and a radius of 0.25 m either side); the ego's lane, disc and all, ends at 4.75 m.  The near edge is
at R = 2 m, the stop line at R = 3 m.
"""

import math

import numpy as np
import pytest

from harness.core.vocabulary import Side
from harness.measures import measure
from harness.measures.ego import crossing_time_s
from harness.strategies.gap_yield import GapYield
from tests.scenes import play, scenario

STEP, EDGE_M, LIMIT = 0.1, 2.0, 4.5
REAR_CLEAR_M = 5.25
"""Bumper's x when the rear is 0.25 m past the centre line."""

EMPTY = play(GapYield(), [])


def edge_speed(step: float = STEP, limit: float = LIMIT) -> float:
    """v step + v²/2b + b step²/8 = 2 − 0.35, solved by hand."""
    a, b, c = 1 / (2 * limit), step, limit * step**2 / 8 - 1.65
    return (-b + math.sqrt(b * b - 4 * a * c)) / (2 * a)


def test_slows_down_for_an_empty_crosswalk() -> None:
    step = int(np.argmax(EMPTY.x_m > -EDGE_M))
    assert edge_speed() - 0.1 < EMPTY.speed_mps[step] <= edge_speed() + 1e-9
    changes = np.diff(EMPTY.speed_mps) / STEP
    # Towards the edge at 3 m/s² at most, in one step less, from the edge on a0 to v0.
    assert changes[:step].min() == pytest.approx(-3.0, abs=1e-6)
    np.testing.assert_allclose(changes[step : step + 15], 1.0, atol=1e-9)
    np.testing.assert_array_equal(EMPTY.speed_mps[:40], 5.0)
    # From 5 to 3.42 m/s at 3 m/s² and back at 1 m/s²: Δv²/2v0 (1/3 + 1) longer than 7.4 s, and the
    # step or so in which it rolls at v_e.
    lost = (5 - edge_speed()) ** 2 / 10 * (1 / 3 + 1)
    passed = crossing_time_s(EMPTY, 7.0)
    assert 7.4 + lost - 0.01 < passed < 7.4 + lost + 0.06


@pytest.mark.parametrize("step_s", [0.05, 0.1, 0.5])
@pytest.mark.parametrize(
    ("speed", "range_m", "limit", "width"),
    [(5.0, 30.0, 4.5, 4.0), (13.9, 80.0, 4.5, 4.0), (8.0, 60.0, 1.5, 4.0), (8.0, 60.0, 9.0, 8.0),
     (8.0, 60.0, 4.5, 2.0)],
)  # fmt: skip
def test_at_every_step_before_the_edge_it_could_still_stop(
    speed: float, range_m: float, limit: float, width: float, step_s: float
) -> None:
    ego = {"initial_speed_mps": speed, "trigger_range_m": range_m, "max_deceleration_mps2": limit}
    scene = scenario(ego=ego, crossing={"width_m": width}, experiment={"step_s": step_s})
    trace = play(GapYield(), [], scene)
    before = -trace.x_m[:-1] > width / 2
    assert before.sum() > 5
    # Whoever steps off inside a step is seen at its end: full braking from there, v²/2b, ends
    # before their disc.
    ends = -trace.x_m[1:] - trace.speed_mps[1:] ** 2 / (2 * limit)
    assert (ends[before] >= 0.25).all()
    assert (np.diff(trace.speed_mps) >= -limit * step_s - 1e-9).all()


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("walking_speed", [0.4, 0.9, 1.5, 2.5, 4.0])
def test_who_steps_off_at_any_time_is_not_hit(walking_speed: float, side: Side) -> None:
    # No waiting at the kerb at all: at any moment until the body is on the crosswalk.
    traces = [
        play(GapYield(critical_gap_s=gap), [(arrival, side, walking_speed)])
        for arrival in np.arange(0.0, 6.5, 0.043)
        for gap in (1.5, 0.0)
    ]
    records = measure(traces)
    assert sum(record.pedestrians for record in records) > 200
    assert {record.ending for record in records} == {"crossed"}


@pytest.mark.parametrize("critical_gap", [0.0, 1.5, 3.0])
def test_goes_first_where_the_time_advantage_exceeds_the_gap(critical_gap: float) -> None:
    # On an empty road its rear leaves their line at a time that the trace shows.
    clear = crossing_time_s(EMPTY, REAR_CLEAR_M)
    for advantage, goes in ((critical_gap + 0.1, True), (critical_gap - 0.1, False)):
        # 5.6 m from the far kerb to the path.
        walker = (4.5, Side.FAR, 5.6 / (clear + advantage - 4.5))
        trace = play(GapYield(critical_gap_s=critical_gap), [walker])
        assert bool(np.array_equal(trace.speed_mps, EMPTY.speed_mps)) is goes
        if not goes:
            assert trace.speed_mps[46] < EMPTY.speed_mps[46]


def test_waits_as_long_as_its_lane_is_not_free() -> None:
    # They have left the lane at 4.75 m/0.9 m/s = 5.28 s; it is at the edge at 5.68 s.
    assert crossing_time_s(EMPTY, -EDGE_M) == pytest.approx(5.68, abs=0.01)
    trace = play(GapYield(), [(0.0, Side.NEAR, 0.9)])
    np.testing.assert_array_equal(trace.speed_mps, EMPTY.speed_mps)
    # 4.75 m/0.6 m/s = 7.9167 s for 28 m from 5 m/s: one constant deceleration.
    free = 4.75 / 0.6
    deceleration = 2 * (28 - 5 * free) / free**2
    trace = play(GapYield(), [(0.0, Side.NEAR, 0.6)])
    changes = np.diff(trace.speed_mps) / STEP
    np.testing.assert_allclose(changes[:70], deceleration, atol=1e-9)
    # In the last moments going on at a0 gets it there no earlier, and it does.
    assert crossing_time_s(trace, -EDGE_M) == pytest.approx(free, abs=0.1)
    np.testing.assert_allclose(changes[82:90], 1.0, atol=1e-9)


def test_stops_where_slowing_down_is_not_enough() -> None:
    # 4.75 m/0.3 m/s = 15.83 s: 28 m from 5 m/s take 9.33 s where it is to arrive at 1 m/s.  It
    # stops at R = 3 m with 25/54 m/s² and starts when 1 m at a0, 1.414 s, is no sooner at the edge.
    free = 4.75 / 0.3
    trace = play(GapYield(), [(0.0, Side.NEAR, 0.3)])
    changes = np.diff(trace.speed_mps) / STEP
    np.testing.assert_allclose(changes[:100], -25 / 54, rtol=1e-4)
    standing = np.flatnonzero(trace.speed_mps == 0)
    np.testing.assert_allclose(-trace.x_m[standing], 3.0, atol=1e-3)
    assert standing[-1] == math.ceil((free - math.sqrt(2)) / STEP)
    assert crossing_time_s(trace, -EDGE_M) == pytest.approx(free, abs=0.15)


@pytest.mark.parametrize(("critical_gap", "stops"), [(1.5, True), (0.5, False)])
def test_yielding_to_one_may_put_another_in_its_way(critical_gap: float, stops: bool) -> None:
    # The near one (as above) makes it arrive at 7.917 s with 2 · 28/7.917 − 5 = 2.074 m/s; its rear
    # is clear 7.25 m later, at a0 after sqrt(2.074² + 14.5) − 2.074 = 2.262 s: at 10.179 s.  The
    # far one is in the path from 5.6 m/0.5 m/s = 11.2 s on: an advantage of 1.02 s.  Alone they had
    # 3.5 s.
    arrives = 2 * 28 * 0.6 / 4.75 - 5
    clear = 4.75 / 0.6 + math.sqrt(arrives**2 + 14.5) - arrives
    assert 11.2 - clear == pytest.approx(1.02, abs=0.005)
    far = (0.0, Side.FAR, 0.5)
    alone = play(GapYield(critical_gap_s=critical_gap), [far])
    np.testing.assert_array_equal(alone.speed_mps, EMPTY.speed_mps)
    trace = play(GapYield(critical_gap_s=critical_gap), [(0.0, Side.NEAR, 0.6), far])
    # They are out of the way at 18 s: that means a stop at R = 3 m, 25/54 m/s² to begin with.
    wanted = -25 / 54 if stops else 2 * (28 - 5 * 4.75 / 0.6) / (4.75 / 0.6) ** 2
    assert (trace.speed_mps[1] - 5) / STEP == pytest.approx(wanted, rel=1e-4)
    assert measure([trace])[0].contact is None
