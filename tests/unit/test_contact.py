"""The first contact inside a step against a sampling of the two motions, and by hand."""

import numpy as np
import pytest

from harness.measures.motion.contact import Motion, first_contact_in_step

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
        length, right, left = 4.5, -0.9, 0.8
        ego = Motion(rng.uniform(-6, 4), rng.uniform(-8, 8), rng.uniform(-8, 8))
        walker_x = Motion(rng.uniform(-3, 3), rng.uniform(-2, 2))
        walker_y = Motion(rng.uniform(-4, 4), rng.uniform(-4, 4), rng.uniform(-5, 5))
        ahead, y = sampled(walker_x) - sampled(ego), sampled(walker_y)
        away = np.hypot(ahead - np.clip(ahead, -length, 0.0), y - np.clip(y, right, left))
        hits = np.flatnonzero(away <= RADIUS_M)
        found = first_contact_in_step(ego, walker_x, walker_y, STEP_S, (length, right, left))
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
        body = (5.0, turns_m + RADIUS_M, turns_m + 2.0)
        standing, beside = Motion(0.0, 0.0), Motion(-2.0, 0.0)
        found = first_contact_in_step(standing, beside, Motion(0.0, speed, -braking), STEP_S, body)
        assert found == pytest.approx(speed / braking, abs=1e-4)
