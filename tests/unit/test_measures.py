"""Measures of an episode, worked out by hand or by walking through it in small steps.

Throughout: the ego is 5.0 m long and 1.8 m wide, its lane centre at y = 2.25 m, so its body lies
between y = 1.35 m and 3.15 m; the crosswalk is 9 m from kerb to kerb and 4 m wide; a pedestrian
is a disc of radius 0.25 m on x = 0.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from harness.core.vocabulary import Arrival, Ending, Leg, Side, Walk
from harness.measures import EpisodeRecord, crossing_time_s, measure
from harness.measures.conflicts import time_advantage_s
from tests.scenes import Walker, drive, record


def cruise(*walkers: Walker, step: float = 0.1) -> EpisodeRecord:
    """5 m/s all the way: 37 m to the far edge with the rear bumper take 7.4 s."""
    return record([0.0] * math.ceil(7.6 / step), walkers, step=step)


@pytest.mark.parametrize("step", [0.1, 0.3, 0.17])
def test_pass_time_at_constant_speed(step: float) -> None:
    result = cruise(step=step)
    # 30 m to the centre line, 2 m to the far edge, 5 m for the body.
    assert result.pass_time_s == pytest.approx(37 / 5, abs=1e-12)
    assert result.delay_s == pytest.approx(0.0, abs=1e-12)
    assert result.ending == "crossed"


def test_times_of_acceleration_of_a_place_and_of_a_time_out() -> None:
    # 5 t + t²/2 = 37: t = √99 − 5 = 4.9499 s, between two steps.
    result = record([1.0] * 60)
    assert result.pass_time_s == pytest.approx(math.sqrt(99) - 5, abs=1e-12)
    assert result.delay_s == pytest.approx(math.sqrt(99) - 5 - 7.4, abs=1e-12)
    assert result.steps == 50
    # 5 t − t²/4: at t = 10 s the ego has come 25 m and stands; it never reaches x = 0.
    trace = drive([-0.5] * 100)
    assert trace.speed_mps[-1] == pytest.approx(0.0, abs=1e-9)
    assert crossing_time_s(trace, 0.0) is None
    # 5 t − t²/4 = 9: t = 2 (of 2 and 18).
    assert crossing_time_s(trace, -21.0) == pytest.approx(2.0, abs=1e-9)
    assert crossing_time_s(trace, -30.0) == 0.0
    result = record([-0.5] * 100, ending=Ending.TIMED_OUT)
    assert (result.ending, result.pass_time_s, result.delay_s) == ("timed_out", None, None)
    assert (result.end_s, result.steps) == (pytest.approx(10.0), 100)


def test_failed_episodes_and_those_without_pedestrians() -> None:
    # Its walker would be hit at 5.95 s, had anything worked.
    result = record([0.0] * 76, [(0.0, Side.FAR, 1.0)], ending=Ending.FAILED, reason="SUMO lost it")
    assert (result.ending, result.reason) == ("failed", "SUMO lost it")
    assert (result.pass_time_s, result.contact, result.contact_time_s) == (None, None, None)
    result = cruise()
    for name in ("min_gap_m", "min_ttc_s", "min_time_advantage_s", "pet_s", "contact_index"):
        assert getattr(result, name) is None
    assert (result.pedestrians, result.stops, result.stopped_s) == (0, 0, 0.0)
    assert result.max_deceleration_mps2 == 0.0
    result = record([], ending=Ending.FAILED)  # before its first step
    assert (result.steps, result.stops, result.stopped_s) == (0, None, None)


def test_stopped_time_and_strongest_deceleration() -> None:
    # 5 m/s at −2 m/s² stands after 2.5 s, waits 3 s, goes on at 1.25 m/s² for 8 s.
    plan = [-2.0] * 25 + [0.0] * 30 + [1.25] * 80
    result = record(plan)
    # Below 0.1 m/s: at the ends of the braking's last step and of every waiting one.
    assert (result.stops, result.stopped_s) == (1, pytest.approx(3.1, abs=1e-9))
    assert result.max_deceleration_mps2 == pytest.approx(2.0, abs=1e-9)
    # 6.25 m braking, then 30.75 m in 1.25 t²/2: 5.5 s + 7.014 s.
    expected = 5.5 + math.sqrt(2 * 30.75 / 1.25)
    assert result.pass_time_s == pytest.approx(expected, abs=1e-9)
    assert result.delay_s == pytest.approx(expected - 7.4, abs=1e-9)


def test_contacts_with_the_front_the_side_and_a_corner() -> None:
    # From the far kerb at 1 m/s they are at the lane's centre at 6.75 s; y(5.95) = 3.05 m lies
    # before the bumper, which is 0.25 m short of x = 0 at 5.95 s.
    result = cruise((0.0, Side.FAR, 1.0))
    assert (result.ending, result.contact, result.contact_index) == ("crashed", "front", 0)
    assert result.contact_time_s == pytest.approx(5.95, abs=1e-9)
    assert result.contact_speed_mps == pytest.approx(5.0)
    assert result.end_s == result.contact_time_s
    assert result.steps == 60  # the step in which it happened is the sixtieth
    assert result.min_gap_m == 0.0
    assert (result.pass_time_s, result.delay_s, result.values["pet_s"]) == (None, None, None)
    # Their disc meets the right side (y = 1.10 m) at 6.5 s; the bumper is 2.5 m past them.
    result = cruise((5.4, Side.NEAR, 1.0))
    assert (result.ending, result.contact) == ("crashed", "side")
    assert result.contact_time_s == pytest.approx(6.5, abs=1e-9)
    # At 5.97 s the bumper is at −0.15 m and they are 0.20 m past the left side: a 3-4-5 triangle.
    result = cruise((2.62, Side.NEAR, 1.0))
    assert result.contact == "front"
    assert result.contact_time_s == pytest.approx(5.97, abs=1e-9)
    # A centimetre further on at the same moment: √(0.15² + 0.21²) > 0.25, and going away.
    assert cruise((2.55, Side.NEAR, 1.0)).contact is None


def test_the_earliest_of_several_contacts_counts() -> None:
    walkers = [(5.4, Side.NEAR, 1.0), (0.0, Side.FAR, 1.0), (6.2, Side.FAR, 1.0)]
    result = cruise(*walkers)
    assert (result.contact_index, result.contact) == (1, "front")
    # The one who comes at 6.2 s steps off after the record's end.
    assert result.pedestrians == 2
    only_side = cruise(walkers[0], walkers[2])
    assert (only_side.contact_index, only_side.contact) == (0, "side")


def test_at_every_contact_gap_and_time_to_collision_are_nothing() -> None:
    # In front, from the side, at a corner, and inside the one step in which they step off.
    touched = [
        cruise((0.0, Side.FAR, 1.0)),
        cruise((5.4, Side.NEAR, 1.0)),
        cruise((2.62, Side.NEAR, 1.0)),
        record([0.0, 0.0], [(0.0, Side.NEAR, 4.5)], speed=60.0, step=1.0),
    ]
    assert [result.contact for result in touched] == ["front", "side", "front", "front"]
    assert [(result.min_ttc_s, result.min_gap_m) for result in touched] == [(0.0, 0.0)] * 4


def test_post_encroachment_time_by_hand() -> None:
    # Their disc leaves the ego's path at 3.40 m / 1.5 m/s; the bumper is at −0.25 m at 5.95 s.
    first = cruise((0.0, Side.NEAR, 1.5)).values
    assert first["pet_s"] == pytest.approx(5.95 - 3.4 / 1.5, abs=1e-9)
    # From the far side they leave it 6.75 + 1.15 = 7.9 m from their kerb.
    assert cruise((0.0, Side.FAR, 2.0)).pet_s == pytest.approx(5.95 - 7.9 / 2, abs=1e-9)
    # The rear bumper is 0.25 m past them at 35.25/5 = 7.05 s; they enter at 1.10 m.
    assert cruise((6.9, Side.NEAR, 1.0)).pet_s == pytest.approx(6.9 + 1.1 - 7.05, abs=1e-9)
    assert cruise((3.0, Side.FAR, 1.0)).pet_s == pytest.approx(3.0 + 5.6 - 7.05, abs=1e-9)
    # The smallest of several.
    both = cruise((6.9, Side.NEAR, 1.0), (3.0, Side.FAR, 1.0))
    assert both.pet_s == pytest.approx(6.9 + 1.1 - 7.05, abs=1e-9)
    # At 5.95 s they are at 3.38 m, still inside the path, and pass the corner 0.28 m away.
    result = cruise((2.57, Side.NEAR, 1.0))
    assert result.contact is None
    assert result.pet_s == 0.0
    standing = record([-0.5] * 100, [(0.0, Side.NEAR, 0.5)], ending=Ending.TIMED_OUT)
    assert standing.pet_s is None


def pet_of(*legs: Leg) -> float | None:
    walk = Walk(Arrival(0, legs[0].time_s, Side.NEAR, 0.5), legs[0].time_s, 1.5, legs=legs)
    return measure([replace(drive([0.0] * 76), walks=(walk,))])[0].pet_s


def test_post_encroachment_time_of_who_is_on_the_road_or_beside_the_centre_line() -> None:
    # At y = 2 m, in the path already, at 0.5 m/s: they leave it at 3.40 m after 2.8 s.
    assert pet_of(Leg(0.0, 0.0, 2.0, 0.0, 0.5, 0.0)) == pytest.approx(5.95 - 2.8, abs=1e-9)
    # At y = 3.40 m, on its edge, they are in it and leave it at once.
    assert pet_of(Leg(0.0, 0.0, 3.4, 0.0, 0.5, 0.0)) == pytest.approx(5.95, abs=1e-9)
    # At y = 3.5 m they have left it, and never enter it.
    assert pet_of(Leg(0.0, 0.0, 3.5, 0.0, 0.5, 0.0)) is None
    # They walk along x = 1.7 m: the bumper meets their line at 1.45 m, 31.45/5 = 6.29 s; the rear
    # leaves it at 1.95 m, 36.95/5 = 7.39 s.
    assert pet_of(Leg(0.0, 1.7, 0.0, 0.0, 1.5, 0.0)) == pytest.approx(6.29 - 3.4 / 1.5, abs=1e-9)
    assert pet_of(Leg(6.9, 1.7, 0.0, 0.0, 1.0, 0.0)) == pytest.approx(8.0 - 7.39, abs=1e-9)
    # They drift at 0.5 m/s from x = −1 m on; within the path (y = 1.1 … 3.4 m, 1.1 … 3.4 s) they
    # come from −0.45 to 0.7 m: the bumper is at −0.7 m at 29.3/5 = 5.86 s.
    drifting = (Leg(0.0, -1.0, 0.0, 0.5, 1.0, 0.0), Leg(4.0, 1.0, 4.0, 0.0, 1.0, 0.0))
    assert pet_of(*drifting) == pytest.approx(5.86 - 3.4, abs=1e-9)


def test_time_advantage_and_time_to_collision_by_hand() -> None:
    # |R/v − L/v_p| with R/v = 6 − t, L/v_p = 2.25/1.5 − t: 4.5 s as long as both approach.
    assert cruise((0.0, Side.NEAR, 1.5)).min_time_advantage_s == pytest.approx(4.5, abs=1e-9)
    # Who stands approaches nothing: 9 m at 0.1 m/s, 1 m at 1 m/s, and each slower than 0.1 m/s.
    ego, walker = np.array([0.1, 0.09, 0.1]), np.array([1.0, 1.0, 0.09])
    found = time_advantage_s(np.full(3, 9.0), ego, np.ones(3), walker)
    np.testing.assert_allclose(found, [89.0, np.inf, np.inf])
    # They step off at 3.2 s: 1.3 s, after the ego by no more.
    result = cruise((3.2, Side.NEAR, 1.5))
    assert result.min_time_advantage_s == pytest.approx(6 - 3.2 - 1.5, abs=1e-9)
    # Timed out 5 s into a collision course of 5.95 s from the start: it falls with the clock, and
    # the last step begins at 4.9 s.
    result = record([0.0] * 50, [(0.0, Side.FAR, 1.0)], ending=Ending.TIMED_OUT)
    assert result.min_ttc_s == pytest.approx(1.05, abs=1e-9)
    # Somebody who clears with time to spare never was on one.
    assert cruise((0.0, Side.NEAR, 1.5)).min_ttc_s is None
    # Braking from a collision course: at t = 0 the ego would hit them after 5.95 s; afterwards
    # R/v only grows, until they would be past.
    braking = record([-1.0] * 50, [(0.0, Side.FAR, 1.0)], ending=Ending.TIMED_OUT)
    assert braking.min_ttc_s == pytest.approx(5.95, abs=1e-9)


def test_pedestrian_delay_by_hand() -> None:
    # The record ends with the pass at 7.4 s.  Waits: 0.5 s; 4.0 s; from 3 s on to the end; from
    # 7.0 s on to the end, for they go only later.  Nobody counts who comes after it.
    plan = [(1.0, 1.5), (2.0, 6.0), (3.0, None), (7.0, 9.0), (7.5, 7.5)]
    walks = tuple(
        Walk(Arrival(i, came, Side.FAR, 0.5), went, None if went is None else 2.5, 30.0, 5.0)
        for i, (came, went) in enumerate(plan)
    )
    (result,) = measure([replace(drive([0.0] * 76), walks=walks)])
    assert result.pass_time_s == pytest.approx(7.4)
    assert result.pedestrian_delay_s == pytest.approx((0.5 + 4.0 + 4.4 + 0.4) / 4, abs=1e-9)
    assert cruise().pedestrian_delay_s is None
    assert cruise((0.0, Side.NEAR, 1.5)).pedestrian_delay_s == 0.0


def test_contacts_while_braking_and_between_two_steps() -> None:
    # 6 t − t²/4 = 29.75 m: t = (6 − √(36 − 29.75)) / 0.5 = 7 s, at 6 − 3.5 = 2.5 m/s.
    result = record([-0.5] * 110, [(0.0, Side.NEAR, 0.3)], speed=6.0, ending=Ending.TIMED_OUT)
    assert result.contact == "front"
    assert result.contact_time_s == pytest.approx(7.0, abs=1e-9)
    assert result.contact_speed_mps == pytest.approx(2.5, abs=1e-9)
    assert result.max_deceleration_mps2 == pytest.approx(0.5, abs=1e-9)
    # At 60 m/s a step of 1 s jumps over them: bumper −30 m, then 30 m.  Contact 29.75/60 s.
    result = record([0.0, 0.0], [(0.0, Side.NEAR, 4.5)], speed=60.0, step=1.0)
    assert result.contact_time_s == pytest.approx(29.75 / 60, abs=1e-9)


def test_least_gap_and_time_to_collision_against_stepping() -> None:
    """At each step both keep their velocities, and walk and drive on by 0.5 ms for 12 s."""
    rng, ahead_s, collisions = np.random.default_rng(4), np.arange(0.0, 12.0, 0.0005), 0

    def gap_m(front: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.hypot(np.clip(0.0, front - 5.0, front), np.clip(y, 1.35, 3.15) - y) - 0.25

    for _ in range(150):
        start_s, pace = rng.integers(20, 65) / 10, rng.uniform(0.5, 2.5)
        trace = drive(rng.uniform(-1.5, 1.5, 10).repeat(8).tolist(), [(start_s, Side.NEAR, pace)])
        (result,) = measure([trace])
        end_s = result.contact_time_s or result.pass_time_s or 8.0
        n = np.arange(round(start_s * 10), math.ceil(min(end_s, start_s + 9 / pace) * 10))
        front, speed, y = trace.x_m[n, None], trace.speed_mps[n, None], pace * (n / 10 - start_s)
        gaps = gap_m(front + speed * ahead_s, y[:, None] + pace * ahead_s)
        hits = gaps <= 0.0
        if result.contact or not n.size:
            continue
        assert result.min_gap_m == pytest.approx(gaps[:, 0].min(), abs=1e-9)
        if hits.any():
            ttc_s = ahead_s[hits.argmax(axis=1)[hits.any(axis=1)]].min()
            assert result.min_ttc_s == pytest.approx(ttc_s, abs=6e-4)
        else:
            assert result.min_ttc_s is None or result.min_ttc_s > 11.9
        collisions += hits.any()
    assert collisions > 8
