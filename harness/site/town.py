"""Every crosswalk of a SUMO network, and the connections of lanes whose vehicles pass it."""

import math
import xml.etree.ElementTree as ET
import zlib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import chain, pairwise
from pathlib import Path as FilePath
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, NamedTuple
from xml.sax import SAXException

import shapely

from harness.core.errors import InputError
from harness.site.path import Lane, Path

if TYPE_CHECKING:
    from sumolib.net import Net
    from sumolib.net.connection import Connection as Link
    from sumolib.net.edge import Edge
    from sumolib.net.lane import Lane as NetLane
    from sumolib.net.node import Node

Manoeuvre = Literal["straight", "left", "right", "turn"]

SIGNAL = "a traffic light controls it"
RAIL = "a railway leads over it"
NO_VEHICLES = "no vehicle's connection leads over it"

_WAYS: Mapping[str, Manoeuvre]
_WAYS = {"s": "straight", "l": "left", "L": "left", "r": "right", "R": "right"}
"""By SUMO's letter of a connection's direction; what is left are turnarounds."""

_RAIL = {"rail", "rail_urban", "rail_electric", "rail_fast", "tram", "subway", "cable_car"}
_ON_FOOT = {"pedestrian", "wheelchair"}

_PATH_M = 40.0
"""Length of a path before the stop line, longer than a body."""
_INSIDE_M = 2.0
"""Distance from a junction at which people come onto a sidewalk."""

_NEAR_M = 6.0
"""A body touches only crosswalks that are this near to its front's line."""

_MOST = 1e9
"""Upper limit of every length, width, speed and coordinate of a network."""

# sumolib does not check that attributes and references exist.
_DAMAGED = (
    *(ET.ParseError, SAXException, EOFError, zlib.error),
    *(AttributeError, LookupError, TypeError, ValueError),
)
"""What is raised for a file that is cut off, or is no network."""


@dataclass(frozen=True, slots=True, eq=False)
class Connection:
    """A connection of two lanes at a junction.

    Attributes:
        id: ids of the first and the last lane, e.g. ``a_0>b_0``.
        from_lane: the lane before the junction.
        via: the lanes inside the junction, in order of travel.
        to_lane: the lane beyond it.
        manoeuvre: the direction that SUMO gives it.
        gives_way: whether it has to yield to another connection for vehicles; crosswalks that it
            has to yield to do not count.
        line: the line of the front inside the junction.
        limit_mps: the speed limit before the junction.
        refused: why no strategy can drive on it, or None.
    """

    id: str
    from_lane: str
    via: tuple[str, ...]
    to_lane: str
    manoeuvre: Manoeuvre
    gives_way: bool
    line: shapely.LineString
    limit_mps: float
    refused: str | None = None


@dataclass(frozen=True, eq=False)
class Crosswalk:
    """A crosswalk.

    Attributes:
        id: id of the crossing's edge, e.g. ``:J7_c0``.
        axis: its centre line, from the end to which ``along_m`` = 0 belongs.
        width_m: its extent along the road.
        left_hand: whether traffic keeps left.
        prioritized: whether vehicles have to give way to people.
        signalled: whether a traffic light controls the people on it.
        roads: ids of the edges that it crosses.
        connections: those for vehicles on which a long body may touch it.
        ends: ids of the walking areas at the axis's beginning, and at its end.
    """

    id: str
    axis: shapely.LineString
    width_m: float
    left_hand: bool = False
    prioritized: bool = False
    signalled: bool = False
    roads: tuple[str, ...] = ()
    connections: tuple[Connection, ...] = ()
    ends: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())

    @cached_property
    def length_m(self) -> float:
        """Length of the axis, from kerb to kerb."""
        return float(self.axis.length)

    @cached_property
    def area(self) -> shapely.Polygon:
        """The area in which people walk."""
        return self.axis.buffer(self.width_m / 2, cap_style="flat")

    @property
    def over(self) -> Sequence[Connection]:
        """The connections whose line leads over it."""
        return [each for each in self.connections if each.line.intersects(self.area)]

    @property
    def refused(self) -> str | None:
        """Why no strategy can drive over it, or None."""
        reasons = {each.refused for each in self.over} or {NO_VEHICLES}
        if self.signalled:
            reasons.add(SIGNAL)
        return next((each for each in (SIGNAL, RAIL, NO_VEHICLES) if each in reasons), None)

    @property
    def limits_mps(self) -> Sequence[float]:
        """The speed limits of the lanes before it, the lowest first."""
        return sorted({each.limit_mps for each in self.connections})

    @cached_property
    def _pieces(self) -> Sequence[tuple[complex, complex, float, float]]:
        """Start, direction, length and place of each straight piece of the axis."""
        pieces, at_m = list[tuple[complex, complex, float, float]](), 0.0
        for a, b in pairwise(complex(*point[:2]) for point in self.axis.coords):
            if a != b:
                pieces.append((a, (b - a) / abs(b - a), abs(b - a), at_m))
                at_m += abs(b - a)
        return pieces

    def foot(self, x: float, y: float) -> tuple[float, float]:
        """The place of a point, and how far it is to the left of the axis.

        A place is a distance along the axis: here of the point's foot on the nearest piece, which
        may be beyond the axis's ends.
        """
        at, last = complex(x, y), len(self._pieces) - 1
        best_m, place = math.inf, (0.0, 0.0)
        for number, (start, ahead, length_m, from_m) in enumerate(self._pieces):
            off = (at - start) * ahead.conjugate()
            low = off.real if number == 0 else max(off.real, 0.0)
            inside_m = low if number == last else min(low, length_m)
            away_m = math.hypot(off.real - inside_m, off.imag)
            if away_m < best_m:
                best_m, place = away_m, (from_m + inside_m, off.imag)
        return place

    def point(self, along_m: float, left_m: float = 0.0) -> tuple[float, float]:
        """x and y of a place on the axis, or to its left."""
        pieces = (piece for piece in self._pieces if along_m <= piece[2] + piece[3])
        start, ahead, _, from_m = next(pieces, self._pieces[-1])
        at = start + (along_m - from_m + left_m * 1j) * ahead
        return at.real, at.imag


class Footpath(NamedTuple):
    """Where people come from or go to at an end of a crosswalk.

    ``edge`` is a sidewalk, ``inside_m`` a position on it near its end, and ``areas`` the walking
    areas and crossings from there to the crosswalk.
    """

    edge: str
    inside_m: float
    areas: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Town:
    """A network's crosswalks and connections.

    Attributes:
        crosswalks: by id, in the file's order.
        ahead: the connections for vehicles from each lane, also where there is no crosswalk.
    """

    crosswalks: Mapping[str, Crosswalk]
    ahead: Mapping[str, Sequence[Connection]]
    _net: "Net" = field(repr=False)

    @classmethod
    def read(cls, net: FilePath) -> "Town":
        """Read a network, packed by gzip or not.

        Raises:
            InputError: the file cannot be read, or is not a SUMO network.
        """
        # This import takes a third of a second, which a scenario without a town does not need.
        import sumolib.net

        try:
            left_hand = _keeps_left(net)
            # With lxml, sumolib leaves out what the crossings cross.
            network = sumolib.net.readNet(
                net, withPedestrianConnections=True, withFoes=True, lxml=False, maxcache=0
            )
            _check(network)
            passing = {node: [*_passing(network, node)] for node in network.getNodes()}
            edges = [edge for edge in network.getEdges() if edge.getFunction() == "crossing"]
            found = {
                edge.getID(): _crosswalk(edge, passing[edge.getToNode()], left_hand)
                for edge in edges
            }
        except OSError as error:
            raise InputError(str(net), f"cannot be read ({error.strerror or error})") from None
        except _DAMAGED as error:
            raise InputError(str(net), f"is not a complete SUMO network ({error})") from None
        ahead = defaultdict[str, list[Connection]](list)
        for each in chain.from_iterable(passing.values()):
            ahead[each.from_lane].append(each)
        return cls(MappingProxyType(found), ahead, network)

    @property
    def roads(self) -> Sequence[Sequence[tuple[float, float]]]:
        """The shapes of all edges outside junctions."""
        return [edge.getShape() for edge in self._net.getEdges(withInternal=False)]

    @cache  # noqa: B019 - as long as the town
    def path(self, connection: Connection) -> Path:
        """The path of a connection, which begins 40 m before the stop line, or a little earlier.

        It begins later, with the connection's first lane or upstream of it, where several lanes or
        none lead to the next one.
        """
        lanes = [self._net.getLane(connection.from_lane)]
        before_m = _PATH_M - lanes[0].getLength()
        while before_m > 0.0:
            links = list(filter(_for_vehicles, lanes[0].getIncomingConnections()))
            if len(links) != 1 or links[0].getFromLane() in lanes:
                break
            ahead = [links[0].getFromLane(), *_via(self._net, links[0])]
            before_m -= sum(lane.getLength() for lane in ahead)
            lanes = [*ahead, *lanes]
        names = [*(lane.getID() for lane in lanes), *connection.via, connection.to_lane]
        return Path.along([self.lane(name) for name in names], len(lanes))

    @cache  # noqa: B019
    def lane(self, name: str) -> Lane:
        """A lane of the network."""
        lane = self._net.getLane(name)
        length_m, limit_mps, width_m = lane.getLength(), lane.getSpeed(), lane.getWidth()
        return Lane(name, lane.getShape(), length_m, limit_mps, width_m)

    def upstream(self, edges: Iterable[str], reach_m: float) -> Sequence[str]:
        """The edges from which a vehicle comes to the end of one of these within a distance."""
        away_m = dict.fromkeys(edges, 0.0)
        todo = [*away_m]
        while todo:
            edge = todo.pop()
            lanes = filter(_classes, self._net.getEdge(edge).getLanes())
            through_m = away_m[edge] + min((lane.getLength() for lane in lanes), default=0.0)
            before = self._net.getEdge(edge).getIncoming() if through_m <= reach_m else ()
            for name in (each.getID() for each in before):
                if through_m < away_m.get(name, math.inf):
                    away_m[name] = through_m
                    todo.append(name)
        return sorted(away_m)

    def footpath(self, crosswalk: Crosswalk, end: int) -> Footpath:
        """Where people come from at the beginning (0) or the end (1) of a crosswalk's axis.

        An end without a sidewalk, a refuge, has the nearest one beyond other crossings.

        Raises:
            InputError: no sidewalk leads to the end.
        """
        ways: list[tuple[str, ...]] = [(area,) for area in crosswalk.ends[end]]
        seen = {crosswalk.id}.union(*crosswalk.ends)
        for way in ways:
            area = self._net.getEdge(way[0]).getLane(0)
            beside = [link.getFromLane() for link in area.getIncomingConnections()]
            beside += [link.getToLane() for link in area.getOutgoing()]
            further = {lane.getEdge() for lane in beside if lane.getEdge().isSpecial()}
            roads = [
                (lane.getLength(), lane.getEdge().getID())
                for lane in beside
                if lane.getEdge() not in further
                and (lane.allows("pedestrian") or lane.allows("all"))
            ]
            if roads:
                length_m, name = max(roads)
                inside_m = min(_INSIDE_M, length_m / 2)
                comes = self._net.getEdge(name).getToNode() is area.getEdge().getToNode()
                return Footpath(name, length_m - inside_m if comes else inside_m, way)
            new = sorted({edge.getID() for edge in further} - seen)
            seen.update(new)
            ways += [(each, *way) for each in new]
        allowed = "a lane for pedestrians at each end (netconvert --sidewalks.guess adds them)"
        raise InputError(crosswalk.id, "no footpath leads to an end of it", allowed)


def _keeps_left(net: FilePath) -> bool:
    """Whether traffic keeps left, which sumolib does not read."""
    import sumolib

    with sumolib.openz(str(net), "rb") as file:
        root = next(ET.iterparse(file, ("start",)))[1]
    if root.tag != "net":
        raise ValueError(f"its first element is <{root.tag[:40]}>, not <net>")
    return root.get("lefthand") in ("true", "1")


def _check(net: "Net") -> None:
    """Refuse edges without two junctions, and lanes whose shape or size is not valid."""
    for edge in net.getEdges():
        if edge.getFromNode() is None or edge.getToNode() is None:
            raise ValueError(f"edge {edge.getID()} does not join two junctions")
        for lane in edge.getLanes():
            line = lane.getShape()
            numbers = [lane.getLength(), lane.getWidth(), lane.getSpeed()]
            numbers += [coordinate for point in line for coordinate in point]
            if len(line) < 2 or not max(map(abs, numbers)) < _MOST or any(map(math.isnan, numbers)):
                raise ValueError(f"lane {lane.getID()} has an invalid shape or size")


def _passing(net: "Net", node: "Node") -> Iterator[Connection]:
    """The connections for vehicles through a junction."""
    internal = list(filter(None, node.getInternal()))
    feet = {name for name in internal if net.getLane(name).getEdge().getFunction() == "crossing"}
    for link in node.getConnections():
        via = _via(net, link)
        if not via or not _for_vehicles(link):
            continue
        names = tuple(lane.getID() for lane in via)
        before, end = link.getFromLane(), link.getToLane().getID()
        # Of a connection with a place to wait inside, SUMO lists one of the lanes.
        index = next((i for i, name in enumerate(internal) if name in names), None)
        # The last bit is that of the first link.
        response: str = node._prohibits.get(index, "")[::-1]
        refused = SIGNAL if link.getTLSID() else RAIL if _classes(via[0]) <= _RAIL else None
        yield Connection(
            id=f"{before.getID()}>{end}",
            from_lane=before.getID(),
            via=names,
            to_lane=end,
            manoeuvre=_WAYS.get(link.getDirection(), "turn"),
            gives_way=any(
                bit == "1" and name not in feet
                for bit, name in zip(response, internal, strict=False)
            ),
            line=shapely.LineString([point for lane in via for point in lane.getShape()]),
            limit_mps=before.getSpeed(),
            refused=refused,
        )


def _crosswalk(edge: "Edge", passing: Sequence[Connection], left_hand: bool) -> Crosswalk:
    lane = edge.getLane(0)
    walked, beyond = lane.getIncomingConnections(), lane.getOutgoing()
    start = tuple(link.getFromLane().getEdge().getID() for link in walked)
    found = Crosswalk(
        id=edge.getID(),
        axis=shapely.LineString(lane.getShape()),
        width_m=lane.getWidth(),
        left_hand=left_hand,
        prioritized=any(link.getState() == "M" for link in walked),
        signalled=any(link.getTLSID() for link in walked),
        roads=tuple(road.getID() for road in edge.getCrossingEdges()),
        ends=(start, tuple(link.getToLane().getEdge().getID() for link in beyond)),
    )
    near = (each for each in passing if found.area.dwithin(each.line, _NEAR_M))
    return replace(found, connections=tuple(near))


def _via(net: "Net", link: "Link") -> list["NetLane"]:
    """The lanes of a connection inside the junction."""
    lanes: list[NetLane] = []
    name = link.getViaLaneID()
    while name:
        lanes.append(net.getLane(name))
        name = next((each.getViaLaneID() for each in lanes[-1].getOutgoing()), "")
    return lanes


def _classes(lane: "NetLane") -> set[str]:
    """The classes of vehicles that may use a lane; sumolib treats "all" as a class of its own."""
    return set(lane.getPermissions()) - _ON_FOOT


def _for_vehicles(link: "Link") -> bool:
    """Whether a connection leads vehicles from one road to another."""
    ends = (link.getFromLane(), link.getToLane())
    return all(_classes(lane) and not lane.getEdge().isSpecial() for lane in ends)
