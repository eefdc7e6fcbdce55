"""Draws an exported scenario from above, from its two files alone (docs/report.md)."""

import cmath
from pathlib import Path
from xml.etree.ElementTree import Element, parse

from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from harness.report.style import BLUE, MUTED, VERMILLION, finish, new_figure, styled

ROAD, PATH = "#c4cad1", "#e4e7eb"
EVERY_S = 1.0
"""Time between two drawn outlines of the vehicle."""
FILLS = {"driving": ROAD, "sidewalk": PATH, "walking": PATH}


def top_view(folder: Path, picture: Path) -> None:
    """Draw the road of ``road.xodr`` and everybody of ``scenario.xosc`` around the ego's end."""
    scenario = parse(folder / "scenario.xosc").getroot()
    with styled():
        figure, (axes,) = new_figure(height=3.6)
        for road in parse(folder / "road.xodr").getroot().iter("road"):
            draw_road(axes, road)
        for entity in scenario.iter("ScenarioObject"):
            draw_entity(axes, scenario, entity)
        ego = states(scenario, "ego")[-1][1]
        axes.set(xlim=(ego.real - 20, ego.real + 12), ylim=(ego.imag - 14, ego.imag + 6))
        axes.set_aspect("equal")
        finish(axes, "x of the network, m", "y of the network, m")
        figure.savefig(picture, dpi=150)


def number(element: Element | None, *names: str) -> list[float]:
    """Return attributes of an element as numbers."""
    assert element is not None
    return [float(element.get(name, "nan")) for name in names]


def draw_road(axes: Axes, road: Element) -> None:
    """Draw the lanes along each straight piece of a road."""
    for piece in road.iter("geometry"):
        x, y, heading, length = number(piece, "x", "y", "hdg", "length")
        along, right = cmath.rect(length, heading), 0.0
        for lane in sorted(road.iter("lane"), key=lambda lane: -int(lane.get("id", "0"))):
            if (width := lane.find("width")) is None:
                continue
            sides = [complex(x, y) + cmath.rect(t, heading - cmath.pi / 2)
                     for t in (right, right + number(width, "a")[0])]  # fmt: skip
            right += number(width, "a")[0]
            outline(axes, [sides[0], sides[0] + along, sides[1] + along, sides[1]],
                    facecolor=FILLS.get(lane.get("type", ""), PATH), edgecolor="white")  # fmt: skip


def draw_entity(axes: Axes, scenario: Element, entity: Element) -> None:
    """Draw an entity's outlines: a vehicle's once per second, a pedestrian's at their end."""
    name = entity.get("name", "")
    ahead, left = number(entity.find(".//Center"), "x", "y")
    length, width = number(entity.find(".//Dimensions"), "length", "width")
    path = states(scenario, name)
    colour = {"ego": BLUE}.get(name, VERMILLION if name.startswith("pedestrian") else MUTED)
    axes.plot([at.real for _, at, _ in path], [at.imag for _, at, _ in path], color=colour, lw=1)
    drawn_s = float("-inf")
    for time_s, at, heading in path:
        last = time_s == path[-1][0]
        if not last and (name != "ego" or time_s < drawn_s + EVERY_S):
            continue
        drawn_s = time_s
        corners = [complex(ahead + i * length / 2, left + j * width / 2)
                   for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1))]  # fmt: skip
        turned = [at + corner * cmath.rect(1, heading) for corner in corners]
        outline(axes, turned, facecolor=colour, edgecolor="white", alpha=1.0 if last else 0.25)


def states(scenario: Element, name: str) -> list[tuple[float, complex, float]]:
    """Return time, place and heading of an entity: those of its trajectory, or where it stands."""
    groups = [
        group
        for group in scenario.iter("ManeuverGroup")
        if any(actor.get("entityRef") == name for actor in group.iter("EntityRef"))
    ]
    vertices = [vertex for group in groups for vertex in group.iter("Vertex")]
    private = [each for each in scenario.iter("Private") if each.get("entityRef") == name]
    found = []
    for element in vertices or [*private, *groups][:1]:
        x, y, heading = number(next(element.iter("WorldPosition")), "x", "y", "h")
        time_s = number(element, "time")[0] if vertices else 0.0
        found.append((time_s, complex(x, y), heading))
    return found


def outline(axes: Axes, corners: list[complex], **look: object) -> None:
    """Add a closed shape."""
    axes.add_patch(Polygon([(each.real, each.imag) for each in corners], lw=0.8, **look))
