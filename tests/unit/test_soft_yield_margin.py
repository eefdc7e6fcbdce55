"""Soft-Yield with a time margin: t_L becomes t_L + margin (paper, section III-C and figure 1)."""

import math

import numpy as np
import pytest

from harness.core.encounter import PedestrianView, Side
from harness.measures.ego import crossing_time
from harness.strategies.soft_yield import SoftYield
from tests.scenes import play, scenario, shown

R0, V0, L0 = 30.0, 5.0, 9.0
A = 0.0169 - 0.13986 * V0 + 0.010115 * R0


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize(
    ("walking_speed", "margin"),
    [(1.2, 0.5), (1.2, -0.5), (1.2, 1.7), (1.2, -1.4), (1.6, 1.0), (2.0, 2.0), (0.8, -3.0)],
)
def test_arrives_that_much_after_the_pedestrian_has_left(walking_speed, margin, side) -> None:
    trace = play(SoftYield(time_margin_s=margin), [(0.0, side, walking_speed)])
    until = L0 / walking_speed + margin
    assert 6.0 < until < 9.2246  # there is an answer, and it has to slow down
    assert not trace.fallback
    assert crossing_time(trace, 0.0) == pytest.approx(until, abs=1e-6)
    # One deceleration until T1, one speed from then until the arrival.
    t1 = until - math.sqrt(until**2 - 2 * (R0 - V0 * until) / A)
    whole = int(t1 / 0.1)
    np.testing.assert_allclose(
        trace.speed_mps[: whole + 1], V0 + A * np.arange(whole + 1) * 0.1, atol=1e-9
    )
    coasting = trace.speed_mps[whole + 1 : int(until / 0.1)]
    np.testing.assert_allclose(coasting, coasting[:1].repeat(len(coasting)), atol=1e-9)
    # Then a0 to v0, whether or not they are still on the crossing.
    after = trace.speed_mps[int(until / 0.1) + 1 :]
    gains = np.diff(after) / 0.1
    assert gains[0] == pytest.approx(min(1.0, (V0 - after[0]) / 0.1))
    assert gains.max() <= 1.0 + 1e-9
    assert after.max() <= V0


@pytest.mark.parametrize("speed", [0.0, 5.0])
def test_no_answer_for_someone_who_stands_and_no_margin_by_default(speed: float) -> None:
    # They never leave, so t_x is beyond any: Hard-Yield's constant deceleration to R = 3 m, which
    # differs from v²/2d = 25/54 by a relative 1/(4 n (n − 1)) at most, n = 2 · 27/5/0.1 = 108.
    standing, strategy = PedestrianView(0, Side.NEAR, 2.0, 8.75, 0.0, True), SoftYield()
    answer = strategy.decide(shown(scenario(), R0, speed, standing))
    assert answer == pytest.approx(-(speed**2) / 54, rel=1e-4)
    assert strategy.fallback
