"""Draws the site from its SUMO network: lanes, crossing, walking areas and trigger.

North is up.  The function draws into the given axes and neither saves nor shows the figure.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from harness.core.encounter import Crossing, Vehicle
from harness.old.report.drawing.style import BLUE, INK, MUTED, PATH, ROAD, VERMILLION, finish
from harness.site import RoadNetwork, Site
from harness.site.road_network import allows

if TYPE_CHECKING:
    from sumolib.net.edge import Edge

_MARGIN_M = 3.0
_STRIPE_M = 0.5
"""Width in m of the zebra's stripes and of the gaps between them."""


def draw_site(
    axes: Axes, network: RoadNetwork, site: Site, vehicle: Vehicle, crossing: Crossing
) -> None:
    """Draw lanes, walking areas and the crosswalk of a network, with the ego at its trigger.

    x and y are metres east and north in the network.  Lanes outside the picture are left out.
    """
    _view(axes, site, vehicle, crossing)
    for edge in network.net.getEdges():
        _draw_edge(axes, edge)
    for label, colour in (("road", ROAD), ("footpath and waiting area", PATH)):
        axes.add_patch(Polygon([(0, 0)], fc=colour, ec=MUTED, lw=0.4, label=label))
    half, length = crossing.width_m / 2, crossing.length_m
    stripes = int(length / (2 * _STRIPE_M))
    for index in range(stripes):
        y = (2 * index + 0.5) * _STRIPE_M + (length - (2 * stripes - 1) * _STRIPE_M) / 2
        _area(axes, site, (-half, half), (y - _STRIPE_M / 2, y + _STRIPE_M / 2), fc=INK, zorder=3)
    bumper, middle, side = -vehicle.trigger_range_m, crossing.lane_centre_m, vehicle.width_m / 2
    ego = (bumper - vehicle.length_m, bumper), (middle - side, middle + side)
    label = f"ego at the trigger, R = {vehicle.trigger_range_m:g} m"
    _area(axes, site, *ego, fc=BLUE, zorder=4, label=label)
    begin, end = (site.frame.to_network(bumper + x, site.ego.centre_m) for x in (1.5, 7.5))
    style = {"arrowstyle": "-|>", "color": BLUE, "lw": 1.6, "mutation_scale": 12}
    axes.annotate("", xy=end, xytext=begin, arrowprops=style, zorder=5)
    edges = (middle - crossing.lane_width_m / 2, middle + crossing.lane_width_m / 2)
    stop = [site.frame.to_network(-crossing.stop_line_m, y) for y in edges]
    axes.plot(*zip(*stop, strict=True), color=VERMILLION, lw=2, label="Hard-Yield's stop line")
    finish(axes, "east (m)", "north (m)")
    axes.set_aspect("equal", adjustable="box")


def _draw_edge(axes: Axes, edge: "Edge") -> None:
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    for lane in edge.getLanes():
        shape = lane.getShape()
        xs, ys = zip(*shape, strict=True)
        if max(xs) < west or min(xs) > east or max(ys) < south or min(ys) > north:
            continue
        if edge.getFunction() == "walkingarea":
            axes.add_patch(Polygon(shape, closed=True, fc=PATH, ec=MUTED, lw=0.6, zorder=1))
        elif edge.getFunction() != "crossing":
            walked = allows(lane, "pedestrian") and not allows(lane, "passenger")
            outline, colour = _ribbon(shape, lane.getWidth()), PATH if walked else ROAD
            axes.add_patch(Polygon(outline, closed=True, fc=colour, ec=MUTED, lw=0.4))


def _ribbon(line: Sequence[tuple[float, float]], width: float) -> list[tuple[float, float]]:
    """Return the outline of a line with a width."""
    left, right = [], []
    for (x0, y0), (x1, y1) in pairwise(line):
        long = math.hypot(x1 - x0, y1 - y0) or 1.0
        dx, dy = -(y1 - y0) / long * width / 2, (x1 - x0) / long * width / 2
        left += [(x0 + dx, y0 + dy), (x1 + dx, y1 + dy)]
        right += [(x0 - dx, y0 - dy), (x1 - dx, y1 - dy)]
    return [*left, *reversed(right)]


def _area(
    axes: Axes, site: Site, x: tuple[float, float], y: tuple[float, float], **look: Any
) -> None:
    """Draw a rectangle in the road's frame."""
    corners = (x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])
    shape = [site.frame.to_network(*corner) for corner in corners]
    axes.add_patch(Polygon(shape, closed=True, lw=0, **look))


def _view(axes: Axes, site: Site, vehicle: Vehicle, crossing: Crossing) -> None:
    """Set the limits, from behind the ego at its trigger to beyond the crosswalk."""
    behind = -vehicle.trigger_range_m - vehicle.length_m
    corners = [
        site.frame.to_network(x, y)
        for x in (behind, crossing.width_m / 2 + 8.0)
        for y in (-4.0, crossing.length_m + 4.0)
    ]
    east, north = zip(*corners, strict=True)
    axes.set_xlim(min(east) - _MARGIN_M, max(east) + _MARGIN_M)
    axes.set_ylim(min(north) - _MARGIN_M, max(north) + _MARGIN_M)
