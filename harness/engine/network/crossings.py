"""A network in; its pedestrian crossings out, as the keys of ``[crossing]`` describe them."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from harness.core.errors import InputError
from harness.site import RoadNetwork
from harness.site.locate import ends_of
from harness.site.road_network import allows, line_of

if TYPE_CHECKING:
    from sumolib.net.edge import Edge
    from sumolib.net.lane import Lane


@dataclass(frozen=True)
class CrossingRow:
    """A crossing; unknown values are None, and ``problem`` says why.

    ``bearing_deg`` is the direction of the first road that it crosses, clockwise from the network's
    north, and ``lanes`` counts the car lanes in that direction.
    """

    edge: str
    streets: tuple[str, ...]
    problem: str | None = None
    length_m: float | None = None
    width_m: float | None = None
    lanes: int | None = None
    oncoming_lanes: int | None = None
    bearing_deg: float | None = None


def list_crossings(network: RoadNetwork) -> list[CrossingRow]:
    """All crossings of a network, in the file's order."""
    return [_row(crossing) for crossing in network.crossings.values()]


def _row(crossing: "Edge") -> CrossingRow:
    roads = crossing.getCrossingEdges()
    name = crossing.getID(), tuple(dict.fromkeys(road.getName() or road.getID() for road in roads))
    headings = [
        _heading(lane, ends_there=road.getToNode() is crossing.getToNode())
        for road in roads
        for lane in road.getLanes()
        if allows(lane, "passenger")
    ]
    if not headings:
        return CrossingRow(*name, "it crosses no car lane")
    try:
        start, end = ends_of(crossing)
    except (InputError, ZeroDivisionError) as error:
        return CrossingRow(*name, getattr(error, "problem", "its ends are one point"))
    along = sum((heading * headings[0].conjugate()).real > 0 for heading in headings)
    return CrossingRow(
        *name,
        length_m=abs(end - start),
        width_m=crossing.getLane(0).getWidth(),
        lanes=along,
        oncoming_lanes=len(headings) - along,
        bearing_deg=math.degrees(math.atan2(headings[0].real, headings[0].imag)) % 360.0,
    )


def _heading(lane: "Lane", *, ends_there: bool) -> complex:
    """The direction of a lane at the end that meets a crossing."""
    line = line_of(lane)
    return line[-1] - line[-2] if ends_there else line[1] - line[0]
