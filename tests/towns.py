"""Small SUMO scenarios, as users have them: built with netgenerate, netconvert and randomTrips."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import sumo

TOOLS = Path(sumo.SUMO_HOME) / "tools"
COLLISIONS = {
    "collision.check-junctions": "true",
    "collision.mingap-factor": "0",
    "collision.action": "warn",
}
"""Every touch counts, and nobody is taken off the road for it."""

_WALKABLE = ("--sidewalks.guess", "--crossings.guess", "--no-turnarounds")


def call(folder: Path, program: str, *arguments: str) -> None:
    """Run one of SUMO's programs in a folder."""
    environment = {**os.environ, "SUMO_HOME": sumo.SUMO_HOME}
    command = [str(Path(sys.executable).parent / program), *arguments]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, f"{program}: {done.stderr[-2000:]}"


def random_trips(folder: Path, net: Path, out: str, period_s: float, *more: str) -> None:
    """Write a file of trips that randomTrips.py draws."""
    script = str(TOOLS / "randomTrips.py")
    common = ("-n", str(net), "-p", str(period_s), "--seed", "5", "-o", out)
    call(folder, "python", script, *common, *more)


def write_config(folder: Path, options: Mapping[str, str], name: str = "town.sumocfg") -> Path:
    """Write a configuration with these options."""
    lines = "".join(f'<{key} value="{value}"/>' for key, value in options.items())
    path = folder / name
    path.write_text(f"<configuration>{lines}</configuration>")
    return path


def grid(folder: Path, end_s: int = 300, **options: str) -> Path:
    """Four by four junctions with people on every sidewalk; a light at two junctions."""
    arguments = ("--grid", "--grid.number", "4", "--grid.length", "100", "--tls.set", "C2,D1")
    call(folder, "netgenerate", *arguments, *_WALKABLE, "-j", "priority", "-o", "net.net.xml")
    return _with_demand(folder, end_s, 1.0, 0.8, **options)


def main_road(folder: Path, end_s: int = 300, **options: str) -> Path:
    """A main road of two lanes each way, with side streets and crosswalks over it."""
    places = {"w": (0, 0), "a": (200, 0), "b": (400, 0), "c": (600, 0), "e": (800, 0)}
    sides = {"an": (200, 150), "bs": (400, -150), "cn": (600, 150), "cs": (600, -150)}
    nodes = "".join(
        f'<node id="{name}" x="{x}" y="{y}" type="priority"/>'
        for name, (x, y) in {**places, **sides}.items()
    )
    edges = ""
    main = [("w", "a"), ("a", "b"), ("b", "c"), ("c", "e")]
    side = [("an", "a"), ("bs", "b"), ("cn", "c"), ("cs", "c")]
    for roads, lanes, priority, speed in ((main, 2, 3, 13.89), (side, 1, 1, 8.33)):
        for start, end in roads:
            for one, other in ((start, end), (end, start)):
                edges += (
                    f'<edge id="{one}_{other}" from="{one}" to="{other}" numLanes="{lanes}" '
                    f'priority="{priority}" speed="{speed}" sidewalkWidth="2"/>'
                )
    (folder / "n.nod.xml").write_text(f"<nodes>{nodes}</nodes>")
    (folder / "e.edg.xml").write_text(f"<edges>{edges}</edges>")
    files = ("-n", "n.nod.xml", "-e", "e.edg.xml", "-o", "net.net.xml")
    call(folder, "netconvert", *files, "--crossings.guess", "--no-turnarounds")
    return _with_demand(folder, end_s, 1.5, 2.0, **options)


def bus_street(folder: Path, end_s: int = 300, **options: str) -> Path:
    """A street as OpenStreetMap has it, with a zebra crossing, bus stops and a bus line."""
    call(
        folder,
        "netconvert",
        *("--osm-files", str(Path(__file__).parent / "data/town/street.osm"), "-o", "net.net.xml"),
        *("--osm.crossings", "--sidewalks.guess", "--no-turnarounds", "--keep-edges.by-vclass"),
        *("passenger,bus,pedestrian", "--junctions.corner-detail", "5"),
    )
    return _with_demand(folder, end_s, 2.0, 2.5, **options)


def _with_demand(
    folder: Path, end_s: int, vehicles_s: float, people_s: float, **options: str
) -> Path:
    net = folder / "net.net.xml"
    until = ("-e", str(end_s), "--validate")
    random_trips(folder, net, "vehicles.trips.xml", vehicles_s, *until, "--min-distance", "150")
    random_trips(folder, net, "people.trips.xml", people_s, "-e", str(end_s), "--pedestrians")
    return write_config(
        folder,
        {
            "net-file": "net.net.xml",
            "route-files": "vehicles.trips.xml,people.trips.xml",
            "end": str(end_s),
            "step-length": "0.1",
            **COLLISIONS,
            **{name.replace("_", "-"): value for name, value in options.items()},
        },
    )
