"""Small SUMO scenarios, as users have them: built with netgenerate, netconvert and randomTrips."""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from random import Random
from xml.etree import ElementTree

import sumo

TOOLS = Path(sumo.SUMO_HOME) / "tools"
COLLISIONS = {
    "collision.check-junctions": "true",
    "collision.mingap-factor": "0",
    "collision.action": "warn",
}
"""Every touch counts, and nobody is taken off the road for it."""

_WALKABLE = ("--sidewalks.guess", "--crossings.guess")


def call(folder: Path, program: str, *arguments: str) -> str:
    """Run one of SUMO's programs in a folder; what it says on standard error."""
    environment = {**os.environ, "SUMO_HOME": sumo.SUMO_HOME}
    command = [str(Path(sys.executable).parent / program), *arguments]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, f"{program}: {done.stderr[-2000:]}"
    return done.stderr


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


def _built_once(build: Callable[..., Path]) -> Callable[..., Path]:
    """A town is built once in a process, by its arguments, and copied from then on."""

    @cache
    def built(*arguments: int, **options: str) -> tuple[Path, "tempfile.TemporaryDirectory[str]"]:
        kept = tempfile.TemporaryDirectory()
        return build(Path(kept.name), *arguments, **options), kept

    def copied(folder: Path, *arguments: int, **options: str) -> Path:
        config, _ = built(*arguments, **options)
        shutil.copytree(config.parent, folder, dirs_exist_ok=True)
        return folder / config.name

    return copied


@_built_once
def grid(folder: Path, end_s: int = 300, lanes: int = 1, **options: str) -> Path:
    """Four by four junctions with people on every sidewalk; a light at two junctions."""
    arguments = ("--grid", "--grid.number", "4", "--grid.length", "100", "--tls.set", "C2,D1")
    arguments = (*arguments, *_WALKABLE, "--no-turnarounds", "-j", "priority", "-L", str(lanes))
    call(folder, "netgenerate", *arguments, "-o", "net.net.xml")
    return with_demand(folder, end_s, 1.0, 0.8, **options)


def with_demand(
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
            **options,
        },
    )


@_built_once
def town(folder: Path, seed: int, end_s: int = 300, kind: str = "", **options: str) -> Path:
    """A random town with sidewalks, crosswalks, cars and trucks of 12 m; people if asked for.

    ``kind`` is empty or one of: lanes (up to three lanes), left (a left-hand country, two lanes),
    stretched (edges 0.6 to 2.5 times as long as they are drawn), zebras (people have priority).
    """
    more = {"lanes": ("--rand.random-lanenumber", "-L", "3"), "left": ("--lefthand", "-L", "2")}
    rand = ("--rand", "--rand.iterations", "80", "--seed", str(seed), "-j", "priority")
    call(folder, "netgenerate", *rand, *_WALKABLE, *more.get(kind, ()), "-o", "net.net.xml")
    if kind in ("stretched", "zebras"):
        call(folder, "netconvert", "-s", "net.net.xml", "--plain-output-prefix", "plain")
        edges, random = ElementTree.parse(folder / "plain.edg.xml"), Random(seed)
        nodes = {
            node.get("id"): complex(float(node.get("x", "")), float(node.get("y", "")))
            for node in ElementTree.parse(folder / "plain.nod.xml").iter("node")
        }
        crossings = ElementTree.parse(folder / "plain.con.xml")
        for edge in edges.iter("edge") if kind == "stretched" else ():
            apart_m = abs(nodes[edge.get("to")] - nodes[edge.get("from")])
            edge.set("length", f"{apart_m * random.uniform(0.6, 2.5):.2f}")
        for crossing in crossings.iter("crossing") if kind == "zebras" else ():
            crossing.set("priority", "1")
        edges.write(folder / "plain.edg.xml")
        crossings.write(folder / "plain.con.xml")
        files = ("-n", "plain.nod.xml", "-e", "plain.edg.xml", "-x", "plain.con.xml")
        call(folder, "netconvert", *files, "-o", "net.net.xml")
    additional = {"additional-files": "lorries.add.xml", **options}
    config = with_demand(folder, end_s, 1.0, 2.0, **additional)
    lorry = '<vType id="lorry" vClass="truck" length="12" width="2.5"/>'
    (folder / "lorries.add.xml").write_text(f"<additional>{lorry}</additional>")
    trips = folder / "vehicles.trips.xml"
    cars = trips.read_text().split("<trip ")
    every = (f'type="lorry" {each}' if n % 6 == 5 else each for n, each in enumerate(cars))
    trips.write_text("<trip ".join(every))
    return config
