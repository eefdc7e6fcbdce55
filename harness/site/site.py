"""The geometry of a crosswalk in a network, in plain numbers.

In the road frame x is along the ego's direction; it is 0 where the crosswalk's centre line meets
the centre of the ego's lane.  y is along the crosswalk, from the near kerb (0) to the far kerb.
The near kerb is on the ego's right in right-hand traffic, else on its left.
"""

import math
from dataclasses import dataclass
from typing import TypeVar

from harness.core.encounter import FloatArray, Side

TOLERANCE_M = 2e-6
"""Tolerance of a built network's geometry, since netconvert rounds nodes to a micrometre."""

REACH_BEFORE_M = 300.0
REACH_AFTER_M = 120.0
"""Length of a path on each side of the crosswalk: the longest trigger range."""

_ROUNDING = 1e-6

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
    """One car lane over the crosswalk of a generated road.

    Attributes:
        oncoming: whether its vehicles drive against the ego's direction.
        index: number of the lane in its direction, counted from that direction's near kerb (0).
        centre_m: y of the lane's centre.
        width_m: width of the lane.
        stretches: the lanes of edges before and beyond the crosswalk.
    """

    oncoming: bool
    index: int
    centre_m: float
    width_m: float
    stretches: tuple[Stretch, Stretch]

    def departure(self, range_m: float) -> Departure:
        """The insertion of a vehicle whose front bumper is `range_m` before the centre line."""
        approach, beyond = self.stretches
        # The limits themselves are accepted in spite of the file's rounding.
        position_m = min(max(approach.start_m, -range_m), approach.end_m) - approach.start_m
        return Departure((approach.edge, beyond.edge), approach.lane, position_m)

    @property
    def ends_x_m(self) -> float:
        """The x, along the lane's own direction, at which a stream of vehicles leaves the road."""
        return min(self.stretches[1].end_m, REACH_AFTER_M)

    def entry_x_m(self, range_m: float, per_step_m: float) -> float:
        """The x at which a stream of vehicles enters: the farthest, whole steps before the range.

        Args:
            range_m: distance before the crosswalk at which a passage begins.
            per_step_m: distance of one step at v0.
        """
        begins_x_m = max(self.stretches[0].start_m, -REACH_BEFORE_M - TOLERANCE_M)
        steps = math.floor((-begins_x_m - range_m) / per_step_m + _ROUNDING)
        return -range_m - steps * per_step_m


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
class Site:
    """The geometry of the crosswalk of a generated road.

    Attributes:
        frame: the road frame.
        ego: the ego's way.
        ways: the ways of all car lanes, the ego's direction first.
        length_m: distance from kerb to kerb, along the crosswalk.
        width_m: the crosswalk's extent along the road.
        footpaths: the near and the far footpath.
    """

    frame: RoadFrame
    ego: Way
    ways: tuple[Way, ...]
    length_m: float
    width_m: float
    footpaths: tuple[Footpath, Footpath]

    @property
    def bearing_deg(self) -> float:
        """The ego's direction, clockwise from the network's north."""
        return math.degrees(math.atan2(self.frame.along_x, self.frame.along_y)) % 360.0

    def footpath(self, side: Side) -> Footpath:
        """The footpath of one side."""
        return self.footpaths[0 if side is Side.NEAR else 1]
