"""The speeds that lanes and curves ahead allow, and whether a leader holds a vehicle."""

from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import assume, given, strategies as some

from harness.core.vocabulary import LEADER, RIGHT_OF_WAY, Vehicle
from harness.engine.plain import slowing_mps
from harness.engine.session import Leader
from harness.simulation.cars import Car
from harness.simulation.driving import Control

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
    ("tau_s", "gap_m", "ahead_mps", "held_by"),
    # Krauss at 10 m/s, b = 4.5 m/s²: 10 (tau + 0.1), and 100/9 m if the leader stands; + 1 m.
    [(1.0, 11.9, 10.0, LEADER), (1.0, 12.1, 10.0, RIGHT_OF_WAY), (2.0, 21.9, 10.0, LEADER),
     (2.0, 22.1, 10.0, RIGHT_OF_WAY), (2.0, 33.1, 0.0, LEADER), (2.0, 33.2, 0.0, RIGHT_OF_WAY)],
)  # fmt: skip
def test_whom_a_slower_vehicle_follows(tau_s, gap_m, ahead_mps, held_by) -> None:
    own = {"headway_s": lambda _: tau_s, "speed_mps": lambda _: ahead_mps}
    session: Any = SimpleNamespace(vehicles=SimpleNamespace(**own), step_s=0.1)
    session.leader = lambda _, sight_m: Leader("first", gap_m) if gap_m < sight_m - 2.5 else None
    setup: Any = SimpleNamespace(config=SimpleNamespace(ballistic=False))
    vehicle = Vehicle(10.0, 30.0, 30.0, 5.0, 1.8, 2.6, 4.5, 1.0)
    car = Car("car", "type", automated=True, vehicle=vehicle, speed_factor=1.0, max_mps=50.0)
    Control(session, setup, {}).check(car, asked_mps=10.0, before_mps=10.0)
    assert car.held_by == held_by
