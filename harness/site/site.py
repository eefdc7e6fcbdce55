"""The geometry of the crosswalk of a generated network, in plain numbers.

In the road frame x is along the ego's direction; it is 0 where the crosswalk's centre line meets
the centre of the ego's lane.  y is along the crosswalk, from the near kerb (0) to the far kerb.
The near kerb is on the ego's right in right-hand traffic, else on its left.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from harness.core.encounter import FloatArray, Side
from harness.core.errors import InputError
from harness.site.road_network import allows, read_network

if TYPE_CHECKING:
    from sumolib.net import Net
    from sumolib.net.lane import Lane

TOLERANCE_M = 2e-6
"""Tolerance of a built network's geometry, since netconvert rounds nodes to a micrometre."""

_CROSSING = ":crosswalk_c0"
_INSIDE_M = 1.0
"""Distance from the crosswalk's waiting area at which pedestrians are inserted on the footpath."""

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
class Departure:
    """The insertion of a vehicle in SUMO: route, lane, and position in m on the first edge."""

    edges: tuple[str, str]
    lane: int
    position_m: float


@dataclass(frozen=True, slots=True)
class Way:
    """One car lane over the crosswalk of a generated road.

    Attributes:
        centre_m: y of the lane's centre.
        width_m: width of the lane.
        edges: the edges before and beyond the crosswalk.
        lane: SUMO's index of the lane.
        start_m, end_m: x of the ends of the lane before the crosswalk, along the lane's own
            direction and by SUMO's lengths.
    """

    centre_m: float
    width_m: float
    edges: tuple[str, str]
    lane: int
    start_m: float
    end_m: float

    def departure(self, range_m: float) -> Departure:
        """The insertion of a vehicle whose front bumper is `range_m` before the centre line."""
        # The limits themselves are accepted in spite of the file's rounding.
        position_m = min(max(self.start_m, -range_m), self.end_m) - self.start_m
        return Departure(self.edges, self.lane, position_m)


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


@dataclass(frozen=True, slots=True)
class Place:
    """A generated network, and the number of the ego's lane, counted from the near kerb."""

    net: Path
    lane: int = 0


def read_site(place: Place) -> Site:
    """The site of a place.

    Raises:
        InputError: the file is not a network, or not one that was generated from a scenario.
    """
    net = read_network(place.net).net
    try:
        crossing = net.getEdge(_CROSSING).getLane(0)
        first, *_, last = _line(crossing)
        roads = [
            lane
            for name in ("approach", "oncoming_approach")
            if net.hasEdge(name)
            for lane in net.getEdge(name).getLanes()
            if allows(lane, "passenger")
        ]
        met = [_met(net, lane, (first, last)) for lane in roads]
        approach, meeting = roads[place.lane], met[place.lane].point
        areas = [crossing.getIncomingConnections()[0].getFromLane().getEdge().getID()]
        areas.append(crossing.getOutgoing()[0].getToLane().getEdge().getID())
        lengths_m = [net.getEdge(side).getLength() for side in ("near", "far")]
    except (LookupError, ValueError):
        problem = "is not a network of a scenario's [crossing]"
        raise InputError(str(place.net), problem, "one that `harness network` writes") from None
    begin, *_, end = _line(approach)
    direction = (end - begin) / abs(end - begin)
    # The near kerb is on the ego's right.
    if ((last - meeting) / direction).imag <= 0:
        first, last, areas = last, first, areas[::-1]
    across = (last - first) / abs(last - first)
    ways = tuple(
        Way(
            centre_m=((at.point - first) * across.conjugate()).real,
            width_m=lane.getWidth(),
            edges=(lane.getEdge().getID(), at.beyond),
            lane=lane.getIndex(),
            start_m=-at.before_m,
            end_m=lane.getLength() - at.before_m,
        )
        for lane, at in zip(roads, met, strict=True)
    )
    near_m, far_m = (min(_INSIDE_M, length_m / 2) for length_m in lengths_m)
    return Site(
        frame=RoadFrame(
            *(part for of in (first, direction, across) for part in (of.real, of.imag))
        ),
        ego=ways[place.lane],
        ways=ways,
        length_m=abs(last - first),
        width_m=crossing.getWidth(),
        footpaths=(
            Footpath("near", lengths_m[0], lengths_m[0] - near_m, areas[0]),
            Footpath("far", 0.0, far_m, areas[1]),
        ),
    )


class _Met(NamedTuple):
    """Where a lane meets the crosswalk's centre line, how far on, and the edge beyond."""

    point: complex
    before_m: float
    beyond: str


def _met(net: "Net", lane: "Lane", crosswalk: tuple[complex, complex]) -> _Met:
    """Follow a lane over the crosswalk.

    Raises:
        LookupError: it does not lead over it.
    """
    (link,) = lane.getOutgoing()[:1]
    lanes, inside = [lane], link.getViaLaneID()
    while inside:
        lanes.append(net.getLane(inside))
        inside = next((each.getViaLaneID() for each in lanes[-1].getOutgoing()), "")
    before_m = 0.0
    for part in [*lanes, link.getToLane()]:
        line = _line(part)
        drawn_m, done_m = sum(abs(b - a) for a, b in pairwise(line)), 0.0
        for a, b in pairwise(line):
            share = _crossed_at(a, b, *crosswalk)
            if share is not None:
                at_m = before_m + part.getLength() * (done_m + share * abs(b - a)) / drawn_m
                return _Met(a + share * (b - a), at_m, link.getToLane().getEdge().getID())
            done_m += abs(b - a)
        before_m += part.getLength()
    raise LookupError(lane.getID())


def _crossed_at(a: complex, b: complex, c: complex, d: complex) -> float | None:
    """The point where segment c–d crosses segment a–b, as a share of a–b; None if it does not."""
    u, v, w = b - a, d - c, c - a
    area = (u.conjugate() * v).imag
    if area == 0:
        return None
    share, other = (w.conjugate() * v).imag / area, (w.conjugate() * u).imag / area
    return share if 0 <= share <= 1 and 0 <= other <= 1 else None


def _line(lane: "Lane") -> list[complex]:
    """A lane's centre line, east + i north."""
    return [complex(*point) for point in lane.getShape()]
