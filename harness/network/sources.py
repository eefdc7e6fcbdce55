"""A crosswalk's geometry, and the plain-XML sources of its SUMO network.

A site is one straight two-lane road with one unsignalized crosswalk across it. Its sources place
the nodes in longitude and latitude; netconvert lays them out in the projection of
`harness.network.site`, whose origin is the crosswalk's centre.
"""

import math
import re
from dataclasses import dataclass
from decimal import Decimal

from harness.errors import InputError
from harness.network.site import offset_deg, projection
from harness.scenario.sections import MAX_TRIGGER_RANGE_M

APPROACH_M = MAX_TRIGGER_RANGE_M
"""Road before the crosswalk's centre line: the largest trigger range a site offers."""
EXIT_M = 120.0
"""Road after the crosswalk's centre line."""
FOOTPATH_M = 10.0
"""From a kerb to the outer end of its footpath."""

_BOUNDS = {
    # Nearer to a pole the bearing of a straight road would change along it.
    "latitude_deg": (-85.0, 85.0),
    "longitude_deg": (-180.0, 180.0),
    "bearing_deg": (0.0, 360.0),
    # Two lanes; narrower than 2 m each they would not hold a car.
    "length_m": (4.0, 40.0),
    "width_m": (1.0, 20.0),
}


@dataclass(frozen=True)
class CrossingGeometry:
    """Place and size of one crosswalk.

    Args:
        latitude_deg: WGS84 latitude of the crosswalk's centre, −85 to 85.
        longitude_deg: WGS84 longitude of the crosswalk's centre, −180 to 180.
        bearing_deg: the ego's driving direction, clockwise from true north, 0 to 360.
        length_m: kerb to kerb, two lanes of half of it each, 4 to 40.
        width_m: extent of the crosswalk along the road, 1 to 20.
        pedestrian_priority: whether vehicles have to yield, as at a marked crosswalk; what SUMO's
            own driver and pedestrians go by, nobody else.

    The defaults are the crosswalk at the Central Campus Transit Center (CCTC), Ann Arbor.

    Raises:
        InputError: a value is not a finite number within its range.
    """

    latitude_deg: float = 42.278415
    longitude_deg: float = -83.735580
    bearing_deg: float = 316.5
    length_m: float = 9.0
    width_m: float = 4.0
    pedestrian_priority: bool = True

    def __post_init__(self) -> None:
        for name, (low, high) in _BOUNDS.items():
            value = getattr(self, name)
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not (number and low <= value <= high):
                raise InputError(f"crossing.{name}", f"{value!r}", f"{low:g} to {high:g}")
            # 9 and 9.0 are one geometry and must give one text of the sources.
            object.__setattr__(self, name, float(value) + 0.0)


def plain_sources(geometry: CrossingGeometry, name: str) -> dict[str, str]:
    """The plain-XML sources of a site, netconvert's configuration among them.

    The text is a function of the arguments alone; it names its files by relative paths, so
    ``netconvert -c <name>.netccfg`` rebuilds the network in any folder.

    Args:
        geometry: the crosswalk.
        name: stem of every file's name: letters, digits, ``-`` and ``_``.

    Returns:
        File name → text.

    Raises:
        InputError: the name cannot be a file's stem.
    """
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise InputError("network name", repr(name), "letters, digits, - and _")
    values = {
        "name": name,
        "bearing": repr(geometry.bearing_deg),
        "nodes": "\n".join(_nodes(geometry)),
        "lane": repr(geometry.length_m / 2),
        "width": repr(geometry.width_m),
        "right_of_way": (
            "A marked crosswalk: vehicles yield."
            if geometry.pedestrian_priority
            else "An unmarked one: pedestrians yield."
        ),
        "priority": f'priority="{str(geometry.pedestrian_priority).lower()}"',
        "projection": projection(geometry.latitude_deg, geometry.longitude_deg),
    }
    return {f"{name}.{kind}": text.format_map(values) for kind, text in _TEMPLATES.items()}


_TEMPLATES = {
    "nod.xml": """<nodes>
    <!-- The ego drives along bearing {bearing}. x: longitude, y: latitude, WGS84. -->
{nodes}
</nodes>
""",
    "edg.xml": """<edges>
    <!-- Right-hand traffic: both directions lie right of the axis between the nodes. -->
    <edge id="approach" from="start" to="crosswalk" type="road" spreadType="right"/>
    <edge id="exit" from="crosswalk" to="end" type="road" spreadType="right"/>
    <edge id="oncoming_approach" from="end" to="crosswalk" type="road" spreadType="right"/>
    <edge id="oncoming_exit" from="crosswalk" to="start" type="road" spreadType="right"/>
    <!-- Centred on their axis, they put the crosswalk onto the node. -->
    <edge id="near" from="near" to="crosswalk" type="footpath" spreadType="center"/>
    <edge id="far" from="crosswalk" to="far" type="footpath" spreadType="center"/>
</edges>
""",
    # The speed limits only keep SUMO from refusing or changing a speed.
    "typ.xml": """<types>
    <type id="road" numLanes="1" speed="100" width="{lane}" priority="2" disallow="pedestrian"/>
    <type id="footpath" numLanes="1" speed="10" width="{width}" priority="1" allow="pedestrian"/>
</types>
""",
    "con.xml": """<connections>
    <connection from="approach" to="exit" fromLane="0" toLane="0"/>
    <connection from="oncoming_approach" to="oncoming_exit" fromLane="0" toLane="0"/>
    <!-- {right_of_way} It binds SUMO's own driver only; the pedestrians and
         strategies of the harness follow their own rules. -->
    <crossing node="crosswalk" edges="approach oncoming_exit" {priority} width="{width}"/>
</connections>
""",
    # Node coordinates come out to a micrometre whatever the precision; the other shapes keep 1e-9.
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
    <projection>
        <proj value="{projection}"/>
    </projection>
    <processing>
        <no-turnarounds value="true"/>
        <offset.disable-normalization value="true"/>
    </processing>
</configuration>
""",
}


def _nodes(geometry: CrossingGeometry) -> list[str]:
    """Nodes in longitude and latitude; a unit of the last decimal is at most 1.1e-8 m."""
    bearing = math.radians(geometry.bearing_deg)
    east, north = math.sin(bearing), math.cos(bearing)
    reach = FOOTPATH_M + geometry.length_m / 2
    places = {
        "start": (-APPROACH_M, 0.0),
        "crosswalk": (0.0, 0.0),
        "end": (EXIT_M, 0.0),
        "near": (0.0, -reach),
        "far": (0.0, reach),
    }
    # Decimal sums: in floating point the last digits would depend on the machine's sine, and then
    # the shipped sources would not be those of their own geometry.
    longitude, latitude = (
        Decimal(f"{degrees:.9f}") for degrees in (geometry.longitude_deg, geometry.latitude_deg)
    )
    lines = []
    for node, (along, left) in places.items():
        offset = offset_deg(
            float(latitude), along * east - left * north, along * north + left * east
        )
        x, y = longitude + Decimal(f"{offset[0]:.13f}"), latitude + Decimal(f"{offset[1]:.13f}")
        x -= 360 * round(x / 360)  # beyond the date line
        lines.append(f'    <node id="{node}" x="{x:.13f}" y="{y:.13f}" type="priority"/>')
    return lines
