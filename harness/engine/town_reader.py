"""A SUMO network in; its crosswalks, connections and lanes out, read by SUMO's own library.

That library's import takes a third of a second, which a scenario without a town does not need.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import shapely
import sumolib
from sumolib.net import Net, readNet
from sumolib.net.edge import Edge
from sumolib.net.lane import Lane as NetLane
from sumolib.net.node import Node

from harness.core.errors import InputError, reason_of
from harness.site.path import Lane
from harness.site.town import RAIL, SIGNAL, Connection, Crosswalk, Manoeuvre, Town

_WAYS: Mapping[str, Manoeuvre]
_WAYS = {"s": "straight", "l": "left", "L": "left", "r": "right", "R": "right"}
"""By SUMO's letter of a connection's direction; what is left are turnarounds."""

_RAIL = {"rail", "rail_urban", "rail_electric", "rail_fast", "tram", "subway", "cable_car"}
_ON_FOOT = {"pedestrian", "wheelchair"}
"""SUMO's classes of trains, and of people."""


def read_town(net: Path) -> Town:
    """Read a network, packed by gzip or not.

    Raises:
        InputError: the file cannot be read, or is not a SUMO network.
    """
    try:
        # sumolib does not read on which side traffic keeps.
        with sumolib.openz(str(net), "rb") as file:
            left_hand = bool(re.search(rb'<net [^>]*lefthand="(true|1)"', file.read()))
        # With lxml, sumolib leaves out what the crossings cross.
        parsed = readNet(net, withPedestrianConnections=True, withFoes=True, lxml=False, maxcache=0)
        passing = {node: (*_passing(parsed, node),) for node in parsed.getNodes()}
        crosswalks = [
            _crosswalk(edge, passing[edge.getToNode()], left_hand)
            for edge in parsed.getEdges()
            if edge.getFunction() == "crossing"
        ]
        lanes = [_lane(lane) for edge in parsed.getEdges() for lane in edge.getLanes()]
    except OSError as error:
        raise InputError(str(net), f"cannot be read ({reason_of(error)})") from None
    # What is raised for a file that is not whole depends on where it ends, and sumolib does not
    # check that what a file names exists.  The cause stays with the error, so that a mistake of
    # this module can be told from a damaged file.
    except Exception as error:
        raise InputError(str(net), f"is not a complete SUMO network ({error})") from error
    return Town(
        {each.id: each for each in crosswalks},
        {(each.from_lane, each.to_lane): each for at in passing.values() for each in at},
        {each.id: each for each in lanes},
    )


def _lane(lane: NetLane) -> Lane:
    length_m, limit_mps, width_m = lane.getLength(), lane.getSpeed(), lane.getWidth()
    return Lane(lane.getID(), tuple(lane.getShape()), length_m, limit_mps, width_m)


def _passing(net: Net, node: Node) -> Iterator[Connection]:
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


def _crosswalk(edge: Edge, junction: Sequence[Connection], left_hand: bool) -> Crosswalk:
    """The crosswalk of a crossing's edge, over the connections of its junction."""
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


def _via(net: Net, name: str) -> list[NetLane]:
    """The lanes of a connection inside the junction, from one of them on."""
    if not name:
        return []
    lane = net.getLane(name)
    return [lane, *_via(net, lane.getOutgoing()[0].getViaLaneID())]


def _classes(lane: NetLane) -> set[str]:
    """The classes of vehicles that may use a lane; sumolib treats "all" as a class of its own."""
    return set(lane.getPermissions()) - _ON_FOOT


def _on_road(lane: NetLane) -> bool:
    """Whether vehicles may use a lane outside junctions."""
    return bool(_classes(lane)) and not lane.getEdge().isSpecial()
