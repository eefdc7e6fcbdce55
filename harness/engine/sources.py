"""A crosswalk's geometry in; the plain-XML sources of its SUMO network out.

A site is one straight road, one-way or two-way, with one unsignalized crosswalk.  Width that the
lanes do not fill becomes a median on a two-way road, and a strip at each kerb on a one-way road.
In SUMO a strip is a lane for a vehicle class that never occurs.

Coordinates are metres east and north of the crosswalk's centre.  If the scenario has a latitude and
longitude, the file of nodes names a transverse Mercator projection with its origin there.  So a
metre in the network is a metre on the ground, and the network's north is true north.  A UTM zone
would have a scale error (up to 0.1 %) and a grid convergence (1.8° in Ann Arbor).
"""

import math
import re
from collections.abc import Iterator

from harness.core.errors import InputError
from harness.scenario.sections import FOOTPATH_M, MAX_TRIGGER_RANGE_M, CrossingSection

APPROACH_M = MAX_TRIGGER_RANGE_M
"""Length of road before the crosswalk's centre line: the largest trigger range of a site."""
EXIT_M = APPROACH_M
"""Length of road after the crosswalk's centre line: the approach of oncoming vehicles."""
NO_LIMIT_MPS = 100
"""The lanes' speed limit, so high that SUMO neither refuses nor changes a speed."""
CROSSWALK = ":crosswalk_c0"
"""SUMO's id of the crosswalk of such a site."""


def plain_sources(crossing: CrossingSection, name: str) -> dict[str, str]:
    """The plain-XML sources of a site, with netconvert's configuration.

    The text depends only on the arguments, and file names are relative.  So
    ``netconvert -c <name>.netccfg`` rebuilds the network in any folder.

    Args:
        crossing: the crosswalk.
        name: stem of all file names, of letters, digits, ``-`` and ``_``.

    Returns:
        File name → text.

    Raises:
        InputError: the name has other characters.
    """
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise InputError("network name", repr(name), "letters, digits, - and _")
    values = {
        "name": name,
        "bearing": repr(crossing.bearing_deg),
        "location": _location(crossing),
        "nodes": "\n".join(_nodes(crossing)),
        "edges": "\n".join(_edges(crossing)),
        "connections": "\n".join(_connections(crossing)),
        "crossed": "approach oncoming_exit" if crossing.oncoming_lanes else "approach",
        "lane": repr(crossing.width_of_lane_m),
        "width": repr(crossing.width_m),
        "limit": repr(NO_LIMIT_MPS),
    }
    return {f"{name}.{kind}": text.format_map(values) for kind, text in _TEMPLATES.items()}


def _location(crossing: CrossingSection) -> str:
    """SUMO's attributes of location and projection; without a latitude there is no projection."""
    boundary, projection = "0,0,0,0", "!"
    if crossing.latitude_deg is not None:
        latitude, longitude = f"{crossing.latitude_deg:.9f}", f"{crossing.longitude_deg:.9f}"
        boundary = f"{longitude},{latitude},{longitude},{latitude}"
        projection = (
            f"+proj=tmerc +lat_0={latitude} +lon_0={longitude}"
            " +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
        )
    return f'origBoundary="{boundary}"\n              projParameter="{projection}"'


_TEMPLATES = {
    "nod.xml": """<nodes>
    <!-- The ego drives along bearing {bearing}. x: metres east, y: metres north of the centre. -->
    <location netOffset="0,0" convBoundary="0,0,0,0"
              {location}/>
{nodes}
</nodes>
""",
    "edg.xml": """<edges>
    <!-- Right-hand traffic: both directions lie right of the axis between the nodes. -->
{edges}
    <!-- Centred on their axis, they put the crosswalk onto the node. -->
    <edge id="near" from="near" to="crosswalk" type="footpath" spreadType="center"/>
    <edge id="far" from="crosswalk" to="far" type="footpath" spreadType="center"/>
</edges>
""",
    "typ.xml": """<types>
    <type id="road" numLanes="1" speed="{limit}" width="{lane}" priority="2" disallow="pedestrian"/>
    <type id="footpath" numLanes="1" speed="10" width="{width}" priority="1" allow="pedestrian"/>
</types>
""",
    "con.xml": """<connections>
{connections}
    <!-- A marked crosswalk: vehicles yield. It binds SUMO's own driver only; the pedestrians and
         strategies of the harness follow their own rules. -->
    <crossing node="crosswalk" edges="{crossed}" priority="true" width="{width}"/>
</connections>
""",
    # netconvert writes node coordinates to a micrometre at any precision; other shapes keep 1e-9 m.
    "netccfg": """<configuration>
    <input>
        <node-files value="{name}.nod.xml"/>
        <edge-files value="{name}.edg.xml"/>
        <connection-files value="{name}.con.xml"/>
        <type-files value="{name}.typ.xml"/>
    </input>
    <output>
        <output-file value="{name}.net.xml"/>
        <precision value="9"/>
        <precision.geo value="8"/>
    </output>
    <processing>
        <no-turnarounds value="true"/>
        <offset.disable-normalization value="true"/>
    </processing>
</configuration>
""",
}


def _nodes(crossing: CrossingSection) -> Iterator[str]:
    """The nodes, to a micrometre, which is netconvert's own precision."""
    reach = FOOTPATH_M + crossing.length_m / 2
    axis = 0.0 if _median_m(crossing) else _left_border_m(crossing)
    places = {
        "start": (-APPROACH_M, axis),
        "crosswalk": (0.0, axis),
        "end": (EXIT_M, axis),
        "near": (0.0, -reach),
        "far": (0.0, reach),
    }
    for node, place in places.items():
        x, y = _placed(crossing, *place)
        yield f'    <node id="{node}" x="{x}" y="{y}" type="priority"/>'


def _edges(crossing: CrossingSection) -> Iterator[str]:
    """The road's edges; with a median, the line of each edge is its own left border."""
    forward, oncoming = _left_border_m(crossing), _left_border_m(crossing) + _median_m(crossing)
    directions = [("", crossing.lanes, "start", "end", -APPROACH_M, EXIT_M, forward)]
    if crossing.oncoming_lanes:
        lanes = crossing.oncoming_lanes
        directions.append(("oncoming_", lanes, "end", "start", EXIT_M, -APPROACH_M, oncoming))
    for prefix, lanes, first, last, begin, end, border in directions:
        more = "" if lanes == 1 else f' numLanes="{lanes}"'
        inside = "/>"
        if crossing.kerb_strip_m:
            more = f' numLanes="{lanes + 2}"'
            strips = [
                f'        <lane index="{index}" width="{crossing.kerb_strip_m!r}" allow="custom1"/>'
                for index in (0, lanes + 1)
            ]
            inside = "\n".join([">", *strips, "    </edge>"])
        stretches = (
            ("approach", first, "crosswalk", begin, 0.0),
            ("exit", "crosswalk", last, 0.0, end),
        )
        for name, source, target, since, until in stretches:
            shape = ""
            if _median_m(crossing):
                points = (_placed(crossing, along, border) for along in (since, until))
                shape = f' shape="{" ".join(",".join(point) for point in points)}"'
            yield (
                f'    <edge id="{prefix}{name}" from="{source}" to="{target}" type="road"'
                f' spreadType="right"{more}{shape}{inside}'
            )


def _connections(crossing: CrossingSection) -> Iterator[str]:
    """Connections straight on, from each lane to the same lane."""
    strip = int(crossing.kerb_strip_m > 0)
    for prefix, lanes in (("", crossing.lanes), ("oncoming_", crossing.oncoming_lanes)):
        for lane in range(strip, strip + lanes):
            yield (
                f'    <connection from="{prefix}approach" to="{prefix}exit"'
                f' fromLane="{lane}" toLane="{lane}"/>'
            )


def _median_m(crossing: CrossingSection) -> float:
    return crossing.beside_lanes_m if crossing.oncoming_lanes else 0.0


def _left_border_m(crossing: CrossingSection) -> float:
    """The left border of the ego's carriageway, in m left of the crosswalk's centre."""
    width = crossing.lanes * crossing.width_of_lane_m + 2 * crossing.kerb_strip_m
    return width - crossing.length_m / 2


def _placed(crossing: CrossingSection, along_m: float, left_m: float) -> tuple[str, str]:
    """The metres east and north of a point, given in m along and left of the road's axis."""
    bearing = math.radians(crossing.bearing_deg)
    east, north = math.sin(bearing), math.cos(bearing)
    x, y = along_m * east - left_m * north, along_m * north + left_m * east
    return f"{x:.6f}", f"{y:.6f}"
