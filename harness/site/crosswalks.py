"""Every crosswalk of a network, with the ways of vehicles over it; each way has its own frame."""

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from harness.core.encounter import Crossing
from harness.core.errors import InputError
from harness.site.locate import ends_of, footpaths_of, links_onto
from harness.site.road_network import RoadNetwork, line_of
from harness.site.site import RoadFrame
from harness.site.ways import Path, extended, paths_over, straight

if TYPE_CHECKING:
    from sumolib.net.edge import Edge
    from sumolib.net.lane import Lane

MAX_OBLIQUE_DEG = 20.0
"""Largest deviation of the angle between road and crosswalk from 90°."""

STRAIGHT_BEFORE_M = 10.0
"""A way whose straight part before the crosswalk is shorter than this counts as turning."""


@dataclass(frozen=True, slots=True)
class LanePlace:
    """A lane on a way over a crosswalk, with its position on the way by SUMO's lengths.

    ``start_m`` is negative before the crosswalk's centre line, positive beyond it.
    """

    edge: str
    lane: str
    start_m: float
    end_m: float


@dataclass(frozen=True, slots=True)
class WayOver:
    """The way of one connection of lanes over a crosswalk.

    Attributes:
        crosswalk: id of the crossing's edge.
        approach: the lane of ``from_edge`` that leads into the junction.
        from_edge: the last edge before the junction.
        to_edge: the first edge beyond it.
        lanes: the lanes that lead straight to the crosswalk, including those inside junctions, in
            order of travel.
        frame: x is along the way, 0 at the crosswalk's centre line; y is along the crosswalk, 0 at
            the near kerb, as in ``harness.site.site``.
        crossing: the crosswalk's constants for a vehicle on this way.
        angle_deg: angle between way and crosswalk, 0 to 90.
        turn_deg: angle between the lanes before and beyond the junction, 0 to 180.
        straight_before_m: length of the way before the centre line that is straight within 1°.
        straight_after_m: the same beyond the centre line.
        ends_before: why the straight part begins there.
        ends_after: why it ends there.
        signalled: whether a traffic light controls the vehicles or the people there.
    """

    crosswalk: str
    approach: str
    from_edge: str
    to_edge: str
    lanes: tuple[LanePlace, ...]
    frame: RoadFrame
    crossing: Crossing
    angle_deg: float
    turn_deg: float
    straight_before_m: float
    straight_after_m: float
    ends_before: str
    ends_after: str
    signalled: bool

    @property
    def oblique(self) -> bool:
        """Whether the angle between way and crosswalk differs from 90° by more than 20°."""
        return self.angle_deg < 90.0 - MAX_OBLIQUE_DEG

    def is_straight(self, length_m: float) -> bool:
        """Whether a vehicle of that length keeps straight on over the crosswalk."""
        rear_m = length_m + self.crossing.width_m / 2
        return self.straight_before_m >= STRAIGHT_BEFORE_M and self.straight_after_m >= rear_m

    @property
    def bend(self) -> str:
        """For a way that is not straight over the crosswalk: up to where it is, and why."""
        where, length_m, why = "before", self.straight_before_m, self.ends_before
        if length_m >= STRAIGHT_BEFORE_M:
            where, length_m, why = "beyond", self.straight_after_m, self.ends_after
        return f"the way from {self.approach} is straight for {length_m:.1f} m {where} it and {why}"

    def place_m(self, edge: str, position_m: float) -> float | None:
        """x of a position on any lane of an edge; None if the way does not lead over that edge."""
        for each in self.lanes:
            if each.edge == edge:
                return each.start_m + position_m
        return None


@dataclass(frozen=True, slots=True)
class Crosswalk:
    """A crossing of a SUMO network with the ways of vehicles over it.

    Attributes:
        id: id of the crossing's edge, e.g. ``:J7_c0``.
        length_m: distance from kerb to kerb, along the crosswalk.
        width_m: extent along the road.
        signalled: whether a traffic light controls it.
        areas: ids of the walking areas at its ends.
        ways: one for each connection of lanes that leads over it.
        refused: why nothing can be measured there, or None.
        unreached: why nobody can walk over it, or None.
    """

    id: str
    length_m: float
    width_m: float
    signalled: bool
    areas: frozenset[str]
    ways: tuple[WayOver, ...]
    refused: str | None
    unreached: str | None

    @property
    def problem(self) -> str | None:
        """Why no strategy can drive over it, or None."""
        if self.signalled:
            return "a traffic light controls it"
        if self.refused is not None:
            return self.refused
        if not (ways := self.straight_ways):
            bends = [way.bend for way in sorted(self.ways, key=lambda way: way.turn_deg)[:1]]
            return ": ".join(["no lane leads straight over it", *bends])
        if all(way.oblique for way in ways):
            angle_deg = max(way.angle_deg for way in ways)
            return f"vehicles meet it at {angle_deg:.0f}°, not within {MAX_OBLIQUE_DEG:.0f}° of 90°"
        return self.unreached

    @property
    def straight_ways(self) -> tuple[WayOver, ...]:
        """The ways that lead straight on over it."""
        return tuple(way for way in self.ways if way.is_straight(0.0))


def crosswalks_of(network: RoadNetwork) -> tuple[Crosswalk, ...]:
    """Every crosswalk of a network, in the file's order.

    If the network is damaged at a crosswalk, only that crosswalk is ``refused``.
    """
    return tuple(_crosswalk(network, edge) for edge in network.crossings.values())


def _crosswalk(network: RoadNetwork, crossing: "Edge") -> Crosswalk:
    links = links_onto(crossing)
    lane = crossing.getLane(0)
    areas = [link.getFromLane() for link in links] + [
        link.getToLane() for link in lane.getOutgoing()
    ]
    signalled = any(link.getTLSID() for link in links)
    ways: tuple[WayOver, ...] = ()
    length_m, refused, unreached = lane.getLength(), None, None
    try:
        ends = ends_of(crossing)
        length_m = abs(ends[1] - ends[0])
        paths = list(_paths(network, crossing, ends))
        ways = tuple([_way(network, crossing, ends, path, signalled=signalled) for path in paths])
    except InputError as error:
        refused = error.problem
    except (LookupError, ValueError, ZeroDivisionError, StopIteration) as error:
        refused = f"the network is damaged there ({error})"
    try:
        footpaths_of(crossing, over_refuge=True)
    except InputError as error:
        unreached = error.problem
    return Crosswalk(
        id=crossing.getID(),
        length_m=length_m,
        width_m=lane.getWidth(),
        signalled=signalled or any(way.signalled for way in ways),
        areas=frozenset(area.getEdge().getID() for area in areas),
        ways=ways,
        refused=refused,
        unreached=unreached,
    )


def _paths(network: RoadNetwork, crossing: "Edge", ends: tuple[complex, complex]) -> Iterator[Path]:
    """The path of every connection of a lane for vehicles that meets a crossing."""
    crossed = crossing.getCrossingEdges()
    for edge in crossing.getToNode().getIncoming():
        if edge.isSpecial():
            continue
        for lane in edge.getLanes():
            if not _for_vehicles(lane):
                continue
            for path in paths_over(network, lane, ends):
                # A lane that only touches the crosswalk's end belongs to another road.
                if any(each.getEdge() in crossed for each in path.lanes):
                    yield path


def _for_vehicles(lane: "Lane") -> bool:
    return not {"pedestrian"}.issuperset(lane.getPermissions())


def _way(
    network: RoadNetwork,
    crossing: "Edge",
    ends: tuple[complex, complex],
    path: Path,
    *,
    signalled: bool,
) -> WayOver:
    approach, beyond = path.lanes[0], path.lanes[-1]
    whole = extended(network, path)
    road = straight(whole)
    angle = abs(math.degrees(cmath.phase((ends[1] - ends[0]) / road.direction)))
    angle = min(angle, 180.0 - angle)
    slant = math.sin(math.radians(angle))
    to_left = ((ends[1] - path.meeting) / road.direction).imag > 0
    near, far = (ends[1], ends[0]) if to_left == network.left_hand else ends
    across = (far - near) / abs(far - near)
    coming, onward = line_of(approach), line_of(beyond)
    turn = (onward[1] - onward[0]) * (coming[-1] - coming[-2]).conjugate()
    links = [link for link in approach.getOutgoing() if link.getToLane() is beyond]
    return WayOver(
        crosswalk=crossing.getID(),
        approach=approach.getID(),
        from_edge=approach.getEdge().getID(),
        to_edge=beyond.getEdge().getID(),
        lanes=tuple(
            LanePlace(lane.getEdge().getID(), lane.getID(), start, start + lane.getLength())
            for lane, start in whole.pieces()
        ),
        frame=RoadFrame(
            near.real, near.imag, road.direction.real, road.direction.imag, across.real, across.imag
        ),
        crossing=Crossing(
            length_m=abs(far - near),
            width_m=crossing.getLane(0).getWidth() / slant if slant else math.inf,
            lane_centre_m=((path.meeting - near) * across.conjugate()).real,
            lane_width_m=approach.getWidth() / slant if slant else math.inf,
            speed_limit_mps=approach.getSpeed(),
        ),
        angle_deg=angle,
        turn_deg=abs(math.degrees(cmath.phase(turn))),
        straight_before_m=road.before_m,
        straight_after_m=road.after_m,
        ends_before=road.ends_before,
        ends_after=road.ends_after,
        signalled=signalled or any(link.getTLSID() for link in links),
    )
