"""Soft-Yield against its closed form (paper, section III-C and figure 1), with t_L + margin."""

import math

import numpy as np
import pytest

from harness.core.vocabulary import PedestrianView, Side
from harness.measures import crossing_time_s, measure
from harness.strategies.soft_yield import SoftYield
from tests.scenes import play, scenario, shown

R0, V0, L0 = 30.0, 5.0, 9.0
A = 0.0169 - 0.13986 * V0 + 0.010115 * R0


def deceleration_time(until: float) -> float:
    """T1 as the paper prints it, for an arrival at the centre line at a time."""
    return until - math.sqrt(until**2 - 2 * (R0 - V0 * until) / A)


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize(
    ("walking_speed", "margin"),
    [(0.977, 0.0), (1.1, 0.0), (1.2, 0.0), (1.337, 0.0), (1.499, 0.0), (1.2, 0.5), (1.2, -0.5),
     (1.2, 1.7), (1.2, -1.4), (1.6, 1.0), (2.0, 2.0), (0.8, -3.0)],
)  # fmt: skip
def test_arrives_that_much_after_the_pedestrian_has_left(walking_speed, margin, side) -> None:
    trace = play(SoftYield(time_margin_s=margin), [(0.0, side, walking_speed)])
    until = L0 / walking_speed + margin
    assert not trace.fallback
    assert crossing_time_s(trace, 0.0) == pytest.approx(until, abs=1e-6)
    # One deceleration until T1, one speed from then until the arrival.
    t1 = deceleration_time(until)
    whole = int(t1 / 0.1)
    np.testing.assert_allclose(
        trace.speed_mps[: whole + 1], V0 + A * np.arange(whole + 1) * 0.1, atol=1e-9
    )
    coasting = trace.speed_mps[whole + 1 : int(until / 0.1)]
    np.testing.assert_allclose(coasting, coasting[:1].repeat(len(coasting)), atol=1e-9)
    if len(coasting):
        # Holding a for exactly T1 gives the same coasting speed up to the step's rounding.
        assert coasting[0] == pytest.approx(V0 + A * t1, abs=0.02)
    # Then a0 to v0, whether or not they are still on the crossing.
    after = trace.speed_mps[int(until / 0.1 + 1e-9) + 1 :]
    gains = np.diff(after) / 0.1
    assert gains[0] == pytest.approx(min(1.0, (V0 - after[0]) / 0.1))
    assert gains.max() <= 1.0 + 1e-9
    assert after.max() <= V0 + 1e-12


def test_edge_of_the_window_is_where_the_root_turns_negative() -> None:
    # t_L² = 2 (R − v t_L)/a.
    edge_mps = L0 / min(t for t in np.roots([1, 2 * V0 / A, -2 * R0 / A]) if t > R0 / V0)
    for off_mps, fallback in ((-1e-5, True), (1e-5, False)):
        trace = play(SoftYield(), [(0.0, Side.NEAR, edge_mps + off_mps)])
        assert trace.fallback is fallback


@pytest.mark.parametrize("walking_speed", [1.5001, 3.0])
def test_never_brakes_for_a_fast_walker(walking_speed: float) -> None:
    trace = play(SoftYield(), [(0.0, Side.FAR, walking_speed)])
    np.testing.assert_allclose(trace.speed_mps, V0, atol=1e-12)


def test_plans_for_the_last_to_leave() -> None:
    # 1.4 m/s leaves at 6.43 s; 1.2 m/s, half a second later, at 8 s: arrival then.
    trace = play(SoftYield(), [(0.0, Side.NEAR, 1.4), (0.5, Side.FAR, 1.2)])
    assert crossing_time_s(trace, 0.0) == pytest.approx(0.5 + 9 / 1.2, abs=1e-6)


def test_no_answer_where_the_regression_would_accelerate() -> None:
    # At 5 m/s from 80 m: a = 0.0169 − 0.6993 + 0.8092 > 0.
    scene = scenario(ego={"trigger_range_m": 80.0})
    trace = play(SoftYield(), [(0.0, Side.NEAR, 0.5)], scene)
    assert trace.fallback
    assert measure([trace])[0].ending == "crossed"


@pytest.mark.parametrize("speed", [0.0, 5.0])
def test_no_answer_for_someone_who_stands(speed: float) -> None:
    # They never leave, so t_x is beyond any: Hard-Yield's constant deceleration to R = 3 m, which
    # differs from v²/2d = 25/54 by a relative 1/(4 n (n − 1)) at most, n = 2 · 27/5/0.1 = 108.
    standing, strategy = PedestrianView(0, Side.NEAR, 2.0, 8.75, 0.0, True), SoftYield()
    answer = strategy.decide(shown(scenario(), R0, speed, standing))
    assert answer == pytest.approx(-(speed**2) / 54, rel=1e-4)
    assert strategy.fallback
