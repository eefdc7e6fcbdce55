"""A site's network in plain numbers, as an engine needs them.

A network lies in a transverse Mercator projection whose origin is the crosswalk's centre: there
one metre of the network is one metre on the ground and the network's north is true north, so
neither a UTM zone's scale (up to 0.1 %) nor its grid convergence (1.8° in Ann Arbor) enters a
distance or a bearing. The network's point (0, 0) is the crosswalk's centre.

Road frame: x along the ego's direction, 0 at the crosswalk's centre line; y across the road, from
the kerb on the ego's right (0) to the other kerb. Right-hand traffic, two lanes.
"""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

from harness.errors import InputError

TOLERANCE_M = 2e-6
"""What a network may differ from its geometry: netconvert keeps nodes to a micrometre."""

# WGS84: its defining semi-major axis and flattening; the squares of both eccentricities.
_AXIS_M = 6_378_137.0
_FLATTENING = 1 / 298.257223563
_E2 = _FLATTENING * (2 - _FLATTENING)
_SECOND_E2 = _E2 / (1 - _E2)


@dataclass(frozen=True, slots=True)
class Site:
    """A network in numbers: what an engine needs to drive and walk in the road frame.

    ``origin_x_m``/``origin_y_m`` are the network coordinates of the road frame's (0, 0);
    ``along_x``/``along_y`` the unit vector of the ego's direction in the network. Footpath
    positions lie about 1 m outside the junction, for inserting a pedestrian and as his goal; at
    ``near_length_m`` the near footpath ends, the far one begins at 0.
    """

    latitude_deg: float
    longitude_deg: float
    bearing_deg: float
    length_m: float
    width_m: float
    lane_centre_m: float
    approach_edge: str
    exit_edge: str
    near_edge: str
    far_edge: str
    crossing_edge: str
    near_length_m: float
    near_position_m: float
    far_position_m: float
    max_range_m: float
    min_range_m: float
    origin_x_m: float
    origin_y_m: float
    along_x: float
    along_y: float

    def to_network(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Network coordinates (m) of a point of the road frame (m)."""
        return (
            self.origin_x_m + x_m * self.along_x - y_m * self.along_y,
            self.origin_y_m + x_m * self.along_y + y_m * self.along_x,
        )

    def to_road(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Road-frame coordinates (m) of a point of the network (m); inverse of `to_network`."""
        dx = x_m - self.origin_x_m
        dy = y_m - self.origin_y_m
        return dx * self.along_x + dy * self.along_y, dy * self.along_x - dx * self.along_y

    def depart_position_m(self, range_m: float) -> float:
        """SUMO's ``departPos`` that puts the ego's front bumper `range_m` before x = 0.

        Args:
            range_m: from the front bumper to the crosswalk's centre line, m.

        Returns:
            Position on the approach lane, m, from 0 to the lane's length.

        Raises:
            InputError: the point is not on the approach lane.
        """
        # A range of the whole approach must not fail by the last digit of the network's file.
        if not self.min_range_m <= range_m <= self.max_range_m + TOLERANCE_M:
            allowed = f"{self.min_range_m:.3g} to {self.max_range_m:.6g} at this site"
            raise InputError("ego.trigger_range_m", f"{range_m!r}", allowed)
        return max(0.0, self.max_range_m - range_m)


def read_site(net_path: Path) -> Site:
    """Read a network built by `harness.network.build.build_network`.

    The crosswalk's own shape, not the junction's node, sets x = 0 and y; the ego's lane, the
    longest line there is, sets the direction.

    Raises:
        InputError: the file is missing, is no XML, or holds no site of this package.
    """
    try:
        root = ET.parse(net_path).getroot()
        return _site(root)
    except OSError as error:
        raise InputError(str(net_path), f"cannot be read ({error.strerror})") from error
    except (ET.ParseError, KeyError, ValueError) as error:
        allowed = "a network made by `harness network`"
        raise InputError(str(net_path), f"no crosswalk site ({error})", allowed) from error


def projection(latitude_deg: float, longitude_deg: float) -> str:
    """The projection with its origin at a place, as a PROJ string."""
    return (
        f"+proj=tmerc +lat_0={latitude_deg:.9f} +lon_0={longitude_deg:.9f}"
        " +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
    )


def offset_deg(latitude_deg: float, x_m: float, y_m: float) -> tuple[float, float]:
    """Longitude and latitude of a point of the network, less those of its origin.

    The inverse transverse Mercator projection on the WGS84 ellipsoid: Snyder (1987), Map
    Projections, USGS Professional Paper 1395, eq. 8-17, 8-18 and 8-21 to 8-25, without the terms
    in D⁵ and D⁶. The footpoint's latitude comes not from the series of eq. 3-26 but from y as an
    arc of the meridian, its radius of curvature taken halfway. Within 5e-9 m of PROJ up to 400 m
    away.

    Args:
        latitude_deg: of the origin, −85 to 85.
        x_m: east of the origin, m, at most 400.
        y_m: north of the origin, m, at most 400.

    Returns:
        Degrees east and degrees north of the origin.
    """
    latitude = math.radians(latitude_deg)
    arc = 0.0
    for _ in range(4):  # each gains five digits or more
        arc = y_m / _curvature_radii(latitude + arc / 2)[0]
    footpoint = latitude + arc
    meridian, normal = _curvature_radii(footpoint)
    t = math.tan(footpoint) ** 2
    c = _SECOND_E2 * math.cos(footpoint) ** 2
    d = x_m / normal
    series = d**2 / 2 - (5 + 3 * t + 10 * c - 4 * c**2 - 9 * _SECOND_E2) * d**4 / 24
    north = arc - normal * math.tan(footpoint) / meridian * series
    east = (d - (1 + 2 * t + c) * d**3 / 6) / math.cos(footpoint)
    return math.degrees(east), math.degrees(north)


def _curvature_radii(latitude: float) -> tuple[float, float]:
    """Radii of curvature, m, in the meridian (Snyder eq. 8-24) and across it (8-23)."""
    bulge = 1 - _E2 * math.sin(latitude) ** 2
    return _AXIS_M * (1 - _E2) / bulge**1.5, _AXIS_M / math.sqrt(bulge)


def _site(root: ET.Element) -> Site:
    """The numbers of a site from its network; KeyError or ValueError if it is none."""
    lanes = {lane.attrib["id"]: lane for lane in root.iter("lane")}
    crossings = [edge for edge in root.iter("edge") if edge.get("function") == "crossing"]
    if len(crossings) != 1:
        raise ValueError(f"{len(crossings)} crossings")
    crossing_id = crossings[0].attrib["id"]
    crossing = lanes[f"{crossing_id}_0"]
    start, stop = _line(lanes["approach_0"])
    exit_start, exit_end = _line(lanes["exit_0"])
    direction = exit_end - start
    along = direction / abs(direction)
    # netconvert draws a crossing in either direction; y grows to the left of the ego.
    kerbs = sorted(_line(crossing), key=lambda point: (point * along.conjugate()).imag)
    walk = (kerbs[1] - kerbs[0]) * along.conjugate()
    if abs(walk.real) > TOLERANCE_M:
        raise ValueError("the crosswalk is not perpendicular to the road")
    centre = (kerbs[0] + kerbs[1]) / 2
    origin = centre - along * 1j * walk.imag / 2
    ego = [(point - origin) * along.conjugate() for point in (start, stop, exit_start, exit_end)]
    if max(point.imag for point in ego) - min(point.imag for point in ego) > TOLERANCE_M:
        raise ValueError("the ego's lane is not straight")
    latitude, longitude = _projection_centre(root)
    near_length = float(lanes["near_0"].attrib["length"])
    return Site(
        latitude_deg=latitude,
        longitude_deg=longitude,
        bearing_deg=math.degrees(math.atan2(along.real, along.imag)) % 360.0,
        length_m=walk.imag,
        width_m=float(crossing.attrib["width"]),
        lane_centre_m=sum(point.imag for point in ego) / len(ego),
        approach_edge="approach",
        exit_edge="exit",
        near_edge="near",
        far_edge="far",
        crossing_edge=crossing_id,
        near_length_m=near_length,
        near_position_m=near_length - 1.0,
        far_position_m=1.0,
        max_range_m=-ego[0].real,
        min_range_m=-ego[1].real,
        origin_x_m=origin.real,
        origin_y_m=origin.imag,
        along_x=along.real,
        along_y=along.imag,
    )


def _line(lane: ET.Element) -> tuple[complex, complex]:
    """Both ends of a straight lane as complex numbers, east + i north."""
    points = [complex(*map(float, point.split(","))) for point in lane.attrib["shape"].split()]
    if len(points) != 2:
        raise ValueError(f"lane {lane.attrib['id']} is not straight")
    return points[0], points[1]


def _projection_centre(root: ET.Element) -> tuple[float, float]:
    """Latitude and longitude of the projection's origin, which is the network's (0, 0)."""
    location = next(root.iter("location")).attrib
    words = dict(word.partition("=")[::2] for word in location["projParameter"].split())
    offset = [float(number) for number in location["netOffset"].split(",")]
    if words["+proj"] != "tmerc" or any(offset):
        raise ValueError("its projection is not centred on the crosswalk")
    return float(words["+lat_0"]), float(words["+lon_0"])
