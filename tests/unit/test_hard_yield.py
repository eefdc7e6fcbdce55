"""Hard-Yield: one constant deceleration to R = 3 m, waiting, going on (docs/method.md)."""

import math

import numpy as np
import pytest

from harness.core.vocabulary import Side
from harness.measures import measure
from harness.strategies.hard_yield import HardYield
from tests.scenes import play, scenario

STOP_LINE_M = 4.0 / 2 + 1.0


def stands_at(trace) -> float:
    standing = -trace.x_m[trace.speed_mps < 1e-9]
    assert len(standing) > 5
    assert np.ptp(standing) < 1e-9
    return float(standing[0])


@pytest.mark.parametrize("step_s", [0.1, 0.05, 0.3])
@pytest.mark.parametrize(
    ("range_m", "speed"), [(30.0, 5.0), (30.0, 7.3), (60.0, 13.9), (20.0, 9.0)]
)
def test_stops_a_metre_before_the_crosswalk(range_m: float, speed: float, step_s: float) -> None:
    ego = {"trigger_range_m": range_m, "initial_speed_mps": speed}
    scene = scenario(ego=ego, experiment={"step_s": step_s})
    trace = play(HardYield(), [(0.0, Side.NEAR, 0.4)], scene)
    assert stands_at(trace) == pytest.approx(STOP_LINE_M, abs=1e-3)
    # v²/2d, held from the first step to the last but one.
    stop = int(np.argmax(trace.speed_mps < 1e-9))
    braking = -np.diff(trace.speed_mps[:stop]) / step_s
    np.testing.assert_allclose(braking, braking[0], rtol=1e-9)
    wanted = speed**2 / (2 * (range_m - STOP_LINE_M))
    # On a grid of n steps the constant differs by a relative 1/(4 n (n − 1)) at most.
    assert braking[0] == pytest.approx(wanted, rel=1.01 / (4 * stop * (stop - 1)))


def test_waits_for_the_last_and_resumes_at_a0_to_v0() -> None:
    # The first leaves after 18 s, the second, from 12 s on at 1 m/s, at 21 s.
    trace = play(HardYield(), [(0.0, Side.NEAR, 0.5), (12.0, Side.FAR, 1.0)])
    assert stands_at(trace) == pytest.approx(STOP_LINE_M, abs=1e-3)
    moving = np.flatnonzero(trace.speed_mps[150:] > 0) + 150
    assert moving[0] == 211  # the step that begins at 21 s ends with speed
    gains = np.diff(trace.speed_mps[210:]) / 0.1
    assert gains.max() == pytest.approx(1.0)
    np.testing.assert_allclose(gains[:20], 1.0, atol=1e-9)
    assert trace.speed_mps.max() == 5.0


@pytest.mark.parametrize("speed", [5.0, 8.0])
def test_too_late_for_the_line_but_not_for_the_walker(speed: float) -> None:
    # Full braking needs v²/9: 2.78 m and 7.11 m.  They step off when the line is too near, but
    # R = 0.25 m can be kept: brake at the maximum.
    stopping = speed**2 / 9
    appears_at = stopping + 1.5  # less than 3 m more than needed, more than 0.25 m
    scene = scenario(ego={"initial_speed_mps": speed}, pedestrians={"kerb_wait_s": 0.0})
    arrival = (30 - appears_at) / speed
    trace = play(HardYield(), [(arrival, Side.FAR, 0.6)], scene)
    decided = math.ceil(arrival / 0.1)
    braking = -np.diff(trace.speed_mps)[decided:] / 0.1
    whole = int(speed / 0.45)
    np.testing.assert_allclose(braking[:whole], 4.5, atol=1e-9)
    # Rolls on to the next step before it sees them, then stops in about v²/9.
    expected = 30 - speed * decided * 0.1 - stopping
    assert stands_at(trace) == pytest.approx(expected, abs=4.5 * 0.1**2 / 8 + 1e-9)
    assert stands_at(trace) > 0.25
    assert measure([trace])[0].contact is None
