"""What else a way leads past: traffic lights, and crosswalks on which nobody is simulated."""

from itertools import pairwise

from harness.roads.road_network import Edge, RoadNetwork, junction_of
from harness.roads.site import Passed
from harness.roads.ways import Path, Straight


def passed_on(
    network: RoadNetwork, path: Path, road: Straight, crossing: Edge
) -> tuple[Passed, ...]:
    """The traffic lights and other crosswalks on the straight part of a way, in its order.

    Args:
        network: that it leads through.
        path: the way.
        road: its straight part.
        crossing: the crosswalk that is simulated; its own light is ``Site.signal``.
    """
    found = []
    for (lane, start_m), (after, _) in pairwise(path.pieces()):
        junction, end_m = network.edges[lane.edge].end, start_m + lane.length_m
        for link in network.onward.get(lane.id, []):
            leads_on = after.id in (link.via, link.end)
            if link.signal and leads_on and junction != junction_of(crossing.id):
                found.append(Passed("traffic light", link.signal, end_m))
    for lane, start_m in path.pieces():
        edge = network.edges[lane.edge]
        for other in network.crossings_over.get(edge.id, []):
            if other.id != crossing.id:
                at_end = junction_of(other.id) == edge.end
                found.append(
                    Passed("crosswalk", other.id, start_m + (lane.length_m if at_end else 0.0))
                )
    inside = [of for of in found if -road.before_m <= of.x_m <= road.after_m]
    # A crosswalk may lead over the road on both sides of its junction.
    return tuple(sorted({of.id: of for of in inside}.values(), key=lambda of: of.x_m))
