"""The speeds that lanes and curves ahead allow."""

from hypothesis import assume, given, strategies as some

from harness.engine.plain import slowing_mps

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
