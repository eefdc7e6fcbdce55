"""What holds of any scene: later is the same, mirrored is the same, braking harder hits softer."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from harness.core.vocabulary import Ending, Side, Strategy, Trace
from harness.encounter.arms import named_strategy
from harness.measures import MEASURES, measure
from harness.scenario import Scenario
from harness.strategies.registry import STRATEGIES
from tests.scenes import Walker, drive, play, scenario

some = settings(max_examples=40)

WALKER = st.tuples(st.floats(0, 6), st.sampled_from(Side), st.floats(0.3, 3))
WALKERS = st.lists(WALKER, max_size=3)
PLAN = st.lists(st.sampled_from([-3.0, -1.0, 0.0, 0.0, 1.0]), min_size=20, max_size=60)

FROM_THE_TRIGGER = {
    *("pass_time_s", "pass_time_ignoring_contact_s", "delay_s"),
    *("rms_acceleration_mps2", "rms_jerk_mps3"),
}
"""What counts from the trigger on, and so knows how far away it was."""

assert {*FROM_THE_TRIGGER} <= {entry.column for entry in MEASURES}


def one_way(lane: int) -> dict[str, dict[str, object]]:
    """Two lanes of one direction: the ego in one of them is the mirror image of it in the other."""
    return {"crossing": {"lanes": 2, "oncoming_lanes": 0}, "ego": {"lane": lane}}


def mirrored(walkers: list[Walker]) -> list[Walker]:
    other = {Side.NEAR: Side.FAR, Side.FAR: Side.NEAR}
    return [(at, other[side], speed) for at, side, speed in walkers]


def never_backwards(plan: list[float], speed: float, step: float = 0.1) -> list[float]:
    """The plan as a vehicle can drive it, which stands rather than going back."""
    driven = []
    for acceleration in plan:
        driven.append(max(acceleration, -speed / step))
        speed += driven[-1] * step
    return driven


def assert_same(one: Trace, other: Trace, but_for: set[str] | frozenset[str] = frozenset()) -> None:
    # Measured apart: traces of one call are of one cell.
    (first,), (second,) = measure([one]), measure([other])
    assert first.ending == second.ending
    for entry in MEASURES:
        if entry.column in but_for:
            continue
        mine, theirs = getattr(first, entry.column), getattr(second, entry.column)
        same = mine == theirs or mine == pytest.approx(theirs or math.nan, rel=1e-6, abs=1e-6)
        assert same, (entry.column, mine, theirs)


@some
@given(PLAN, WALKERS)
def test_measures_of_the_mirror_image(plan: list[float], walkers: list[Walker]) -> None:
    plan = never_backwards(plan, 5.0)
    right = drive(plan, walkers, scene=scenario(**one_way(0)), ending=Ending.TIMED_OUT)
    left = drive(plan, mirrored(walkers), scene=scenario(**one_way(1)), ending=Ending.TIMED_OUT)
    assert_same(right, left)


@pytest.mark.parametrize("name", sorted({*STRATEGIES} - {"sumo_driver"}))
@settings(some, max_examples=15)
@given(walkers=WALKERS)
def test_strategies_in_the_mirror_image(model, name: str, walkers: list[Walker]) -> None:
    def driver(scene: Scenario) -> Strategy:
        return named_strategy(scene, name, model, lambda: np.random.default_rng(5))

    right, left = (scenario(**one_way(lane)) for lane in (0, 1))
    right = play(driver(right), walkers, right)
    left = play(driver(left), mirrored(walkers), left)
    np.testing.assert_allclose(right.x_m, left.x_m, atol=1e-6)
    np.testing.assert_allclose(right.speed_mps, left.speed_mps, atol=1e-6)


@some
@given(st.floats(0.5, 8), st.floats(2, 20), st.floats(0.2, 6), st.floats(0.2, 6))
def test_who_brakes_harder_hits_softer(speed, ahead_m, first, second) -> None:
    """Somebody slow stands in the lane from the beginning: v² = v0² − 2 b d, or no contact."""
    scene = scenario(ego={"trigger_range_m": ahead_m + 2})
    # 2.25 m, the middle of the lane, at the trigger; 0.05 m/s keeps them there.
    walker = (-2.25 / 0.05, Side.NEAR, 0.05)
    hit = []
    for deceleration in sorted((first, second)):
        plan = never_backwards([-deceleration] * 600, speed)
        trace = drive(plan, [walker], speed=speed, scene=scene, ending=Ending.TIMED_OUT)
        trace = shifted(trace, 30.0 - (ahead_m + 2))
        (record,) = measure([trace])
        hit.append(record.contact_speed_mps or 0.0)
        expected = speed**2 - 2 * deceleration * (ahead_m + 2 - 0.25)
        if expected > 0.2:
            assert hit[-1] == pytest.approx(math.sqrt(expected), abs=0.02)
    assert hit[1] <= hit[0] + 1e-9


def shifted(trace: Trace, metres: float) -> Trace:
    return replace(trace, x_m=trace.x_m + metres)


@some
@given(PLAN, WALKERS, st.integers(1, 30))
def test_everything_later_is_the_same(plan: list[float], walkers: list[Walker], steps: int) -> None:
    """The ego comes from farther away at its speed, and everybody steps off as much later."""
    plan, late_s = never_backwards(plan, 5.0), 0.1 * steps
    now = drive(plan, walkers, ending=Ending.TIMED_OUT)
    later = drive(
        [0.0] * steps + plan,
        [(at + late_s, side, speed) for at, side, speed in walkers],
        ending=Ending.TIMED_OUT,
    )
    assert_same(now, shifted(later, -5.0 * late_s), FROM_THE_TRIGGER)
