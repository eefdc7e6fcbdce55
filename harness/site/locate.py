"""A generated network in; its site out.  Ends and footpaths are those of any crossing."""

from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from harness.core.encounter import Side
from harness.core.errors import InputError
from harness.site.road_network import allows, line_of, read_network
from harness.site.site import Footpath, RoadFrame, Site, Stretch, Way
from harness.site.ways import Path, paths_over, straight

if TYPE_CHECKING:
    from sumolib.net.connection import Connection
    from sumolib.net.edge import Edge
    from sumolib.net.lane import Lane

_BENT_M = 0.05
"""Largest deviation of a crosswalk's centre line from a straight line."""
_INSIDE_M = 1.0
"""Distance from the crosswalk's waiting area at which pedestrians are inserted on the footpath."""


@dataclass(frozen=True, slots=True)
class Place:
    """A generated network, and the number of the ego's lane, counted from the near kerb."""

    net: FilePath
    lane: int = 0


def read_site(place: Place) -> Site:
    """The site of a place.

    Raises:
        InputError: the file is not a network, or not one that was generated from a scenario.
    """
    network = read_network(place.net)
    try:
        crossing = network.crossings[":crosswalk_c0"]
        ends = ends_of(crossing)
        paths = {
            name: [
                next(paths_over(network, lane, ends))
                for lane in network.net.getEdge(name).getLanes()
                if allows(lane, "passenger")
            ]
            for name in ("approach", "oncoming_approach")
            if network.net.hasEdge(name)
        }
        ego = paths["approach"][place.lane]
    except (LookupError, StopIteration):
        problem = "is not a network of a scenario's [crossing]"
        raise InputError(str(place.net), problem, "one that `harness network` writes") from None
    direction = straight(ego).direction
    # The near kerb is on the ego's right.
    reverse = ((ends[1] - ego.meeting) / direction).imag <= 0
    near, far = (ends[1], ends[0]) if reverse else ends
    across = (far - near) / abs(far - near)
    ways = tuple(
        _way(path, index, ((path.meeting - near) * across.conjugate()).real)
        for each in paths.values()
        for index, path in enumerate(each)
    )
    return Site(
        frame=RoadFrame(*_pair(near), *_pair(direction), *_pair(across)),
        ego=ways[place.lane],
        ways=ways,
        length_m=abs(far - near),
        width_m=crossing.getLane(0).getWidth(),
        footpaths=footpaths_of(crossing, reverse=reverse),
    )


def _pair(point: complex) -> tuple[float, float]:
    return point.real, point.imag


def _way(path: Path, index: int, centre_m: float) -> Way:
    (approach, start), *_, (beyond, beyond_start) = path.pieces()
    stretches = (_stretch(approach, start), _stretch(beyond, beyond_start))
    oncoming = stretches[0].edge != "approach"
    return Way(oncoming, index, centre_m, approach.getWidth(), stretches)


def _stretch(lane: "Lane", start_m: float) -> Stretch:
    edge = lane.getEdge().getID()
    return Stretch(edge, lane.getIndex(), start_m, start_m + lane.getLength())


def ends_of(crossing: "Edge") -> tuple[complex, complex]:
    """Both ends of a crossing's centre line."""
    line = line_of(crossing.getLane(0))
    span = line[-1] - line[0]
    bent = max(abs((span.conjugate() * (point - line[0])).imag) / abs(span) for point in line)
    if bent > _BENT_M:
        problem = f"its centre line bends by {bent:.2f} m"
        raise InputError(crossing.getID(), problem, f"at most {_BENT_M:g} m")
    return line[0], line[-1]


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
