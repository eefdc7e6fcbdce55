"""Paths and zones against geometry by hand: straight, bent, stretched, oblique, left-hand."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

from harness.site.path import FrontPath, Lane
from harness.site.town import Crosswalk
from harness.site.zone import Zone, zone_of

Points = list[tuple[float, float]]
LIMIT_MPS = 13.9


def walk(
    start: complex, end: complex, width_m: float = 4.0, *, left_hand: bool = False
) -> Crosswalk:
    """A straight crosswalk."""
    axis = shapely.LineString([(start.real, start.imag), (end.real, end.imag)])
    return Crosswalk("c", axis, width_m, left_hand)


def drawn_m(shape: Points) -> float:
    return sum(math.dist(a, b) for a, b in pairwise(shape))


def path(*shapes: Points, stretched: float = 1.0) -> FrontPath:
    """Successive lanes, of which the first one ends at the stop line."""
    lanes = [
        Lane(str(n), shape, stretched * drawn_m(shape), LIMIT_MPS - n, 3.2)
        for n, shape in enumerate(shapes)
    ]
    return FrontPath.along(lanes)


def straight(stretched: float = 1.0) -> FrontPath:
    """Along y = 0; the stop line is at x = 0."""
    points = [-60.0, 0.0, 8.0, 80.0]
    return path(*([(a, 0.0), (b, 0.0)] for a, b in pairwise(points)), stretched=stretched)


def arc(radius_m: float, degrees: float, sign: int = 1) -> Points:
    """An arc from the origin, to the left (1) or right (-1) of a vehicle that comes along y = 0."""
    angles = np.radians(np.linspace(0.0, degrees, 400))
    return [(radius_m * math.sin(a), sign * radius_m * (1 - math.cos(a))) for a in angles]


def turning(radius_m: float, sign: int = 1) -> FrontPath:
    """Along y = 0 to the origin, then a quarter circle, then straight on."""
    quarter = arc(radius_m, 90.0, sign)
    x, y = quarter[-1]
    end = (x, y + sign * 25.0)
    return path([(-60.0, 0.0), (0.0, 0.0)], [*quarter, end], [end, (x, y + sign * 60.0)])


def met(*of: Any) -> Zone:
    """The zone of a body that touches the crosswalk."""
    zone = zone_of(*of)
    assert zone is not None
    return zone


def numbers(zone: Zone) -> list[float]:
    return [zone.first_m, zone.last_m, *covered(zone)]


def covered(zone: Zone) -> tuple[float, float]:
    """The interval of y that the body covers."""
    centre_m, half_m = zone.crossing.lane_centre_m, zone.width_m / 2
    return centre_m - half_m, centre_m + half_m


def test_a_straight_road() -> None:
    road = straight()
    assert [lane.limit_mps for lane in road.lanes] == [LIMIT_MPS, LIMIT_MPS - 1, LIMIT_MPS - 2]
    assert road.starts_m.tolist() == [-60.0, 0.0, 8.0, 80.0]
    # The road goes straight on beyond both of its ends.
    np.testing.assert_allclose(road.position([-70.0, 3.5, 90.0]), [-70, 3.5, 90])
    np.testing.assert_allclose(road.heading([-70.0, 3.5, 90.0]), 1.0)
    body = road.outline(2.0, 5.0, 1.8)
    np.testing.assert_allclose(body, [[2, -0.9], [2, 0.9], [-3, 0.9], [-3, -0.9]])


def test_a_crosswalk_at_right_angles() -> None:
    zone = met(straight(), walk(2 - 3j, 2 + 6j), 5.0, 1.8)
    # 4 m wide, from x = 0 to 4; the near kerb is on the right, 3 m from the lane's centre.
    assert numbers(zone) == pytest.approx([0.0, 9.0, 2.1, 3.9], abs=1e-6)
    assert (zone.centre_m, zone.crossing.width_m) == pytest.approx((2.0, 4.0), abs=1e-6)
    crossing = zone.crossing
    assert crossing.length_m == pytest.approx(9.0)
    assert (crossing.lane_centre_m, crossing.lane_width_m) == pytest.approx((3.0, 3.2), abs=1e-6)
    assert crossing.speed_limit_mps == LIMIT_MPS
    assert not zone.split
    assert not zone.reverse


@pytest.mark.parametrize("degrees", [30.0, 45.0, 60.0, 120.0])
def test_a_corner_of_an_oblique_body_is_first_at_the_line_on_which_people_walk(
    degrees: float,
) -> None:
    """By half the width over the tangent of the angle, before the middle of the front is there."""
    angle = math.radians(degrees)
    half = 4.0 * complex(math.cos(angle), math.sin(angle))
    zone = met(straight(), walk(2 - half, 2 + half), 5.0, 1.8)
    assert zone.centre_m == pytest.approx(2.0 - 0.9 / abs(math.tan(angle)), abs=1e-5)
    # The near edge of the crosswalk and the place where the rear has left are as they are.
    assert zone.centre_m - zone.crossing.width_m / 2 == pytest.approx(zone.first_m)
    assert zone.centre_m + zone.crossing.width_m / 2 + zone.body_m == pytest.approx(zone.last_m)


@pytest.mark.parametrize("left_hand", [False, True])
def test_y_is_0_at_the_kerb_on_the_side_on_which_traffic_keeps(left_hand: bool) -> None:
    axis = (2 + 6j, 2 - 3j)  # from left to right
    zone = met(straight(), walk(*axis, left_hand=left_hand), 5.0, 1.8)
    assert zone.reverse is not left_hand
    assert covered(zone)[0] == pytest.approx(5.1 if left_hand else 2.1, abs=1e-6)
    assert zone.y_of(zone.y_of(2.5)) == 2.5


def test_lanes_that_are_longer_than_they_are_drawn() -> None:
    """A lane's metres are 1.5 × those of its shape, and so are those of the zone."""
    road = straight(stretched=1.5)
    assert road.starts_m[0] == -90.0
    assert road.position(road.starts_m[2] + 15.0) == pytest.approx(18.0)
    zone = met(road, walk(2 - 3j, 2 + 6j), 5.0, 1.8)
    # The body is drawn 5 m long; the front goes 4 + 5 drawn metres.
    assert numbers(zone) == pytest.approx([0.0, 13.5, 2.1, 3.9], abs=1e-6)


@given(
    degrees=st.floats(30.0, 150.0), across=st.floats(2.0, 6.0), width=st.floats(0.6, 2.6),
    length=st.floats(1.5, 18.0),
)  # fmt: skip
@settings(max_examples=60)
def test_an_oblique_crosswalk(degrees: float, across: float, width: float, length: float) -> None:
    """The overlap of two strips, of the road's body and of the crosswalk."""
    sin, cos = math.sin(math.radians(degrees)), abs(math.cos(math.radians(degrees)))
    direction = complex(math.cos(math.radians(degrees)), sin)
    zone = met(straight(), walk(4 - 20 * direction, 4 + 20 * direction, across), length, width)
    before_m = (across + width * cos) / 2 / sin
    half_m = (width + across * cos) / 2 / sin
    expected = [4 - before_m, 4 + before_m + length, 20 - half_m, 20 + half_m]
    assert numbers(zone) == pytest.approx(expected, abs=1e-5)


@given(radius=st.floats(6.0, 40.0), length=st.floats(2.0, 8.0), share=st.floats(0.0, 1.0))
@settings(max_examples=50)
def test_a_quarter_circle(radius: float, length: float, share: float) -> None:
    """A body whose chord spans an arc of length L points back by the angle L / 2R."""
    road = turning(radius)
    s = length + share * (math.pi / 2 * radius - length)
    if s > math.pi / 2 * radius:
        return
    angle = s / radius
    place = radius * complex(math.sin(angle), 1 - math.cos(angle))
    assert road.position(s) == pytest.approx(place, abs=2e-3)
    assert np.angle(road.heading(s)) == pytest.approx(angle, abs=4e-3)
    front_right, front_left, rear_left, _ = road.outline(s, length, 1.8)
    ahead = front_left - rear_left
    assert math.atan2(ahead[1], ahead[0]) == pytest.approx(angle - length / radius / 2, abs=1e-3)
    assert math.dist(front_left, rear_left) == pytest.approx(length)
    assert math.dist(front_left, front_right) == pytest.approx(1.8)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_crosswalk_at_the_exit_of_a_turn(sign: int) -> None:
    """The lane leaves the turn along x = R, so it covers R ± 0.9 m of a crosswalk there."""
    radius_m, length_m = 10.0, 5.0
    y = sign * 30.0
    zone = met(turning(radius_m, sign), walk(4 + 1j * y, 20 + 1j * y), length_m, 1.8)
    along_m = math.pi / 2 * radius_m + 20.0  # s of the crosswalk's centre line
    centre_m = 20 - radius_m if sign == 1 else radius_m - 4
    expected = [along_m - 2, along_m + 2 + length_m, centre_m - 0.9, centre_m + 0.9]
    assert numbers(zone) == pytest.approx(expected, abs=1e-3)
    assert zone.reverse is (sign == 1)  # a vehicle to the north has the east on its right


@given(
    radius=st.floats(6.0, 30.0), share=st.floats(0.1, 0.6), slant=st.floats(-3.0, 3.0),
    width=st.floats(0.6, 2.6), length=st.floats(1.5, 12.0), sign=st.sampled_from([1, -1]),
)  # fmt: skip
@settings(max_examples=60)
def test_properties_of_a_turn(
    radius: float, share: float, slant: float, width: float, length: float, sign: int
) -> None:
    """A wider body's zone contains a narrower one's; a mirrored country keeps left."""
    at = share * radius
    start, end = complex(at, -12.0), complex(at + slant, 12.0)
    road = turning(radius, sign)
    zone, wider = (met(road, walk(start, end), length, each) for each in (width, width + 0.3))
    assert wider.first_m <= zone.first_m + 1e-9
    assert wider.last_m >= zone.last_m - 1e-9
    (from_m, to_m), (wider_from_m, wider_to_m) = covered(zone), covered(wider)
    assert wider_from_m <= from_m + 1e-3
    assert wider_to_m >= to_m - 1e-3
    assert -1e-9 <= from_m < to_m <= zone.crossing.length_m + 1e-9
    mirrored = walk(start.conjugate(), end.conjugate(), left_hand=True)
    other = met(turning(radius, -sign), mirrored, length, width)
    assert numbers(other) == pytest.approx(numbers(zone), abs=1e-6)
    assert other.crossing.lane_centre_m == pytest.approx(zone.crossing.lane_centre_m, abs=1e-6)


@given(radius=st.floats(1.5, 4.0), at_m=st.floats(0.5, 6.0), length=st.floats(2.0, 12.0))
@settings(max_examples=40)
def test_a_vehicle_that_turns_round_has_a_length(radius: float, at_m: float, length: float) -> None:
    """The straight frame begins and ends at the first and last touch, with a body in between."""
    half = arc(radius, 180.0)
    road = path([(-60.0, 0.0), (0.0, 0.0)], half, [half[-1], (-60.0, 2 * radius)])
    zone = zone_of(road, walk(complex(at_m, -3), complex(at_m, 3 + 2 * radius)), length, 1.8)
    if zone is None:
        return
    way_m = zone.last_m - zone.first_m
    assert zone.body_m >= min(length, way_m / 2) - 1e-6
    assert zone.first_m < zone.centre_m < zone.last_m
    if zone.crossing.width_m > 0.01:
        assert zone.centre_m - zone.crossing.width_m / 2 == pytest.approx(zone.first_m)
    assert zone.centre_m + zone.crossing.width_m / 2 + zone.body_m == pytest.approx(zone.last_m)


def test_a_crosswalk_that_is_touched_twice_or_hardly() -> None:
    there_and_back = path(
        [(-60.0, 0.0), (0.0, 0.0)], [(0, 0), (12, 0), (12, 6), (0, 6)], [(0.0, 6.0), (-60.0, 6.0)]
    )
    twice = met(there_and_back, walk(2 - 3j, 2 + 9j), 3.0, 1.8)
    assert twice.split
    from_m, to_m = covered(twice)
    assert from_m < 3.0 < 9.0 < to_m
    # The crosswalk's end lies 0.9 m beside the lane's centre: within the body, or not.
    assert zone_of(straight(), walk(2 + 0.91j, 2 + 9j), 5.0, 1.8) is None
    narrow = met(straight(), walk(2 + 0.89j, 2 + 9j), 5.0, 1.8)
    assert not narrow.split
    hardly = met(straight(), walk(2 + 0.89j, 2 + 9j, 0.3), 0.5, 1.8)
    assert hardly.split  # 0.8 m take less than a step of 0.1 s at 13.9 m/s
