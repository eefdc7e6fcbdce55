"""Crosswalk geometry → SUMO plain XML → network.

A site is one straight two-lane road with one unsignalized crosswalk across it. Its sources place
the nodes in longitude and latitude; netconvert lays them out in the projection of `harness.site`,
whose origin is the crosswalk's centre. `harness.site` reads the network back.
"""

import hashlib
import math
import os
import re
import subprocess
import tempfile
from dataclasses import dataclass
from decimal import Decimal
from importlib import metadata
from pathlib import Path

from harness.errors import EngineError, InputError
from harness.site import TOLERANCE_M, offset_deg, projection, read_site

APPROACH_M = 300.0
"""Road before the crosswalk's centre line: the largest trigger range a site offers."""
EXIT_M = 120.0
"""Road after the crosswalk's centre line."""
FOOTPATH_M = 10.0
"""From a kerb to the outer end of its footpath."""

CACHE_VARIABLE = "CROSSWALK_HARNESS_CACHE"

_BOUNDS = {
    # Nearer to a pole the bearing of a straight road would change along it.
    "latitude_deg": (-85.0, 85.0),
    "longitude_deg": (-180.0, 180.0),
    "bearing_deg": (0.0, 360.0),
    # Two lanes; narrower than 2 m each they would not hold a car.
    "length_m": (4.0, 40.0),
    "width_m": (1.0, 20.0),
}
_TOLERANCE_DEG = 1e-5
_NETCONVERT_LIMIT_S = 120.0


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


@dataclass(frozen=True)
class NetworkFiles:
    """The files of one built network: SUMO's network and the plain-XML sources it came from."""

    net: Path
    sources: tuple[Path, ...]


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


def build_network(geometry: CrossingGeometry, directory: Path, name: str) -> NetworkFiles:
    """Write a site's sources into a folder and let netconvert make its network there.

    The same arguments give the same bytes: netconvert's header, which holds the date and the
    machine's paths, is taken out. Every file appears complete or not at all, the network last.

    Args:
        geometry: the crosswalk.
        directory: the folder; made if missing.
        name: stem of the files' names.

    Raises:
        InputError: a bad name, or a folder that cannot be written.
        EngineError: netconvert is missing, failed, or built another geometry than asked for.
    """
    sources = plain_sources(geometry, name)
    net_name = f"{name}.net.xml"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(
            prefix=f".{name}-", dir=directory, ignore_cleanup_errors=True
        ) as folder:
            workshop = Path(folder)
            for file_name, text in sources.items():
                (workshop / file_name).write_bytes(text.encode())
            _netconvert(workshop, f"{name}.netccfg", net_name)
            _check(workshop / net_name, geometry)
            for file_name in (*sources, net_name):
                (workshop / file_name).replace(directory / file_name)
    except OSError as error:
        raise InputError(str(directory), f"cannot be written ({error.strerror})") from error
    return NetworkFiles(directory / net_name, tuple(directory / file for file in sources))


def network_for(geometry: CrossingGeometry, shipped_dir: Path) -> Path:
    """The network of a geometry: the shipped one, one built earlier, or one built now.

    The shipped network is taken if its sources are, character for character, those this geometry
    gives. Any other network is kept in ``$CROSSWALK_HARNESS_CACHE``, else
    ``$XDG_CACHE_HOME/crosswalk-harness/networks``, else ``~/.cache/crosswalk-harness/networks``,
    under a hash of its sources and of netconvert's version. Processes may build at the same time.

    Args:
        geometry: the crosswalk.
        shipped_dir: the shipped site's folder; its name is the stem of its files' names.

    Returns:
        Path of the ``.net.xml``.

    Raises:
        InputError: the cache folder cannot be written.
        EngineError: see `build_network`.
    """
    shipped = plain_sources(geometry, shipped_dir.name)
    net = shipped_dir / f"{shipped_dir.name}.net.xml"
    if net.is_file() and all(_text(shipped_dir / file) == text for file, text in shipped.items()):
        return net
    digest = hashlib.sha256(_netconvert_version().encode())
    for file_name, text in sorted(plain_sources(geometry, "site").items()):
        digest.update(f"\0{file_name}\0{text}".encode())
    directory = _cache_dir() / digest.hexdigest()[:24]
    net = directory / "site.net.xml"
    if net.is_file():  # it is put in place last, hence everything is there
        return net
    return build_network(geometry, directory, "site").net


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


def _netconvert(directory: Path, configuration: str, net_name: str) -> None:
    """Run netconvert on a configuration and take the comments out of its network."""
    try:
        import sumo
    except ImportError as error:
        raise EngineError("netconvert: not found; install eclipse-sumo") from error
    suffix = ".exe" if os.name == "nt" else ""
    program = Path(sumo.SUMO_HOME) / "bin" / f"netconvert{suffix}"
    try:
        done = subprocess.run(
            [str(program), "-c", configuration],
            cwd=directory,
            env={**os.environ, "SUMO_HOME": str(sumo.SUMO_HOME)},
            capture_output=True,
            text=True,
            timeout=_NETCONVERT_LIMIT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise EngineError(f"netconvert: {' '.join(str(error).split())}") from error
    net = directory / net_name
    if done.returncode != 0 or not net.is_file():
        words = [line for line in done.stderr.splitlines() if line.strip()]
        reason = "; ".join(words) or f"exit code {done.returncode}"
        raise EngineError(f"netconvert: {' '.join(reason.split())}")
    text = re.sub(r"<!--.*?-->\s*", "", net.read_text(encoding="utf-8"), flags=re.DOTALL)
    net.write_bytes(text.encode())


def _netconvert_version() -> str:
    try:
        return metadata.version("eclipse-sumo")
    except metadata.PackageNotFoundError as error:
        raise EngineError("netconvert: not found; install eclipse-sumo") from error


def _check(net: Path, geometry: CrossingGeometry) -> None:
    """Raise unless netconvert built the geometry asked for."""
    try:
        site = read_site(net)
    except InputError as error:  # no fault of the user, who has not seen this file
        raise EngineError(f"netconvert: {error.problem} for {geometry}") from error
    turn = (site.bearing_deg - geometry.bearing_deg + 180.0) % 360.0 - 180.0
    errors = {
        "length_m": abs(site.length_m - geometry.length_m) / TOLERANCE_M,
        "width_m": abs(site.width_m - geometry.width_m) / TOLERANCE_M,
        "lane centre": abs(site.lane_centre_m - geometry.length_m / 4) / TOLERANCE_M,
        "bearing_deg": abs(turn) / _TOLERANCE_DEG,
        "max_range_m": abs(site.max_range_m - APPROACH_M) / TOLERANCE_M,
    }
    wrong = [what for what, error in errors.items() if not error <= 1.0]
    if wrong:
        raise EngineError(f"netconvert: the network differs in {', '.join(wrong)} from {geometry}")


def _cache_dir() -> Path:
    """The folder of built networks; environment variables that are empty do not count."""
    own = os.environ.get(CACHE_VARIABLE)
    if own:
        return Path(own).expanduser()
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "crosswalk-harness" / "networks"


def _text(path: Path) -> str | None:
    """A file's text, None if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None
