"""Deceleration that was needed, deceleration that was used, and crashes that need not have been.

The scene is that of ``test_measures``: body between y = 1.35 m and 3.15 m, 5 m long; crosswalk of
9 m; a disc of 0.25 m on x = 0, so the bumper may come up to x = −0.25 m.
"""

import math

import numpy as np
import pytest

from harness.core.vocabulary import Ending, Side
from harness.measures import EpisodeRecord, measure
from tests.scenes import Walker, drive, record, scenario


def cruise(*walkers: Walker, speed: float = 5.0) -> EpisodeRecord:
    return record([0.0] * math.ceil(38 / speed / 0.1), walkers, speed=speed)


def braking(plan: list[float], *walkers: Walker) -> EpisodeRecord:
    return record(plan, walkers, ending=Ending.TIMED_OUT)


def test_drac_by_hand() -> None:
    # d = 29.75 m; their disc is past the right side after 9 − 1.10 = 7.9 m, T = 7.9 s.  A constant
    # a with 5 T − a T²/2 = d; still moving then, as 5 · 7.9 < 2 · 29.75.  Braking at 1 m/s² from
    # there on, DRAC falls.
    result = braking([-1.0] * 50, (0.0, Side.FAR, 1.0))
    expected = (5 * 7.9 - 29.75) * 2 / 7.9**2
    assert result.max_drac_mps2 == pytest.approx(expected, abs=1e-9)
    # At 0.25 m/s from the near kerb they are in the way from 4.4 s until 13.6 s: rolling up to them
    # in that time would take a negative speed, so it is v²/2d.
    result = braking([-1.0] * 50, (0.0, Side.NEAR, 0.25))
    assert result.max_drac_mps2 == pytest.approx(25 / (2 * 29.75), abs=1e-9)
    # 3 s at constant speed: d = 14.75 m, T = 4.9 s; then 2 m/s², more than DRAC, which so falls.
    result = braking([0.0] * 30 + [-2.0] * 25, (0.0, Side.FAR, 1.0))
    assert result.max_drac_mps2 == pytest.approx((5 * 4.9 - 14.75) * 2 / 4.9**2, abs=1e-9)


def test_required_deceleration_by_hand() -> None:
    result = braking([-1.0] * 50, (0.0, Side.FAR, 1.0))
    assert result.required_deceleration_mps2 == pytest.approx(25 / (2 * 29.75), abs=1e-9)
    # A crash does not change what was needed when they came into sight.
    expected = pytest.approx(25 / (2 * 29.75), abs=1e-9)
    assert cruise((0.0, Side.FAR, 1.0)).required_deceleration_mps2 == expected
    # At 3.05 s the bumper is 14.75 m before the centre line; they will be hit 2.9 s later.
    result = cruise((3.05, Side.NEAR, 0.6))
    assert result.contact == "front"
    assert result.required_deceleration_mps2 == pytest.approx(25 / (2 * 14.5), abs=1e-9)
    # 20 m of sight: the first such state is at 2.0 s.
    scene = scenario(ego={"detection_range_m": 20.0})
    trace = drive([0.0] * 76, [(0.0, Side.FAR, 1.0)], scene=scene)
    (result,) = measure([trace])
    assert result.required_deceleration_mps2 == pytest.approx(25 / (2 * 19.75), abs=1e-9)
    assert cruise((0.0, Side.NEAR, 1.5)).required_deceleration_mps2 is None
    assert cruise().required_deceleration_mps2 is None
    # Of two the larger.
    two = cruise((0.0, Side.FAR, 1.0), (3.05, Side.NEAR, 0.6))
    assert two.required_deceleration_mps2 == pytest.approx(25 / (2 * 14.5), abs=1e-9)


def test_jerk_by_hand() -> None:
    # 0 → −2 → 0 → 1.25 m/s², each from one step of 0.1 s to the next.
    assert record([-2.0] * 25 + [0.0] * 30 + [1.25] * 80).max_jerk_mps3 == pytest.approx(20)
    assert record([0.0] * 10 + [1.0] * 60).max_jerk_mps3 == pytest.approx(10)
    assert cruise().max_jerk_mps3 == 0.0
    # The jump at 6.0 s comes after the contact at 5.95 s.
    assert record(
        [0.0] * 60 + [-4.5] * 5, [(0.0, Side.FAR, 1.0)], ending=Ending.TIMED_OUT
    ).max_jerk_mps3 == pytest.approx(0.0, abs=1e-9)


def test_root_mean_squares_by_hand() -> None:
    # 25 steps at −2 m/s², 30 at 0, 80 at 1.25; the jumps 20, 20 and 12.5 m/s³, until the pass.
    driven = record([-2.0] * 25 + [0.0] * 30 + [1.25] * 80)
    gains = driven.steps - 55
    assert 0 < gains <= 80
    mean_square = (25 * 4 + gains * 1.25**2) / driven.steps
    assert driven.rms_acceleration_mps2 == pytest.approx(math.sqrt(mean_square))
    mean_square = (20**2 + 20**2 + 12.5**2) / driven.steps
    assert driven.rms_jerk_mps3 == pytest.approx(math.sqrt(mean_square))
    assert (cruise().rms_acceleration_mps2, cruise().rms_jerk_mps3) == (0.0, 0.0)


def test_avoidable_by_stopping_short() -> None:
    # From 5 m/s at 4.5 m/s² the ego stops in 2.778 m, so it must have 3.028 m when they step off,
    # at 5.3944 s.  They walk into the flank all the same at constant speed.
    for start, expected in ((5.38, True), (5.3943, True), (5.3946, False), (5.4, False)):
        result = cruise((start, Side.NEAR, 1.0))
        assert result.contact == "side"
        assert result.avoidable is expected, start


def test_avoidable_by_letting_them_leave() -> None:
    # 20 m away at 15 m/s the ego cannot stop (25 m), but with 15 t − 2.25 t² = 19.75 it comes to
    # them after 1.806 s, when they have left (3.4 m at 2.5 m/s, 1.36 s); unbraked after 1.317 s.
    result = cruise((2 / 3, Side.NEAR, 2.5), speed=15.0)
    assert result.contact == "front"
    assert result.avoidable is True
    # At 1.8 m/s they are in the way until 1.889 s.
    slower = cruise((2 / 3, Side.NEAR, 1.8), speed=15.0)
    assert slower.contact == "front"
    assert slower.avoidable is False
    # The first to be hit is somebody who steps off at the trigger: any braking would have done.
    result = cruise((5.4, Side.NEAR, 1.0), (0.0, Side.FAR, 1.0))
    assert (result.contact_index, result.avoidable) == (1, True)
    assert cruise((0.0, Side.NEAR, 1.5)).avoidable is None
    assert cruise().avoidable is None


def touched(start: float, side: Side, pace: float, speed: float) -> bool:
    """Half a millisecond at a time, from stepping off at x = −30 + v · start to the other kerb."""
    times = np.arange(0.0, 9 / pace, 0.0005)
    moving = np.minimum(times, speed / 4.5)
    driven = speed * moving - 4.5 * moving**2 / 2
    front = -30 + speed * start + driven
    y = pace * times if side is Side.NEAR else 9 - pace * times
    along = np.minimum(np.maximum(0.0, front - 5.0), front)
    across = np.clip(y, 1.35, 3.15) - y
    return bool(np.any(np.hypot(along, across) <= 0.25))


def test_avoidable_against_stepping_through_random_crashes() -> None:
    rng = np.random.default_rng(3)
    found = []
    while len(found) < 60:
        speed, pace = float(rng.choice([5.0, 10.0, 15.0])), float(rng.uniform(0.4, 2.5))
        side = Side.NEAR if rng.random() < 0.5 else Side.FAR
        # Within the time in which braking may come too late.
        start = float(rng.uniform(0.0, 31.0 / speed))
        result = cruise((start, side, pace), speed=speed)
        if result.contact is not None:
            found.append(result.avoidable)
            expected = not touched(start, side, pace, speed)
            assert result.avoidable is expected, (start, side, pace, speed)
    assert 15 < sum(found) < 45


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize(("speed", "limit", "far_pace"), [(5.0, 4.5, 3.0), (10.0, 9.0, 2.75)])
def test_an_attentive_driver_needs_this_way_to_stop(side, speed, limit, far_pace) -> None:
    # 1.15 s at v, then b/j until b = min(0.774 g, limit) is reached, v − j t²/2 being left, then
    # v²/2b.  0.25 m is the disc.
    b, j = min(0.774 * 9.80665, limit), 12.65
    grows = b / j
    way = 1.15 * speed + speed * grows - j * grows**3 / 6 + (speed - j * grows**2 / 2) ** 2 / 2 / b
    latest = (30 - 0.25 - way) / speed
    # They are in its path from before an unbraked front comes until the attentive driver stands.
    pace = 1.0 if side is Side.NEAR else far_pace
    scene = scenario(ego={"max_deceleration_mps2": limit})
    for start, expected in ((latest - 1e-5, True), (latest + 1e-5, False)):
        trace = drive([0.0] * 76, [(start, side, pace)], speed=speed, scene=scene)
        (result,) = measure([trace])
        assert (result.contact, result.avoidable) == ("front", True)
        assert result.avoidable_attentive is expected
    assert cruise((0.0, Side.NEAR, 1.5)).avoidable_attentive is None
