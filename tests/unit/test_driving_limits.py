"""The speeds that lanes and curves ahead allow, and whether a leader holds a vehicle."""

import pytest
from hypothesis import assume, given, strategies as some

from harness.engine.plain import followed_m, slowing_mps

SPEEDS = some.floats(0, 40)
DECELS = some.floats(1, 9)
STEPS = some.sampled_from([0.05, 0.1, 0.2, 0.5])
AHEAD = some.floats(0.1, 300)


@given(SPEEDS, SPEEDS, AHEAD, DECELS, STEPS)
def test_ballistic_steps_end_at_the_limit(
    speed: float, limit: float, ahead: float, decel: float, step: float
) -> None:
    """A step to v, then constant braking: the limit is reached exactly where it begins."""
    after = slowing_mps(speed, limit, ahead, decel, step, ballistic=True)
    assume(after > limit)
    first_m = (speed + after) * step / 2
    assert abs(first_m + (after**2 - limit**2) / (2 * decel) - ahead) < 1e-6 * max(ahead, 1)


@given(SPEEDS, SPEEDS, AHEAD, DECELS, STEPS)
def test_eulers_steps_end_at_the_limit(
    speed: float, limit: float, ahead: float, decel: float, step: float
) -> None:
    """Who drives as fast as allowed at every step slows by no more than b, to the limit."""
    left, v = ahead, speed
    for _ in range(20_000):
        v, before = slowing_mps(speed, limit, left, decel, step, ballistic=False), v
        if left < ahead:
            assert v >= before - decel * step - 1e-6
        if left - v * step < 1e-9 or v * step < 1e-9:
            break
        left -= v * step
    # The step in which the limit begins is driven at the limit or with the rest of a step.
    assert v <= limit + decel * step + 1e-6


@given(SPEEDS, SPEEDS, AHEAD, DECELS, STEPS, some.booleans())
def test_a_farther_limit_allows_more(
    speed: float, limit: float, ahead: float, decel: float, step: float, ballistic: bool
) -> None:
    near = slowing_mps(speed, limit, ahead, decel, step, ballistic)
    far = slowing_mps(speed, limit, ahead + 1.0, decel, step, ballistic)
    assert far >= near - 1e-9
    assert near >= limit - 1e-9 or ballistic


@pytest.mark.parametrize(
    ("tau_s", "ahead_mps", "gap_m"),
    # Krauss at 10 m/s, b = 4.5 m/s²: 10 (tau + 0.1), and 100/9 m if the leader stands; + 1 m.
    [(1.0, 10.0, 12.0), (2.0, 10.0, 22.0), (2.0, 0.0, 22.0 + 100 / 9), (1.0, 20.0, 1.0)],
)
def test_how_near_a_leader_holds_a_vehicle(tau_s: float, ahead_mps: float, gap_m: float) -> None:
    assert followed_m(ahead_mps, 10.0, 4.5, tau_s, 0.1) == pytest.approx(gap_m)
