"""A vehicle's way over a chosen crosswalk, and whether a strategy may drive it there."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from harness.core.encounter import Vehicle
from harness.site import WayOver

INSIDE = "came onto the approach within R0"
BENDS_WITHIN = "its way bends within R0"
TURNS_SOON = "turns before its rear has left"
STOPS = "stops before its rear has left"
ARRIVES = "arrives before its rear has left"
LIGHT = "a traffic light controls its way"

TURNS = "turns at the junction"
BENDS = "its way bends at the crosswalk"
"""It bends within 10 m before the crosswalk or before the rear has left: it is not measured."""

_STOPS_AHEAD = 3
"""Number of stops ahead that are read."""


@dataclass(frozen=True, slots=True)
class Visit:
    """A vehicle at a crosswalk.

    ``at`` is the index of the crosswalk's approach in its route.  ``why`` is the reason why it does
    not go straight on over the crosswalk, or None.
    """

    at: int
    why: str | None


def visit_of(route: Sequence[str], index: int, way: WayOver) -> Visit | None:
    """The visit of a route to a way over a crosswalk; None if it does not lead to the approach.

    Args:
        route: ids of its edges.
        index: index of the edge on which the vehicle is, or which it has just left.
        way: the way over the crosswalk.
    """
    edges = [lane.edge for lane in way.lanes if not lane.edge.startswith(":")]
    here = route[max(index, 0)]
    if here not in edges or edges.index(here) > edges.index(way.from_edge):
        return None
    before = edges[edges.index(here) : edges.index(way.from_edge) + 1]
    ahead = list(route[index : index + len(before) + 1])
    at = index + len(before) - 1
    if ahead[: len(before)] != before[: len(ahead)]:
        return None
    if len(ahead) <= len(before):
        return Visit(at, ARRIVES)
    return Visit(at, None if ahead[-1] == way.to_edge else TURNS)


def free_speed(api: Any, name: str, way: WayOver) -> float:
    """v0 in m/s: the approach's limit × the vehicle's speed factor, at most its maximum speed."""
    vehicle = api.vehicle
    if vehicle.getLaneID(name) == way.approach:
        return float(vehicle.getAllowedSpeed(name))
    limit_mps = api.lane.getMaxSpeed(way.approach) * vehicle.getSpeedFactor(name)
    return float(min(vehicle.getMaxSpeed(name), limit_mps))


def why_not(
    api: Any, name: str, way: WayOver, vehicle: Vehicle, x_m: float, ahead: Sequence[str]
) -> str | None:
    """Why no strategy may drive a vehicle over a crosswalk, or None.

    Args:
        api: the running simulation.
        name: id of the vehicle.
        way: the way on which it goes straight over the crosswalk.
        vehicle: its constants.
        x_m: x of its front bumper.
        ahead: the edges of its route from the crosswalk on.
    """
    if way.straight_before_m < vehicle.trigger_range_m - 1e-6:
        return BENDS_WITHIN
    rear_m = vehicle.length_m + way.crossing.width_m / 2
    for light in api.vehicle.getNextTLS(name):
        if x_m + light[2] < rear_m:
            return LIGHT
    for stop in api.vehicle.getStops(name, _STOPS_AHEAD):
        edge, _, _ = stop.lane.rpartition("_")
        place_m = way.place_m(edge, stop.endPos)
        if place_m is not None and x_m <= place_m < rear_m:
            return STOPS
    return _ends(way, rear_m, ahead)


def _ends(way: WayOver, rear_m: float, ahead: Sequence[str]) -> str | None:
    """Why the route does not go straight on until the rear has left, or None."""
    edges = [lane for lane in way.lanes if not lane.edge.startswith(":")]
    first = next(number for number, lane in enumerate(edges) if lane.edge == way.to_edge)
    for number, lane in enumerate(edges[first:]):
        if number >= len(ahead):
            return ARRIVES
        if ahead[number] != lane.edge:
            return TURNS_SOON
        if lane.end_m >= rear_m:
            return None
    return None


def left_way(api: Any, name: str, way: WayOver, x_m: float) -> bool:
    """Whether a vehicle has left a way before its end; ``x_m`` is where it should be."""
    if x_m > way.lanes[-1].end_m:
        return False
    return api.vehicle.getRoadID(name) not in {lane.edge for lane in way.lanes}
