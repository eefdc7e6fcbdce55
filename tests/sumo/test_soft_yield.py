"""Soft-Yield in SUMO against its closed form (paper, section III-C; docs/method.md)."""

import math

import numpy as np
import pytest

from harness.core.encounter import Side
from harness.measures import crossing_time, measure
from harness.strategies.soft_yield import SoftYield
from tests.scenes import play, scenario

R0, V0, L0 = 30.0, 5.0, 9.0
A = 0.0169 - 0.13986 * V0 + 0.010115 * R0


def deceleration_time(walking_speed: float) -> float:
    """T1 as the paper prints it."""
    t_l = L0 / walking_speed
    return t_l - math.sqrt(t_l**2 - 2 * (R0 - V0 * t_l) / A)


def test_the_papers_figures() -> None:
    assert pytest.approx(-0.37895, abs=1e-12) == A
    assert deceleration_time(1.2) == pytest.approx(3.41748, abs=5e-6)


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("walking_speed", [0.977, 1.0, 1.05, 1.1, 1.2, 1.3, 1.337, 1.45, 1.499])
def test_arrives_at_the_centre_line_as_the_pedestrian_leaves(sumo, walking_speed, side) -> None:
    trace = play(SoftYield(), [(0.0, side, walking_speed)], engine=sumo(scenario()))
    assert not trace.fallback
    assert crossing_time(trace, 0.0) == pytest.approx(L0 / walking_speed, abs=1e-6)
    # Speeds on the way: v0 + a t until T1, then one constant coasting speed.
    t1 = deceleration_time(walking_speed)
    whole = int(t1 / 0.1)
    times = np.arange(whole + 1) * 0.1
    np.testing.assert_allclose(trace.speed_mps[: whole + 1], V0 + A * times, atol=1e-9)
    coasting = trace.speed_mps[whole + 1 : int(L0 / walking_speed / 0.1)]
    np.testing.assert_allclose(coasting, coasting[:1].repeat(len(coasting)), atol=1e-9)
    if len(coasting):
        # Holding a for exactly T1 gives the same coasting speed up to the step's rounding.
        assert coasting[0] == pytest.approx(V0 + A * t1, abs=0.02)


def test_edge_of_the_window_is_where_the_root_turns_negative(sumo) -> None:
    for walking_speed, fallback in ((0.975, True), (0.977, False)):
        trace = play(SoftYield(), [(0.0, Side.NEAR, walking_speed)], engine=sumo(scenario()))
        assert trace.fallback is fallback
    # t_L² = 2 (R − v t_L)/a has the root 0.97565 m/s.
    t_l = np.roots([1, 2 * V0 / A, -2 * R0 / A])
    assert L0 / min(t for t in t_l if t > R0 / V0) == pytest.approx(0.97565, abs=5e-6)
    for walking_speed, fallback in ((0.97564, True), (0.97566, False)):
        trace = play(SoftYield(), [(0.0, Side.NEAR, walking_speed)])
        assert trace.fallback is fallback
        if not fallback:
            assert crossing_time(trace, 0.0) == pytest.approx(L0 / walking_speed, abs=1e-6)


@pytest.mark.parametrize("walking_speed", [1.5001, 1.6, 2.0, 3.0])
def test_never_brakes_for_a_fast_walker(sumo, walking_speed) -> None:
    trace = play(SoftYield(), [(0.0, Side.FAR, walking_speed)], engine=sumo(scenario()))
    np.testing.assert_allclose(trace.speed_mps, V0, atol=1e-12)


def test_plans_for_the_last_to_leave_and_resumes_at_a0_up_to_v0() -> None:
    # 1.4 m/s leaves at 6.43 s; 1.2 m/s, half a second later, at 8 s: arrival then.
    trace = play(SoftYield(), [(0.0, Side.NEAR, 1.4), (0.5, Side.FAR, 1.2)])
    assert crossing_time(trace, 0.0) == pytest.approx(0.5 + 9 / 1.2, abs=1e-6)
    trace = play(SoftYield(), [(0.0, Side.NEAR, 1.1)])
    gains = np.diff(trace.speed_mps) / 0.1
    assert gains.max() == pytest.approx(1.0)
    assert trace.speed_mps.max() <= V0 + 1e-12


def test_no_answer_where_the_regression_would_accelerate() -> None:
    # At 5 m/s from 80 m: a = 0.0169 − 0.6993 + 0.8092 > 0.
    scene = scenario(ego={"trigger_range_m": 80.0})
    trace = play(SoftYield(), [(0.0, Side.NEAR, 0.5)], scene)
    assert trace.fallback
    assert measure([trace])[0].ending == "crossed"
