"""The geometry of a crosswalk in a network, in plain numbers.

In the road frame x is along the ego's direction; it is 0 where the crosswalk's centre line meets
the centre of the ego's lane.  y is along the crosswalk, from the near kerb (0) to the far kerb.
The near kerb is on the ego's right in right-hand traffic, else on its left.  If the crosswalk is
oblique, the axes are not at a right angle.
"""

import math
from dataclasses import dataclass
from typing import Literal, TypeVar

from harness.core.encounter import FloatArray, Side
from harness.core.errors import InputError

TOLERANCE_M = 2e-6
"""Tolerance of a built network's geometry, since netconvert rounds nodes to a micrometre."""

Point = tuple[float, float]
Numbers = TypeVar("Numbers", float, FloatArray)


@dataclass(frozen=True, slots=True)
class RoadFrame:
    """The road frame in the network's coordinates: the origin in m and two unit vectors."""

    origin_x_m: float
    origin_y_m: float
    along_x: float
    along_y: float
    across_x: float
    across_y: float

    def to_network(self, x_m: Numbers, y_m: Numbers) -> tuple[Numbers, Numbers]:
        """Network coordinates (m) of a point of the road frame (m)."""
        return (
            self.origin_x_m + x_m * self.along_x + y_m * self.across_x,
            self.origin_y_m + x_m * self.along_y + y_m * self.across_y,
        )

    def to_road(self, x_m: Numbers, y_m: Numbers) -> tuple[Numbers, Numbers]:
        """Road-frame coordinates (m) of points of the network (m); inverse of `to_network`."""
        dx, dy = x_m - self.origin_x_m, y_m - self.origin_y_m
        area = self.along_x * self.across_y - self.along_y * self.across_x
        return (
            (dx * self.across_y - dy * self.across_x) / area,
            (dy * self.along_x - dx * self.along_y) / area,
        )


@dataclass(frozen=True, slots=True)
class Stretch:
    """A lane of an edge on a way over the crosswalk.

    ``start_m`` and ``end_m`` are its positions on the way, by SUMO's lengths.  They are negative
    before the crosswalk's centre line and positive beyond it.
    """

    edge: str
    lane: int
    start_m: float
    end_m: float


@dataclass(frozen=True, slots=True)
class Departure:
    """The insertion of a vehicle in SUMO: route, lane, and position in m on the first edge."""

    edges: tuple[str, ...]
    lane: int
    position_m: float


@dataclass(frozen=True, slots=True)
class Way:
    """One car lane over the crosswalk, with the straight road before and after it.

    Attributes:
        oncoming: whether its vehicles drive against the ego's direction.
        index: number of the lane in its direction, counted from that direction's near kerb (0).
        centre_m: y of its centre on the crosswalk.
        width_m: its width along the crosswalk.
        speed_limit_mps: the network's speed limit on the lane that leads to the crosswalk.
        stretches: its lanes of edges, in the direction of travel.
        straight_before_m: length before the centre line that is straight within 1°.
        straight_after_m: length beyond the centre line that is straight within 1°.
        ends_before: why the straight part begins there.
        ends_after: why the straight part ends there.
    """

    oncoming: bool
    index: int
    centre_m: float
    width_m: float
    speed_limit_mps: float
    stretches: tuple[Stretch, ...]
    straight_before_m: float
    straight_after_m: float
    ends_before: str
    ends_after: str

    def departure(self, range_m: float) -> Departure:
        """The insertion of a vehicle whose front bumper is `range_m` before the centre line.

        Raises:
            InputError: the position is inside a junction, or the way from it is not straight.
        """
        where = "ego.trigger_range_m"
        # The tolerance accepts the limits themselves in spite of the file's rounding.
        if not range_m <= self.straight_before_m + TOLERANCE_M:
            problem = f"{range_m:g} m exceeds the straight approach, which {self.ends_before}"
            raise InputError(where, problem, f"at most {self.straight_before_m:.6g} m")
        for number, stretch in enumerate(self.stretches):
            first_m, last_m = stretch.start_m, stretch.end_m
            if first_m - TOLERANCE_M <= -range_m <= last_m + TOLERANCE_M and first_m < 0:
                edges = tuple(part.edge for part in self.stretches[number:])
                position_m = min(max(first_m, -range_m), last_m) - first_m
                return Departure(edges, stretch.lane, position_m)
        possible = ", ".join(
            f"{-stretch.end_m:.3g} to {min(-stretch.start_m, self.straight_before_m):.6g}"
            for stretch in reversed(self.stretches)
            if stretch.start_m < 0
        )
        raise InputError(where, f"{range_m:g} m is inside a junction", f"{possible} at this site")

    def longest_range_m(self, range_m: float) -> float:
        """The longest range ≤ `range_m` at which a vehicle can be inserted, in tenths of a metre.

        It is 0 if no lane is straight up to the crosswalk.
        """
        longest_m = 0.0
        for stretch in self.stretches:
            at_m = math.floor(10 * min(-stretch.start_m, range_m, self.straight_before_m)) / 10
            if at_m >= -stretch.end_m:
                longest_m = max(longest_m, at_m)
        return longest_m


@dataclass(frozen=True, slots=True)
class Footpath:
    """The footpath on one side of the road.

    ``edge`` meets the crosswalk's waiting area ``area`` at its position ``end_m``.  Pedestrians are
    inserted at ``inside_m``, about 1 m before ``end_m``.
    """

    edge: str
    end_m: float
    inside_m: float
    area: str


@dataclass(frozen=True, slots=True)
class Signal:
    """A traffic light at the crosswalk, with the indices of its pedestrian links."""

    id: str
    crossing_links: frozenset[int]


@dataclass(frozen=True, slots=True)
class Passed:
    """A traffic light or another crosswalk on the ego's way; strategies do not see it.

    ``x_m`` is its position on the way, negative before the crosswalk's centre line.
    """

    kind: Literal["traffic light", "crosswalk"]
    id: str
    x_m: float

    def __str__(self) -> str:
        """The kind, the id and the distance, in words."""
        where = "before" if self.x_m < 0 else "after"
        return f"{self.kind} {self.id} {abs(self.x_m):.0f} m {where} the crosswalk"


@dataclass(frozen=True, slots=True)
class Site:
    """The geometry of a crosswalk in a network.

    Attributes:
        frame: the road frame.
        ego: the ego's way.
        ways: the ways of all car lanes that are straight over the crosswalk, the ego's direction
            first.
        lanes: number of car lanes in the ego's direction, straight or not.
        oncoming_lanes: number of car lanes in the other direction.
        length_m: distance from kerb to kerb, along the crosswalk.
        width_m: the crosswalk's extent along the road.
        angle_deg: angle between road and crosswalk, 0 to 90.
        crossing_edge: SUMO's edge of the crosswalk.
        crossing_from: the side where that edge begins.
        footpaths: the near and the far footpath.
        pedestrian_priority: whether SUMO's own drivers yield there.
        signal: the traffic light that controls it, or None.
        passed: traffic lights and other crosswalks on the ego's way.
    """

    frame: RoadFrame
    ego: Way
    ways: tuple[Way, ...]
    lanes: int
    oncoming_lanes: int
    length_m: float
    width_m: float
    angle_deg: float
    crossing_edge: str
    crossing_from: Side
    footpaths: tuple[Footpath, Footpath]
    pedestrian_priority: bool
    signal: Signal | None
    passed: tuple[Passed, ...]

    @property
    def bearing_deg(self) -> float:
        """The ego's direction, clockwise from the network's north."""
        return math.degrees(math.atan2(self.frame.along_x, self.frame.along_y)) % 360.0

    def footpath(self, side: Side) -> Footpath:
        """The footpath of one side."""
        return self.footpaths[0 if side is Side.NEAR else 1]
