"""Every crosswalk of a SUMO network, and the connections of lanes whose vehicles pass it."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import shapely

from harness.core.errors import InputError, reason_of
from harness.core.freezing import Frozen
from harness.site.path import FrontPath, Lane

if TYPE_CHECKING:
    from sumolib.net import Net
    from sumolib.net.edge import Edge
    from sumolib.net.lane import Lane as NetLane
    from sumolib.net.node import Node

Manoeuvre = Literal["straight", "left", "right", "turn"]

SIGNAL = "a traffic light controls it"
RAIL = "a railway leads over it"
NO_VEHICLES = "no vehicle's connection leads over it"
"""Why no strategy can be run at a crosswalk."""

_WAYS: Mapping[str, Manoeuvre]
_WAYS = {"s": "straight", "l": "left", "L": "left", "r": "right", "R": "right"}
"""By SUMO's letter of a connection's direction; what is left are turnarounds."""

_RAIL = {"rail", "rail_urban", "rail_electric", "rail_fast", "tram", "subway", "cable_car"}
_ON_FOOT = {"pedestrian", "wheelchair"}
"""SUMO's classes of trains, and of people."""

_NAMELESS = (AttributeError, LookupError, RecursionError, ValueError)
"""What sumolib raises if what it is asked for is not in the network, or no lane has such a name."""

_PATH_M = 40.0
"""Length of a path before the stop line, longer than a body."""
_NEAR_M = 6.0
"""A body touches only crosswalks that are this near to its front's line."""


@dataclass(frozen=True, slots=True, eq=False)
class Connection:
    """A connection of two lanes at a junction.

    Attributes:
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

    from_lane: str
    via: tuple[str, ...]
    to_lane: str
    manoeuvre: Manoeuvre
    gives_way: bool
    line: shapely.LineString
    limit_mps: float
    refused: str | None = None

    @property
    def id(self) -> str:
        """Ids of the first and the last lane, e.g. ``a_0>b_0``."""
        return f"{self.from_lane}>{self.to_lane}"


@dataclass(frozen=True, eq=False)
class Crosswalk(Frozen):
    """A crosswalk.

    Attributes:
        id: id of the crossing's edge, e.g. ``:J7_c0``.
        axis: its centre line, from the end to which ``along_m`` = 0 belongs.
        width_m: its extent along the road.
        left_hand: whether traffic keeps left.
        prioritized: whether vehicles have to give way to people.
        signalled: whether a traffic light controls the people on it.
        roads: ids of the edges that it crosses.
        areas: by the ids of the walking areas at its ends, whether it is at the axis's beginning.
        junction: the connections for vehicles at its junction.
    """

    id: str
    axis: shapely.LineString
    width_m: float
    left_hand: bool = False
    prioritized: bool = False
    signalled: bool = False
    roads: Sequence[str] = ()
    areas: Mapping[str, bool] = field(default_factory=dict)
    junction: Sequence[Connection] = ()

    @cached_property
    def length_m(self) -> float:
        """Length of the axis, from kerb to kerb."""
        return float(self.axis.length)

    @cached_property
    def line(self) -> FrontPath:
        """The axis; s is 0 at its beginning."""
        return FrontPath.along([Lane(self.id, (*self.axis.coords,), self.length_m, math.inf)], 0)

    @cached_property
    def area(self) -> shapely.Polygon:
        """The area in which people walk."""
        return self.axis.buffer(self.width_m / 2, cap_style="flat")

    @cached_property
    def connections(self) -> tuple[Connection, ...]:
        """The connections for vehicles on which a long body may touch it."""
        return tuple(each for each in self.junction if self.area.dwithin(each.line, _NEAR_M))

    @property
    def over(self) -> Sequence[Connection]:
        """The connections whose line leads over it."""
        return [each for each in self.junction if each.line.intersects(self.area)]

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


@dataclass(frozen=True, eq=False)
class Town(Frozen):
    """A network's crosswalks, connections and lanes.

    Attributes:
        crosswalks: by id, in the file's order.
        connections: those for vehicles, by their first and last lane, also where there is no
            crosswalk.
        lanes: all lanes, by id.
    """

    crosswalks: Mapping[str, Crosswalk]
    connections: Mapping[tuple[str, str], Connection]
    lanes: Mapping[str, Lane]

    @classmethod
    def read(cls, net: Path) -> "Town":
        """Read a network, packed by gzip or not.

        Raises:
            InputError: the file cannot be read, or is not a SUMO network.
        """
        # This import takes a third of a second, which a scenario without a town does not need.
        import sumolib.net

        try:
            # sumolib does not read on which side traffic keeps.
            with sumolib.openz(str(net), "rb") as file:
                left_hand = bool(re.search(rb'<net [^>]*lefthand="(true|1)"', file.read()))
            # With lxml, sumolib leaves out what the crossings cross.
            network = sumolib.net.readNet(
                net, withPedestrianConnections=True, withFoes=True, lxml=False, maxcache=0
            )
        except OSError as error:
            raise InputError(str(net), f"cannot be read ({reason_of(error)})") from None
        # What the parser raises for a file that is not whole depends on where it ends.
        except Exception as error:
            raise InputError(str(net), f"is not a complete SUMO network ({error})") from error
        try:
            passing = {node: (*_passing(network, node),) for node in network.getNodes()}
            crosswalks = [
                _crosswalk(edge, passing[edge.getToNode()], left_hand)
                for edge in network.getEdges()
                if edge.getFunction() == "crossing"
            ]
            lanes = [_lane(lane) for edge in network.getEdges() for lane in edge.getLanes()]
        # The parser does not check that what a file names exists.  The cause stays with the error,
        # so that a mistake of this module can be told from a damaged file.
        except (*_NAMELESS, shapely.errors.ShapelyError) as error:
            raise InputError(str(net), f"is not a complete SUMO network ({error})") from error
        ways = [each for at in passing.values() for each in at]
        return cls(
            {each.id: each for each in crosswalks},
            {(each.from_lane, each.to_lane): each for each in ways},
            {each.id: each for each in lanes},
        )

    @cached_property
    def path(self) -> Callable[[Connection], FrontPath]:
        """The path of a connection, which begins 40 m before the stop line, or a little earlier.

        It begins later, with the connection's first lane or upstream of it, where several lanes or
        none lead to the next one.  A path is made once.
        """
        return cache(self._path)

    def _path(self, connection: Connection) -> FrontPath:
        before = [self.lanes[connection.from_lane]]
        while sum(lane.length_m for lane in before) < _PATH_M:
            ways = [each for each in self.connections.values() if each.to_lane == before[0].id]
            if len(ways) != 1 or self.lanes[ways[0].from_lane] in before:
                break
            before = [*(self.lanes[name] for name in (ways[0].from_lane, *ways[0].via)), *before]
        beyond = [self.lanes[name] for name in (*connection.via, connection.to_lane)]
        return FrontPath.along([*before, *beyond], len(before))


def _lane(lane: "NetLane") -> Lane:
    length_m, limit_mps, width_m = lane.getLength(), lane.getSpeed(), lane.getWidth()
    return Lane(lane.getID(), tuple(lane.getShape()), length_m, limit_mps, width_m)


def _passing(net: "Net", node: "Node") -> Iterator[Connection]:
    """The connections for vehicles through a junction."""
    links = {
        link: _via(net, link.getViaLaneID())
        for link in node.getConnections()
        if link.getViaLaneID() and _on_road(link.getFromLane()) and _on_road(link.getToLane())
    }
    for link, via in links.items():
        before = link.getFromLane()
        yield Connection(
            from_lane=before.getID(),
            via=tuple(lane.getID() for lane in via),
            to_lane=link.getToLane().getID(),
            manoeuvre=_WAYS.get(link.getDirection(), "turn"),
            gives_way=node.hasFoes() and any(node.forbids(other, link) for other in links),
            line=shapely.LineString([point for lane in via for point in lane.getShape()]),
            limit_mps=before.getSpeed(),
            refused=SIGNAL if link.getTLSID() else RAIL if _classes(via[0]) <= _RAIL else None,
        )


def _crosswalk(edge: "Edge", junction: Sequence[Connection], left_hand: bool) -> Crosswalk:
    lane = edge.getLane(0)
    walked = lane.getIncomingConnections()
    ends = {each.getEdge().getID(): False for each in lane.getOutgoingLanes()}
    ends |= {link.getFrom().getID(): True for link in walked}
    return Crosswalk(
        id=edge.getID(),
        axis=shapely.LineString(lane.getShape()),
        width_m=lane.getWidth(),
        left_hand=left_hand,
        prioritized=any(link.getState() == "M" for link in walked),
        signalled=any(link.getTLSID() for link in walked),
        roads=tuple(road.getID() for road in edge.getCrossingEdges()),
        areas=ends,
        junction=junction,
    )


def _via(net: "Net", name: str) -> list["NetLane"]:
    """The lanes of a connection inside the junction, from one of them on."""
    if not name:
        return []
    lane = net.getLane(name)
    return [lane, *_via(net, lane.getOutgoing()[0].getViaLaneID())]


def _classes(lane: "NetLane") -> set[str]:
    """The classes of vehicles that may use a lane; sumolib treats "all" as a class of its own."""
    return set(lane.getPermissions()) - _ON_FOOT


def _on_road(lane: "NetLane") -> bool:
    """Whether vehicles may use a lane outside junctions."""
    return bool(_classes(lane)) and not lane.getEdge().isSpecial()
