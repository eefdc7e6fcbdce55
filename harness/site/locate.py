"""A crossing of any SUMO network in; the site that an engine simulates out."""

import cmath
import math
from collections.abc import Iterator
from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING

from harness.core.encounter import Side
from harness.core.errors import InputError, nearest_name
from harness.site.road_network import RoadNetwork, allows, line_of
from harness.site.site import Footpath, RoadFrame, Signal, Site, Stretch, Way
from harness.site.ways import Path, Straight, extended, passed_on, path_over, straight

if TYPE_CHECKING:
    from sumolib.net.connection import Connection
    from sumolib.net.edge import Edge
    from sumolib.net.lane import Lane

MAX_OBLIQUE_DEG = 20.0
"""Largest deviation of the angle between road and crosswalk from 90°."""

_BENT_M = 0.05
"""Largest deviation of a crosswalk's centre line from a straight line."""
_INSIDE_M = 1.0
"""Distance from the crosswalk's waiting area at which pedestrians are inserted on the footpath."""


def site_at(
    network: RoadNetwork,
    crossing: str,
    approach: str | None = None,
    *,
    lane: int = 0,
    all_ways: bool = True,
) -> Site:
    """The site at a crossing, for an ego on a given lane.

    Args:
        network: the network.
        crossing: id of the crossing's edge, e.g. ``:J12_c0``.
        approach: id of the ego's lane; None for the outermost car lane.
        lane: if ``approach`` is None, the number of car lanes between the ego's and the near kerb.
        all_ways: whether ``ways`` holds every lane; otherwise only the ego's, which is faster.

    Raises:
        InputError: the crossing or the lane does not exist, or the crossing cannot be simulated;
            the message has the value and the allowed values.
    """
    ids, problem = network.crossings, f"no crossing {crossing!r}"
    if crossing not in ids:
        allowed = f"one of its {len(ids)} crossings, as `harness crossings` lists them"
        raise InputError("crossing.edge", problem, allowed, nearest_name(crossing, ids))
    edge = ids[crossing]
    try:
        return _site(network, edge, _chosen(network, edge, approach, lane), all_ways=all_ways)
    except (LookupError, ValueError, ZeroDivisionError) as error:
        raise InputError(crossing, f"the network is damaged there ({error})") from None


def _approaches(network: RoadNetwork, crossing: "Edge") -> Iterator[tuple["Lane", Path]]:
    """The car lanes that lead over a crossing, each with its path.

    Lanes of edges under the crossing come first; within an edge the outermost lane comes first.
    """
    ends = ends_of(crossing)
    crossed = crossing.getCrossingEdges()
    edges = [edge for edge in crossing.getToNode().getIncoming() if not edge.isSpecial()]
    for edge in sorted(edges, key=lambda edge: edge not in crossed):
        for lane in edge.getLanes():
            path = path_over(network, lane, ends) if allows(lane, "passenger") else None
            # A path may touch the end of a crosswalk over another road; such a path is left out.
            if path is not None and any(part.getEdge() in crossed for part in path.lanes):
                yield lane, path


def _site(
    network: RoadNetwork, crossing: "Edge", chosen: tuple["Lane", Path], *, all_ways: bool
) -> Site:
    ends = ends_of(crossing)
    lane, path = chosen[0], extended(network, chosen[1])
    road = straight(path)
    direction = road.direction
    angle = abs(math.degrees(cmath.phase((ends[1] - ends[0]) / direction)))
    angle = min(angle, 180.0 - angle)
    if angle < 90.0 - MAX_OBLIQUE_DEG:
        problem = f"meets the road at {angle:.1f}°"
        raise InputError(crossing.getID(), problem, f"at least {90 - MAX_OBLIQUE_DEG:g}°")
    # The near kerb is on the ego's right in right-hand traffic, else on its left.
    to_left = ((ends[1] - path.meeting) / direction).imag > 0
    reverse = to_left == network.left_hand
    near, far = (ends[1], ends[0]) if reverse else ends
    across = (far - near) / abs(far - near)
    slant = math.sin(math.radians(angle))
    ego = _way(path, road, near, across, slant)
    lanes = [_directions(crossing, direction, sign) for sign in (1, -1)]
    return Site(
        frame=RoadFrame(*_pair(near), *_pair(direction), *_pair(across)),
        ego=ego,
        ways=(
            _ways(network, crossing, (near, across, slant), direction, lane) if all_ways else (ego,)
        ),
        lanes=lanes[0],
        oncoming_lanes=lanes[1],
        length_m=abs(far - near),
        width_m=crossing.getLane(0).getWidth() / slant,
        angle_deg=angle,
        crossing_edge=crossing.getID(),
        crossing_from=Side.FAR if reverse else Side.NEAR,
        footpaths=footpaths_of(crossing, reverse=reverse),
        pedestrian_priority=any(link.getState() in ("M", "G") for link in links_onto(crossing)),
        signal=_signal(crossing, lane),
        passed=passed_on(path, road, crossing),
    )


def _pair(point: complex) -> tuple[float, float]:
    return point.real, point.imag


def _chosen(
    network: RoadNetwork, crossing: "Edge", approach: str | None, number: int
) -> tuple["Lane", Path]:
    """The ego's lane and its path."""
    ids: list[str] = []
    roads: list[str] = []
    for lane, path in _approaches(network, crossing):
        roads.append(lane.getEdge().getID())
        if approach == lane.getID() or (approach is None and roads.count(roads[0]) > number):
            return lane, path
        ids.append(lane.getID())
        if approach is None and roads[-1] != roads[0]:
            break
    if not ids:
        crossed = " ".join(edge.getID() for edge in crossing.getCrossingEdges()[:4])
        problem = f"no car lane leads over it (it crosses {crossed})"
        raise InputError(crossing.getID(), problem, "at least 1 car lane")
    if approach is None:
        count = roads.count(roads[0])
        problem = f"{number}, but only {count} lanes of {roads[0]} lead over the crosswalk"
        raise InputError("ego.lane", problem, f"below {count}")
    lanes = {lane.getID() for edge in network.net.getEdges() for lane in edge.getLanes()}
    missing = approach not in lanes
    problem = "is not in the network" if missing else "does not lead over the crosswalk"
    raise InputError("crossing.approach", f"lane {approach!r} {problem}", ", ".join(ids))


def ends_of(crossing: "Edge") -> tuple[complex, complex]:
    """Both ends of a crossing's centre line."""
    line = line_of(crossing.getLane(0))
    span = line[-1] - line[0]
    bent = max(abs((span.conjugate() * (point - line[0])).imag) / abs(span) for point in line)
    if bent > _BENT_M:
        problem = f"its centre line bends by {bent:.2f} m"
        raise InputError(crossing.getID(), problem, f"at most {_BENT_M:g} m")
    return line[0], line[-1]


def _way(
    path: Path,
    road: Straight,
    near: complex,
    across: complex,
    slant: float,
    *,
    oncoming: bool = False,
    index: int = 0,
) -> Way:
    roads = [piece for piece in path.pieces() if not piece[0].getEdge().isSpecial()]
    approach = [lane for lane, start in roads if start < 0][-1]
    return Way(
        oncoming=oncoming,
        index=index,
        centre_m=((path.meeting - near) * across.conjugate()).real,
        width_m=approach.getWidth() / slant,
        speed_limit_mps=approach.getSpeed(),
        stretches=tuple(
            Stretch(lane.getEdge().getID(), lane.getIndex(), start, start + lane.getLength())
            for lane, start in roads
        ),
        straight_before_m=road.before_m,
        straight_after_m=road.after_m,
        ends_before=road.ends_before,
        ends_after=road.ends_after,
    )


def _ways(
    network: RoadNetwork,
    crossing: "Edge",
    walk: tuple[complex, complex, float],
    direction: complex,
    ego_lane: "Lane",
) -> tuple[Way, ...]:
    """The ways of lanes straight over the crosswalk, sorted by direction, then from the kerb."""
    crossed = {edge.getID() for edge in crossing.getCrossingEdges()}
    ways: list[tuple[bool, Way]] = []
    for lane, path in _approaches(network, crossing):
        ahead = (path.direction * direction.conjugate()).real
        whole = extended(network, path)
        way = _way(whole, straight(whole), *walk, oncoming=ahead < 0)
        if abs(ahead) > math.cos(math.radians(MAX_OBLIQUE_DEG)):
            ways.append((lane is ego_lane, way))
    # Several ways may use the same lane of the crossed road; the ego's comes first, then the
    # straightest.
    ways.sort(key=lambda way: (not way[0], -way[1].straight_before_m))
    lanes: dict[tuple[str, int], Way] = {}
    for _, way in ways:
        under = min(
            (stretch for stretch in way.stretches if stretch.edge in crossed),
            key=lambda stretch: min(abs(stretch.start_m), abs(stretch.end_m)),
        )
        lanes.setdefault((under.edge, under.lane), way)
    ordered = []
    for oncoming, sign in ((False, 1.0), (True, -1.0)):
        row = [(sign * way.centre_m, way) for way in lanes.values() if way.oncoming is oncoming]
        row.sort(key=itemgetter(0))
        ordered += [replace(way, index=index) for index, (_, way) in enumerate(row)]
    return tuple(ordered)


def _directions(crossing: "Edge", direction: complex, sign: int) -> int:
    """Number of car lanes under a crossing in the ego's direction (sign 1) or the other (-1)."""
    count = 0
    for edge in crossing.getCrossingEdges():
        for lane in edge.getLanes():
            line = line_of(lane)
            ends_there = edge.getToNode() is crossing.getToNode()
            heading = line[-1] - line[-2] if ends_there else line[1] - line[0]
            if allows(lane, "passenger") and sign * (heading * direction.conjugate()).real > 0:
                count += 1
    return count


def links_onto(crossing: "Edge") -> list["Connection"]:
    """The connections that lead pedestrians onto a crossing."""
    connections: list[Connection] = crossing.getLane(0).getIncomingConnections()
    return connections


def footpaths_of(
    crossing: "Edge", *, reverse: bool = False, over_refuge: bool = False
) -> tuple[Footpath, Footpath]:
    """The near and the far footpath.

    Args:
        crossing: the crossing's edge.
        reverse: whether it ends at the near kerb.
        over_refuge: whether an end without a footpath, a refuge, has the nearest one beyond other
            crossings.

    Raises:
        InputError: no footpath leads to an end.
    """
    start = [link.getFromLane() for link in links_onto(crossing)]
    end = [link.getToLane() for link in crossing.getLane(0).getOutgoing()]
    sides = []
    for side, areas in zip(Side, (end, start) if reverse else (start, end), strict=True):
        footpaths = _footpaths_at(areas)
        seen, lanes = {crossing.getLane(0), *start, *end}, areas
        while over_refuge and lanes and not footpaths:
            beside = [lane for each in lanes for lane, _ in _beside(each)]
            lanes = [lane for lane in beside if lane.getEdge().isSpecial() and lane not in seen]
            seen.update(lanes)
            footpaths = _footpaths_at(lanes)
        if not footpaths:
            problem = f"no footpath leads to its {side} end"
            allowed = "a lane for pedestrians at each end (netconvert --sidewalks.guess adds them)"
            raise InputError(crossing.getID(), problem, allowed)
        length, edge, at_end, area = max(footpaths)
        inside = min(_INSIDE_M, length / 2)
        end_m, inside_m = (length, length - inside) if at_end else (0.0, inside)
        sides.append(Footpath(edge, end_m, inside_m, area))
    return sides[0], sides[1]


def _beside(area: "Lane") -> list[tuple["Lane", bool]]:
    """The lanes that meet a walking area or a crossing, each with whether it ends there."""
    return [
        *((link.getFromLane(), True) for link in area.getIncomingConnections()),
        *((link.getToLane(), False) for link in area.getOutgoing()),
    ]


def _footpaths_at(areas: list["Lane"]) -> list[tuple[float, str, bool, str]]:
    """The footpaths at walking areas: length, edge, whether it ends there, and the area."""
    return [
        (leads.getLength(), leads.getEdge().getID(), at_end, area.getEdge().getID())
        for area in areas
        for leads, at_end in _beside(area)
        if not leads.getEdge().isSpecial() and allows(leads, "pedestrian")
    ]


def _signal(crossing: "Edge", approach: "Lane") -> Signal | None:
    """The traffic light of a crossing or of the ego's link over it; None without one."""
    links = [*links_onto(crossing), *approach.getOutgoing()]
    names = [link.getTLSID() for link in links if link.getTLSID()]
    if not names:
        return None
    walked = {
        link.getTLLinkIndex()
        for edge in crossing.getToNode().getIncoming()
        if edge.getFunction() == "crossing"
        for link in links_onto(edge)
        if link.getTLSID() == names[0]
    }
    return Signal(names[0], frozenset(walked))
