"""A passage in the straight frame against an encounter, where the road is straight."""

import math
from copy import copy
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as some
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

from harness.core.vocabulary import Arrival, Ending, Leg, Side, Trace, Vehicle, Walk
from harness.measures import measure
from harness.measures.ego import ego_positions
from harness.simulation.cars import PASSED, Car, Facts, Meeting, Passage
from harness.simulation.passages import free_pass_s, passages, strike_of
from harness.simulation.walk import SumoPerson, Walked, moved
from harness.site.path import FrontPath, Lane
from harness.site.town import Connection, Crosswalk
from harness.site.zone import zone_of

STEP_S = 0.1
CAR = Vehicle(10.0, 30.0, 30.0, 5.0, 1.8, 2.6, 4.5, 1.0)
CONNECTION = Connection("a_0", (":J_0_0",), "b_0", "straight", False, shapely.LineString(), 10.0)
NAMES = CONNECTION.from_lane, *CONNECTION.via, CONNECTION.to_lane


def straight(inner_mps: float = 10.0) -> FrontPath:
    """A straight road to the east: 60 m, 8 m inside the junction, 60 m."""
    shapes = [(-60, 0), (0, 0)], [(0, 0), (8, 0)], [(8, 0), (68, 0)]
    limits = [10.0, inner_mps, 10.0]
    return FrontPath.along([*map(Lane, NAMES, shapes, [60.0, 8.0, 60.0], limits, [3.2] * 3)])


def crosswalk() -> Crosswalk:
    """From y = −3 to 5 across the road, 4 m wide around x = 4."""
    return Crosswalk(":J_c0", shapely.LineString([(4, -3), (4, 5)]), 4.0)


def passage(path: FrontPath, walked: Crosswalk | None = None) -> Passage:
    """A car's passage over the crosswalk, or another one."""
    walked = walked or crosswalk()
    zone = zone_of(path, walked, CAR.length_m, CAR.width_m)
    car = Car("car", Facts("type", True, CAR, speed_factor=1.0, max_mps=50.0))
    return Passage(car, Meeting.of(walked, CONNECTION, zone, 100.0), CAR)


def turning(radius_m: float, degrees: float) -> FrontPath:
    """To the east up to the origin, then to the left on an arc, then straight on."""
    angle = np.linspace(0.0, math.radians(degrees), 400)
    arc = radius_m * np.column_stack((np.sin(angle), 1 - np.cos(angle)))
    far = arc[-1] + 60 * np.array([math.cos(angle[-1]), math.sin(angle[-1])])
    shapes = [(-60.0, 0.0), (0.0, 0.0)], [*map(tuple, arc.tolist())], [tuple(arc[-1]), tuple(far)]
    lengths = 60.0, radius_m * angle[-1], 60.0
    return FrontPath.along([*map(Lane, NAMES, shapes, lengths, [10.0] * 3, [3.2] * 3)])


def driven(path: FrontPath, walked: Crosswalk) -> Passage:
    """A passage from 30 m before x = −3 on, at 10 m/s and from t = 20 s on."""
    each = passage(path, walked)
    each.car.note(100.0 - 33.0, 10.0)
    each.begin(20.0, 30.0)
    for number in range(1, 60):
        each.car.note(100.0 - 33.0 + number * 10.0 * STEP_S, 10.0)
    each.end(PASSED)
    return each


@settings(max_examples=150)
@given(
    some.floats(1.0, 14.0),
    some.floats(-2.0, 2.0),
    some.floats(-3.0, 6.0),
    some.floats(0.4, 3.0),
    some.sampled_from(Side),
)
def test_contacts_are_the_encounters(
    speed: float, gain: float, start_s: float, walking: float, side: Side
) -> None:
    """On a straight road the oriented outline and the straight frame find the same contacts."""
    path = straight()
    each = passage(path)
    number = np.arange(80)
    speeds = np.maximum(speed + gain * STEP_S * number, 0.0)
    x_m = -15.0 + np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * STEP_S)])
    each.begin_s = 50.0
    near = side is Side.NEAR
    leg = Leg(50.0 + start_s, 0.0, 0.0 if near else 8.0, 0.0, walking if near else -walking, 0.0)
    cleared_s = 50.0 + start_s + 8.0 / walking
    walk = Walk(Arrival(0, 50.0 + start_s, side, 0.5), 50.0 + start_s, walking, legs=(leg,))
    seen = (moved(walk, 50.0, STEP_S),)
    trace = Trace(CAR, each.crossing, STEP_S, x_m, speeds, seen, Ending.TIMED_OUT)
    time_s = number * STEP_S
    within_s = np.linspace(0.0, time_s[-1], 300)
    exactly_m = CubicHermiteSpline(time_s, x_m, speeds)(within_s)
    assert ego_positions(trace, within_s) == pytest.approx(exactly_m, abs=1e-9)
    euler = replace(trace, x_m=np.cumsum([0.0, *speeds[1:]]) * STEP_S, motion="euler")
    linear_m = np.interp(within_s, time_s, euler.x_m)
    assert ego_positions(euler, within_s) == pytest.approx(linear_m, abs=1e-9)
    person = Walked("p", True, walk, cleared_s, cleared_s)
    strike = strike_of(trace, each, path, [person])
    exact = measure([trace])[0]
    if exact.contact_time_s is None or strike is None:
        # Outlines are compared 8 times a step: a corner may be grazed in between.
        agreed = strike is None and exact.contact_time_s is None
        assert agreed or (exact.min_gap_m is not None and exact.min_gap_m < 0.1)
    else:
        assert strike.time_s == pytest.approx(exact.contact_time_s, abs=STEP_S / 16)
        # What is touched within that time of the corner may be called either.
        front_m = abs(ego_positions(trace, np.array([strike.time_s])).item())
        assert strike.contact is exact.contact or front_m < strike.speed_mps * STEP_S / 16
        assert measure([trace], [strike])[0].contact_time_s == strike.time_s
        assert measure([trace], [None])[0].contact is None


def test_the_rear_of_a_turning_body() -> None:
    """The rear leaves a crosswalk before a turn when its inner corner does, by plane geometry.

    The front is on a circle of radius r, the place a body's length before it on the straight road,
    and the rear left corner at F − L u − w/2 n, u the chord's direction and n its normal.
    """
    radius_m = 6.0
    path, axis = turning(radius_m, 90.0), shapely.LineString([(-3, -4), (-3, 4)])
    each = driven(path, replace(crosswalk(), axis=axis))

    def corner_m(s: float) -> float:
        """How far the rear left corner is beyond the crosswalk's edge at x = −1."""
        front = np.array([math.sin(s / radius_m), 1 - math.cos(s / radius_m)]) * radius_m
        chord = front - [s - CAR.length_m, 0.0]
        ahead = chord / np.hypot(*chord)
        return float(front[0] - CAR.length_m * ahead[0] - CAR.width_m / 2 * ahead[1] + 1.0)

    late, beyond = copy(each), copy(each)
    late.xs_m, late.speeds_mps, late.ended = each.xs_m[:1], each.speeds_mps[:1], "ended"
    beyond.xs_m, beyond.speeds_mps = each.xs_m[30:], each.speeds_mps[30:]
    town: Any = SimpleNamespace(path=lambda _: path)
    them = [each, late, beyond]
    found, alone, inside = passages(them, {each.at.crosswalk.id: []}, town, STEP_S, "euler")
    # Where a vehicle came onto the road beyond the edge, its front never reached it.
    assert (inside["front_s"], inside["rear_s"] is None) == (None, False)
    # A passage that began when the simulation ended has a row: it did not end.
    undefined = ("front_s", "rear_s", "delay_s", "max_deceleration_mps2", "pet_s")
    assert [alone[name] for name in ("steps", *undefined)] == [0, *[None] * 5]
    leaves_m = brentq(corner_m, 2.0, CAR.length_m)
    assert found["rear_s"] == pytest.approx(20.0 + (33.0 + leaves_m) / 10.0, abs=1e-3)


def test_who_stands_where_a_turning_vehicle_comes_back_is_hit() -> None:
    """A body that turns round is on the crosswalk later than a straight one would have left it."""
    axis = shapely.LineString([(-3, -4), (-3, 12)])
    path = turning(4.0, 180.0)
    each = driven(path, replace(crosswalk(), axis=axis))
    # They stand in the middle of the lane on which it comes back, 12 m from the axis's begin.
    walk = Walk(Arrival(0, 20.0, Side.NEAR, 0.5), 20.0, 0.1, legs=(Leg(20.0, 0, 12.0, 0, 0, 0),))
    person, town = Walked("p", True, walk, None, math.inf), SimpleNamespace(path=lambda _: path)
    (row,) = passages([each], {each.at.crosswalk.id: [person]}, cast(Any, town), STEP_S, "euler")
    assert (row["contact"], row["contact_person"]) == ("front", "p")


def test_a_change_of_lane_within_r0() -> None:
    """The straight frame's body becomes that of the other lane's zone; v0 and R0 stay."""
    each = passage(straight())
    each.car.note(70.0, 10.0)
    each.begin(0.0, 30.0)
    before, zone = each.vehicle, replace(each.at.zone, last_m=20.0, width_m=2.5)
    each.move_to(Passage(each.car, each.at._replace(zone=zone), CAR))
    assert each.vehicle == replace(before, length_m=zone.body_m, width_m=2.5)


def test_free_passage_through_a_curve() -> None:
    """Brake from 10 to 5 m/s before the stop line, 8 m at 5 m/s, and speed up behind it."""
    path = straight(5.0)
    each = passage(path)
    braking_m, braking_s = (100 - 25) / (2 * 4.5), 5 / 4.5
    # R0 is 30 m before x = 4; the rear leaves when the front is at 4 + 2 + 5 = 11 m.
    before_s = (26.0 - braking_m) / 10 + braking_s
    after_s = (math.sqrt(25 + 2 * 2.6 * 3.0) - 5) / 2.6
    assert free_pass_s(each, path) == pytest.approx(before_s + 8 / 5 + after_s, abs=1e-3)


@given(some.floats(0, 12))
def test_a_bent_axis(along_m: float) -> None:
    """A place's point has that place, also on a bent crosswalk."""
    bent = replace(crosswalk(), axis=shapely.LineString([(0, 0), (0, 5), (3, 9), (3, 11)]))
    line = bent.line
    assert line.foot(complex(line.position(along_m))) == pytest.approx((along_m, 0.0), abs=1e-9)
    assert line.place(along_m) == pytest.approx(complex(line.position(along_m)), abs=1e-9)
    assert line.foot(0.5 - 2j) == pytest.approx((-2.0, -0.5))
    assert line.foot(3 + 13j) == pytest.approx((14.0, 0.0))


def test_the_mean_speed_of_who_turned_back_is_undefined() -> None:
    """Seen 5 m before the kerb at y = −3, 1 m beyond it, then 4 m beyond or 2 m before it."""
    for last, speed_mps in ((4 + 1j, 3.0), (4 - 5j, None)):
        seen = [(0.0, 4 - 8j, False), (1.0, 4 - 2j, True), (2.0, last, True)]
        person = SumoPerson("p", 0, True, seen).walked(crosswalk())
        assert person.walk.speed_mps == speed_mps
