"""From a crossing of any SUMO network to the site that an engine simulates."""

import cmath
import math
from collections.abc import Iterator
from dataclasses import replace
from operator import itemgetter

from harness.encounter import Side
from harness.errors import InputError, nearest_name
from harness.roads.passed import passed_on
from harness.roads.road_network import Edge, Lane, Link, RoadNetwork, junction_of
from harness.roads.site import Footpath, RoadFrame, Signal, Site, Stretch, Way
from harness.roads.ways import Path, Straight, extended, path_over, straight

MAX_OBLIQUE_DEG = 20.0
"""How far road and crosswalk may be from a right angle."""

_BENT_M = 0.05
"""How far a crosswalk's own line may bend."""
_INSIDE_M = 1.0
"""How far from the crosswalk's waiting area somebody is inserted, on the footpath."""


def site_at(
    network: RoadNetwork,
    crossing: str,
    approach: str | None = None,
    *,
    lane: int = 0,
    all_ways: bool = True,
) -> Site:
    """The site at a crossing, for an ego that comes by one lane.

    Args:
        network: as read.
        crossing: id of the crossing's edge, e.g. ``:J12_c0``.
        approach: id of the ego's lane; None for the outermost car lane that leads to it.
        lane: where ``approach`` is None, how many car lanes of that road lie between the ego's and
            the near kerb.
        all_ways: whether ``ways`` holds every lane, or the ego's alone (a quick look at many).

    Raises:
        InputError: there is no such crossing or lane, or the crossing cannot be simulated; the
            message holds the figure and what would do.
    """
    edge = network.edges.get(crossing)
    if edge is None or edge.function != "crossing" or not edge.lanes:
        ids = [each.id for each in network.crossings()]
        allowed = f"one of its {len(ids)} crossings, as `harness crossings` lists them"
        raise InputError(
            "crossing.edge", f"no crossing {crossing!r}", allowed, nearest_name(crossing, ids)
        )
    try:
        return _site(network, edge, _chosen(network, edge, approach, lane), all_ways=all_ways)
    except (LookupError, ValueError, ZeroDivisionError) as error:
        raise InputError(crossing, f"the network is damaged there ({error})") from None


def _approaches(network: RoadNetwork, crossing: Edge) -> Iterator[tuple[Lane, Path]]:
    """The car lanes that lead over a crossing, and the way of each.

    First come those of a road that it crosses before the junction; of a road the outermost lane
    comes first.
    """
    ends = _ends(crossing)
    edges = network.into.get(junction_of(crossing.id), [])
    for edge in sorted(edges, key=lambda edge: edge.id not in crossing.crossed):
        for lane in edge.lanes:
            path = path_over(network, lane, ends) if lane.allows("passenger") else None
            # A lane that merely touches a crosswalk's end is on a road that it does not lead over.
            if path is not None and any(each.edge in crossing.crossed for each in path.lanes):
                yield lane, path


def _site(
    network: RoadNetwork, crossing: Edge, chosen: tuple[Lane, Path], *, all_ways: bool
) -> Site:
    ends = _ends(crossing)
    lane, path = chosen[0], extended(network, chosen[1])
    road = straight(path)
    direction = road.direction
    angle = abs(math.degrees(cmath.phase((ends[1] - ends[0]) / direction)))
    angle = min(angle, 180.0 - angle)
    if angle < 90.0 - MAX_OBLIQUE_DEG:
        problem = f"meets the road at {angle:.1f}°"
        raise InputError(crossing.id, problem, f"at least {90 - MAX_OBLIQUE_DEG:g}°")
    # The kerb that traffic keeps to is on the ego's right, or on its left.
    to_left = ((ends[1] - path.meeting) / direction).imag > 0
    reverse = to_left == network.left_hand
    near, far = (ends[1], ends[0]) if reverse else ends
    across = (far - near) / abs(far - near)
    slant = math.sin(math.radians(angle))
    ego = _way(path, road, near, across, slant)
    lanes = [_directions(network, crossing, direction, sign) for sign in (1, -1)]
    return Site(
        frame=RoadFrame(*_pair(near), *_pair(direction), *_pair(across)),
        ego=ego,
        ways=(
            _ways(network, crossing, (near, across, slant), direction, lane) if all_ways else (ego,)
        ),
        lanes=lanes[0],
        oncoming_lanes=lanes[1],
        length_m=abs(far - near),
        width_m=crossing.lanes[0].width_m / slant,
        angle_deg=angle,
        crossing_edge=crossing.id,
        crossing_from=Side.FAR if reverse else Side.NEAR,
        footpaths=_footpaths(network, crossing, reverse=reverse),
        pedestrian_priority=any(link.state in ("M", "G") for link in _onto(network, crossing)),
        signal=_signal(network, crossing, lane),
        passed=passed_on(network, path, road, crossing),
    )


def _pair(point: complex) -> tuple[float, float]:
    return point.real, point.imag


def _chosen(
    network: RoadNetwork, crossing: Edge, approach: str | None, number: int
) -> tuple[Lane, Path]:
    """The ego's lane and its way."""
    ids: list[str] = []
    roads: list[str] = []
    for lane, path in _approaches(network, crossing):
        roads.append(lane.edge)
        if approach == lane.id or (approach is None and roads.count(roads[0]) > number):
            return lane, path
        ids.append(lane.id)
        if approach is None and lane.edge != roads[0]:
            break
    if not ids:
        problem = f"0 lanes lead cars over it (it crosses {' '.join(crossing.crossed[:4])})"
        raise InputError(crossing.id, problem, "1 lane for cars at least")
    if approach is None:
        count = roads.count(roads[0])
        problem = f"{number}, where {count} lanes of {roads[0]} lead there"
        raise InputError("ego.lane", problem, f"below {count}")
    problem = "does not lead there" if approach in network.lanes else "is not in the network"
    raise InputError("crossing.approach", f"lane {approach!r} {problem}", ", ".join(ids))


def _ends(crossing: Edge) -> tuple[complex, complex]:
    """Both ends of a crossing's centre line."""
    line = crossing.lanes[0].line.points
    span = line[-1] - line[0]
    bent = max(abs((span.conjugate() * (point - line[0])).imag) / abs(span) for point in line)
    if bent > _BENT_M:
        raise InputError(crossing.id, f"its line bends by {bent:.2f} m", f"at most {_BENT_M:g} m")
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
    roads = [(lane, start) for lane, start in path.pieces() if not lane.id.startswith(":")]
    approach = [lane for lane, start in roads if start < 0][-1]
    return Way(
        oncoming=oncoming,
        index=index,
        centre_m=((path.meeting - near) * across.conjugate()).real,
        width_m=approach.width_m / slant,
        speed_limit_mps=approach.speed_mps,
        stretches=tuple(
            Stretch(lane.edge, int(lane.number), start, start + lane.length_m)
            for lane, start in roads
        ),
        straight_before_m=road.before_m,
        straight_after_m=road.after_m,
        ends_before=road.ends_before,
        ends_after=road.ends_after,
    )


def _ways(
    network: RoadNetwork,
    crossing: Edge,
    walk: tuple[complex, complex, float],
    direction: complex,
    own: Lane,
) -> tuple[Way, ...]:
    """Every lane's way that is straight over the crosswalk, by direction and from the kerb."""
    ways: list[tuple[bool, Way]] = []
    for lane, path in _approaches(network, crossing):
        ahead = (path.direction * direction.conjugate()).real
        whole = extended(network, path)
        way = _way(whole, straight(whole), *walk, oncoming=ahead < 0)
        if abs(ahead) > math.cos(math.radians(MAX_OBLIQUE_DEG)):
            ways.append((lane == own, way))
    # Of several ways over one lane of the crossed road the ego's or the straightest is the lane's.
    ways.sort(key=lambda way: (not way[0], -way[1].straight_before_m))
    lanes: dict[tuple[str, int], Way] = {}
    for _, way in ways:
        under = min(
            (each for each in way.stretches if each.edge in crossing.crossed),
            key=lambda each: min(abs(each.start_m), abs(each.end_m)),
        )
        lanes.setdefault((under.edge, under.lane), way)
    ordered = []
    for oncoming, sign in ((False, 1.0), (True, -1.0)):
        row = [(sign * way.centre_m, way) for way in lanes.values() if way.oncoming is oncoming]
        row.sort(key=itemgetter(0))
        ordered += [replace(way, index=index) for index, (_, way) in enumerate(row)]
    return tuple(ordered)


def _directions(network: RoadNetwork, crossing: Edge, direction: complex, sign: int) -> int:
    """How many car lanes under a crossing lead the ego's way (1), or the other (-1)."""
    junction = junction_of(crossing.id)
    count = 0
    for edge in (network.edges[each] for each in crossing.crossed):
        for lane in edge.lanes:
            line = lane.line.points
            heading = line[-1] - line[-2] if edge.end == junction else line[1] - line[0]
            if lane.allows("passenger") and sign * (heading * direction.conjugate()).real > 0:
                count += 1
    return count


def _onto(network: RoadNetwork, crossing: Edge) -> list[Link]:
    """The connections that lead pedestrians onto a crossing."""
    return network.backward.get(crossing.lanes[0].id, [])


def _footpaths(network: RoadNetwork, crossing: Edge, *, reverse: bool) -> tuple[Footpath, Footpath]:
    """The near and the far footpath."""
    lane = crossing.lanes[0].id
    start = [link.start for link in network.backward.get(lane, [])]
    end = [link.end for link in network.onward.get(lane, [])]
    sides = []
    for side, areas in zip(Side, (end, start) if reverse else (start, end), strict=True):
        footpaths = [
            (leads.length_m, leads.edge, at_end, area)
            for area in areas
            for leads, at_end in [
                *((network.lanes[link.start], True) for link in network.backward.get(area, [])),
                *((network.lanes[link.end], False) for link in network.onward.get(area, [])),
            ]
            if network.edges[leads.edge].function == "normal" and leads.allows("pedestrian")
        ]
        if not footpaths:
            problem = f"0 footpaths lead to its {side} end"
            allowed = "1 at each end: a lane for pedestrians, as netconvert --sidewalks.guess adds"
            raise InputError(crossing.id, problem, allowed)
        length, edge, at_end, area = max(footpaths)
        inside = min(_INSIDE_M, length / 2)
        ends_at = (length, length - inside) if at_end else (0.0, inside)
        sides.append(Footpath(edge, *ends_at, network.lanes[area].edge))
    return sides[0], sides[1]


def _signal(network: RoadNetwork, crossing: Edge, approach: Lane) -> Signal | None:
    """The traffic light of a crossing, or of the ego's link over it."""
    links = [*_onto(network, crossing), *network.onward.get(approach.id, [])]
    names = [link.signal for link in links if link.signal]
    if not names:
        return None
    prefix = f":{junction_of(crossing.id)}_c"
    walked = {
        int(link.signal_index)
        for edge in network.crossings()
        if edge.id.startswith(prefix)
        for link in _onto(network, edge)
        if link.signal == names[0]
    }
    return Signal(names[0], frozenset(walked))
