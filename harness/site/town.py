"""Every crosswalk of a SUMO network, and the connections of lanes whose vehicles pass it."""

import gzip
import math
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path as FilePath
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, NamedTuple
from xml.sax import SAXException

import shapely

from harness.core.errors import InputError
from harness.site.path import Path, PathLane

if TYPE_CHECKING:
    from sumolib.net import Net
    from sumolib.net.connection import Connection as Link
    from sumolib.net.edge import Edge
    from sumolib.net.lane import Lane
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


@dataclass(frozen=True, slots=True)
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
    """

    id: str
    from_lane: str
    via: tuple[str, ...]
    to_lane: str
    manoeuvre: Manoeuvre
    gives_way: bool


@dataclass(frozen=True, slots=True, eq=False)
class Crosswalk:
    """A crosswalk.

    Attributes:
        id: id of the crossing's edge, e.g. ``:J7_c0``.
        junction: id of its junction.
        roads: ids of the edges that it crosses.
        axis: its centre line, from the end to which ``along_m`` = 0 belongs.
        length_m: length of the axis, from kerb to kerb.
        width_m: its extent along the road.
        area: the area in which people walk.
        prioritized: whether vehicles have to give way to people.
        left_hand: whether traffic keeps left.
        refused: why no strategy can drive over it, or None.
    """

    id: str
    junction: str
    roads: tuple[str, ...]
    axis: shapely.LineString
    length_m: float
    width_m: float
    area: shapely.Polygon
    prioritized: bool
    left_hand: bool
    refused: str | None
    # Start, direction, length and place of each straight piece of the axis, in plain numbers.
    _pieces: list[tuple[complex, complex, float, float]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Note the straight pieces of the axis."""
        pieces, at_m = list[tuple[complex, complex, float, float]](), 0.0
        for a, b in pairwise(complex(*point[:2]) for point in self.axis.coords):
            if a != b:
                pieces.append((a, (b - a) / abs(b - a), abs(b - a), at_m))
                at_m += abs(b - a)
        object.__setattr__(self, "_pieces", pieces)

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
    """

    crosswalks: Mapping[str, Crosswalk]
    _net: "Net" = field(repr=False)
    _passing: Mapping[str, tuple["_Passing", ...]] = field(repr=False)

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
            edges = [edge for edge in network.getEdges() if edge.getFunction() == "crossing"]
            nodes = {edge.getToNode() for edge in edges}
            passing = {node.getID(): tuple(_passing(network, node)) for node in nodes}
            found = {edge.getID(): _crosswalk(edge, passing, left_hand) for edge in edges}
        except OSError as error:
            raise InputError(str(net), f"cannot be read ({error.strerror or error})") from None
        except _DAMAGED as error:
            raise InputError(str(net), f"is not a complete SUMO network ({error})") from None
        return cls(MappingProxyType(found), network, passing)

    @property
    def roads(self) -> Sequence[Sequence[tuple[float, float]]]:
        """The shapes of all edges outside junctions."""
        return [edge.getShape() for edge in self._net.getEdges(withInternal=False)]

    def connections(self, crosswalk: str, near_m: float = _NEAR_M) -> tuple[Connection, ...]:
        """The connections for vehicles whose line leads over a crosswalk, or near to it.

        By default they are those on which a long body may touch it.
        """
        at = self.crosswalks[crosswalk]
        passing = self._passing[at.junction]
        return tuple(each.connection for each in passing if at.area.dwithin(each.line, near_m))

    def limits_mps(self, crosswalk: str) -> Sequence[float]:
        """The speed limits of the lanes before a crosswalk, the lowest first."""
        before = {each.from_lane for each in self.connections(crosswalk)}
        return sorted({self.lane(lane).limit_mps for lane in before})

    def path(self, connection: Connection, before_m: float) -> Path:
        """The path of a connection from ``before_m`` before the stop line, or a little earlier.

        It begins later, with the connection's first lane or upstream of it, where several lanes or
        none lead to the next one.
        """
        lanes = [self._net.getLane(connection.from_lane)]
        before_m -= lanes[0].getLength()
        while before_m > 0.0:
            links = list(filter(_for_vehicles, lanes[0].getIncomingConnections()))
            if len(links) != 1 or links[0].getFromLane() in lanes:
                break
            ahead = [links[0].getFromLane(), *_via(self._net, links[0])]
            before_m -= sum(lane.getLength() for lane in ahead)
            lanes = [*ahead, *lanes]
        names = [*(lane.getID() for lane in lanes), *connection.via, connection.to_lane]
        return Path.along([self.lane(name) for name in names], len(lanes))

    @cache  # noqa: B019 - as long as the town
    def ahead(self, lane: str) -> tuple[Connection, ...]:
        """The connections for vehicles from a lane, also where there is no crosswalk."""
        passing = _passing(self._net, self._net.getLane(lane).getEdge().getToNode())
        return tuple(each.connection for each in passing if each.connection.from_lane == lane)

    @cache  # noqa: B019
    def lane(self, name: str) -> PathLane:
        """A lane of the network."""
        lane = self._net.getLane(name)
        length_m, limit_mps, width_m = lane.getLength(), lane.getSpeed(), lane.getWidth()
        return PathLane(name, lane.getShape(), length_m, limit_mps, width_m)

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

    def areas(self, crosswalk: str) -> tuple[str, ...]:
        """Ids of the walking areas at the ends of a crosswalk."""
        start, end = self._ends(crosswalk)
        return tuple(sorted({lane.getEdge().getID() for lane in (*start, *end)}))

    def footpaths(self, crosswalk: str) -> tuple[Footpath, Footpath]:
        """Where people come from at the beginning of a crosswalk's axis, and at its end.

        An end without a sidewalk, a refuge, has the nearest one beyond other crossings.

        Raises:
            InputError: no sidewalk leads to an end.
        """
        start, end = (self._footpath(crosswalk, areas) for areas in self._ends(crosswalk))
        return start, end

    def _ends(self, crosswalk: str) -> tuple[list["Lane"], list["Lane"]]:
        """The walking areas at the beginning of a crosswalk's axis, and at its end."""
        lane = self._net.getEdge(crosswalk).getLane(0)
        start = [link.getFromLane() for link in lane.getIncomingConnections()]
        return start, [link.getToLane() for link in lane.getOutgoing()]

    def _footpath(self, crosswalk: str, areas: list["Lane"]) -> Footpath:
        ways: list[tuple[Lane, ...]] = [(area,) for area in areas]
        seen = {self._net.getEdge(crosswalk).getLane(0)}.union(*self._ends(crosswalk))
        for way in ways:
            beside = [
                *((link.getFromLane(), True) for link in way[0].getIncomingConnections()),
                *((link.getToLane(), False) for link in way[0].getOutgoing()),
            ]
            roads = [
                (lane.getLength(), lane.getEdge().getID(), at_end)
                for lane, at_end in beside
                if not lane.getEdge().isSpecial() and _allows_people(lane)
            ]
            if roads:
                length_m, edge, at_end = max(roads)
                inside_m = min(_INSIDE_M, length_m / 2)
                names = tuple(lane.getEdge().getID() for lane in way)
                return Footpath(edge, length_m - inside_m if at_end else inside_m, names)
            further = {lane for lane, _ in beside if lane.getEdge().isSpecial()} - seen
            seen |= further
            ways += [(lane, *way) for lane in sorted(further, key=lambda each: each.getID())]
        allowed = "a lane for pedestrians at each end (netconvert --sidewalks.guess adds them)"
        raise InputError(crosswalk, "no footpath leads to an end of it", allowed)


def _keeps_left(net: FilePath) -> bool:
    """Whether traffic keeps left, which sumolib does not read."""
    with net.open("rb") as file:
        packed = file.read(2) == b"\x1f\x8b"
    with gzip.open(net) if packed else net.open("rb") as file:
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


class _Passing(NamedTuple):
    """A connection with its line inside the junction, and what is special about it."""

    connection: Connection
    line: shapely.LineString
    signalled: bool
    rail: bool


def _passing(net: "Net", node: "Node") -> Iterator[_Passing]:
    """The connections for vehicles through a junction."""
    internal = list(filter(None, node.getInternal()))
    feet = {name for name in internal if net.getLane(name).getEdge().getFunction() == "crossing"}
    for edge in node.getIncoming():
        for link in (each for lane in edge.getLanes() for each in lane.getOutgoing()):
            via = _via(net, link)
            if not via or not _for_vehicles(link):
                continue
            names = tuple(lane.getID() for lane in via)
            start, end = link.getFromLane().getID(), link.getToLane().getID()
            # Of a connection with a place to wait inside, SUMO lists one of the lanes.
            index = next((i for i, name in enumerate(internal) if name in names), None)
            # The last bit is that of the first link.
            response: str = node._prohibits.get(index, "")[::-1]
            yields = any(
                bit == "1" and name not in feet
                for bit, name in zip(response, internal, strict=False)
            )
            how = _WAYS.get(link.getDirection(), "turn")
            yield _Passing(
                Connection(f"{start}>{end}", start, names, end, how, yields),
                shapely.LineString([point for lane in via for point in lane.getShape()]),
                bool(link.getTLSID()),
                _classes(via[0]) <= _RAIL,
            )


def _crosswalk(
    edge: "Edge", passing: Mapping[str, tuple[_Passing, ...]], left_hand: bool
) -> Crosswalk:
    lane, junction = edge.getLane(0), edge.getToNode().getID()
    axis = shapely.LineString(lane.getShape())
    area = axis.buffer(lane.getWidth() / 2, cap_style="flat")
    over = [each for each in passing[junction] if each.line.intersects(area)]
    walked = lane.getIncomingConnections()
    refused = None if over else NO_VEHICLES
    if any(each.rail for each in over):
        refused = RAIL
    if any(link.getTLSID() for link in walked) or any(each.signalled for each in over):
        refused = SIGNAL
    return Crosswalk(
        id=edge.getID(),
        junction=junction,
        roads=tuple(road.getID() for road in edge.getCrossingEdges()),
        axis=axis,
        length_m=axis.length,
        width_m=lane.getWidth(),
        area=area,
        prioritized=any(link.getState() == "M" for link in walked),
        left_hand=left_hand,
        refused=refused,
    )


def _via(net: "Net", link: "Link") -> list["Lane"]:
    """The lanes of a connection inside the junction."""
    lanes: list[Lane] = []
    name = link.getViaLaneID()
    while name:
        lanes.append(net.getLane(name))
        name = next((each.getViaLaneID() for each in lanes[-1].getOutgoing()), "")
    return lanes


def _classes(lane: "Lane") -> set[str]:
    """The classes of vehicles that may use a lane; sumolib treats "all" as a class of its own."""
    return set(lane.getPermissions()) - _ON_FOOT


def _allows_people(lane: "Lane") -> bool:
    return not {"all", "pedestrian"}.isdisjoint(lane.getPermissions())


def _for_vehicles(link: "Link") -> bool:
    """Whether a connection leads vehicles from one road to another."""
    ends = (link.getFromLane(), link.getToLane())
    return all(_classes(lane) and not lane.getEdge().isSpecial() for lane in ends)
