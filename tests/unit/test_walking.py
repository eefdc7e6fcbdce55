"""Walks of legs, also beside the centre line: where someone is when, and when they are touched."""

import numpy as np
import pytest

from harness.core.vocabulary import Arrival, Crossing, Leg, Side, Walk
from harness.measures.motion.contact import Body, Motion, first_contact_in_step_s
from harness.measures.motion.walking import cleared_s, states_at

CROSSING = Crossing(9.0, 4.0, 2.25, 4.5)


def walk(*legs: Leg, side: Side = Side.NEAR) -> Walk:
    return Walk(Arrival(0, 0.0, side, 0.5), legs[0].time_s, 1.0, 30.0, 5.0, legs)


def evenly(*legs: tuple[float, float, float]) -> Walk:
    """Legs from their time, place and speed."""
    return walk(*(Leg(time_s, 0.0, y_m, 0.0, y_mps, 0.0) for time_s, y_m, y_mps in legs))


STOPS = evenly((1.0, 0.0, 1.0), (3.0, 2.0, 0.0), (4.5, 2.0, 2.0))


def test_places_speeds_and_the_end_of_a_walk_of_legs() -> None:
    # 2 m in 2 s, 1.5 s standing, 7 m in 3.5 s.
    assert cleared_s(STOPS, CROSSING) == pytest.approx(8.0)
    assert cleared_s(walk(*STOPS.legs[:2]), CROSSING) is None
    # 8.5 m at 1 m/s until 9.5 s, then 1.5 s standing: the last 0.5 m end at 11.5 s, not at 10 s.
    late = evenly((1.0, 0.0, 1.0), (9.5, 8.5, 0.0), (11.0, 8.5, 1.0))
    assert cleared_s(late, CROSSING) == pytest.approx(11.5)
    x, y, speed, gain = states_at(STOPS, CROSSING, np.array([1.0, 2.5, 3.0, 4.0, 4.5, 6.0]))
    np.testing.assert_allclose(y, [0.0, 1.5, 2.0, 2.0, 2.0, 5.0])
    np.testing.assert_allclose(speed, [1.0, 1.0, 0.0, 0.0, 2.0, 2.0])
    assert not x.any()
    assert not gain.any()
    # From the far kerb at 3 m/s, slowing by 0.25 m/s²: 9 m after 3.5165 s, at 3 − 0.8791 m/s.
    slows = walk(Leg(1.0, 0.0, 9.0, 0.0, -3.0, 0.25), side=Side.FAR)
    time_s = (3 - (9 - 4.5) ** 0.5) / 0.25
    assert cleared_s(slows, CROSSING) == pytest.approx(1.0 + time_s)
    _, y, speed, gain = states_at(slows, CROSSING, np.array([2.0, 1.0 + time_s]))
    np.testing.assert_allclose(y, [9 - 3 + 0.125, 0.0], atol=1e-12)
    np.testing.assert_allclose(speed, [2.75, 4.5**0.5])
    np.testing.assert_allclose(gain, -0.25)
    # Slowing by 0.6 m/s² they stand after 7.5 m.
    assert cleared_s(walk(Leg(1.0, 0.0, 9.0, 0.0, -3.0, 0.6), side=Side.FAR), CROSSING) is None


RADIUS_M = 0.25
STEP_S = 2.0
TIMES_S = np.linspace(0.0, STEP_S, 20_001)


def sampled(motion: Motion) -> np.ndarray:
    place, speed, acceleration = motion
    return place + speed * TIMES_S + acceleration * TIMES_S**2 / 2


def test_first_contact_is_that_of_a_fine_sampling() -> None:
    """Distance from the disc's centre to the nearest point of the rectangle, 10 kHz."""
    rng = np.random.default_rng(5)
    touched = missed = 0
    for _ in range(400):
        body = length, right, left = Body(4.5, -0.9, 0.8)
        ego = Motion(rng.uniform(-6, 4), rng.uniform(-8, 8), rng.uniform(-8, 8))
        walker_x = Motion(rng.uniform(-3, 3), rng.uniform(-2, 2))
        walker_y = Motion(rng.uniform(-4, 4), rng.uniform(-4, 4), rng.uniform(-5, 5))
        ahead, y = sampled(walker_x) - sampled(ego), sampled(walker_y)
        away = np.hypot(ahead - np.clip(ahead, -length, 0.0), y - np.clip(y, right, left))
        hits = np.flatnonzero(away <= RADIUS_M)
        found = first_contact_in_step_s(ego, walker_x, walker_y, STEP_S, body)
        if found is None:
            assert not hits.size
            missed += 1
        elif hits.size:
            assert TIMES_S[hits[0]] - 1.01e-4 <= found <= TIMES_S[hits[0]] + 1e-9
            touched += 1
        else:  # a graze between two samples
            assert away.min() < RADIUS_M + 1e-5
    assert touched > 50
    assert missed > 50


def test_who_turns_at_the_very_edge_touches_it() -> None:
    """y = v t − a t²/2 turns at v²/2a after v/a; rounding may keep it a last bit short."""
    rng = np.random.default_rng(6)
    for _ in range(200):
        speed, braking = rng.uniform(0.5, 2.0), rng.uniform(1.5, 4.0)
        turns_m = speed**2 / (2 * braking)
        body = Body(5.0, turns_m + RADIUS_M, turns_m + 2.0)
        motions = Motion(0.0, 0.0), Motion(-2.0, 0.0), Motion(0.0, speed, -braking)
        found = first_contact_in_step_s(*motions, STEP_S, body)
        assert found == pytest.approx(speed / braking, abs=1e-4)
