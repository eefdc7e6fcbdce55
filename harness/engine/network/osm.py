"""An OpenStreetMap extract in; a SUMO network with the map's crossings out."""

import gzip
import os
import shlex
import xml.etree.ElementTree as ET
import zlib
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

from harness.core.errors import InputError
from harness.engine.network.build import run_netconvert
from harness.site import RoadNetwork, read_network
from harness.site.road_network import allows, junction_of

if TYPE_CHECKING:
    from sumolib.net.edge import Edge

SUFFIXES = (".osm", ".osm.xml", ".osm.gz", ".osm.xml.gz")

_OPTIONS = (
    "--osm.sidewalks",
    "--osm.crossings",
    "--crossings.guess",
    "--sidewalks.guess",
    "--output.street-names",
    "--precision",
    "6",
)
"""Options with which netconvert builds crossings from all usual tags."""

_PRIORITY = {"marked": True, "zebra": True, "uncontrolled": True, "unmarked": False}


@dataclass(frozen=True)
class Converted:
    """The network of a map, with a remark on each crossing that could not be converted."""

    net: Path
    remarks: tuple[str, ...]


def is_osm(path: Path) -> bool:
    """Whether a file has the suffix of an OpenStreetMap extract."""
    return path.name.endswith(SUFFIXES)


def convert(osm: Path, folder: Path) -> Converted:
    """Convert an extract, and correct the crossings that netconvert builds.

    netconvert builds two crossings at a mid-block node and gives neither of them priority.  A
    second pass keeps one of the two and sets its priority by the node's tags.  The folder also gets
    the intermediate files and ``<name>.commands.sh``, which repeats the conversion.

    Args:
        osm: the extract.
        folder: the output folder; made if missing.

    Raises:
        InputError: the extract or the folder cannot be used.
        EngineError: netconvert failed; repeats its last lines.
    """
    tagged = _crossing_nodes(osm)
    stem = next(osm.name.removesuffix(end) for end in SUFFIXES[::-1] if osm.name.endswith(end))
    first, patch, net = (f"{stem}.{kind}" for kind in ("first.net.xml", "con.xml", "net.xml"))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        source = os.path.relpath(osm, folder)
        commands = [
            ["--osm-files", source, *_OPTIONS, "--output-file", first],
            ["-s", first, "-x", patch, *_OPTIONS[-3:], "--output-file", net],
        ]
        run_netconvert(commands[0], folder)
        text, remarks = _patch(read_network(folder / first), tagged)
        (folder / patch).write_text(text, encoding="utf-8")
        run_netconvert(commands[1], folder)
        script = "".join(f"netconvert {shlex.join(command)}\n" for command in commands)
        (folder / f"{stem}.commands.sh").write_text(script, encoding="utf-8")
    except OSError as error:
        raise InputError(str(folder), f"cannot be written ({error.strerror})") from None
    return Converted(folder / net, tuple(remarks))


def _crossing_nodes(osm: Path) -> dict[str, dict[str, str]]:
    """The tags of every ``highway=crossing`` node, by its id."""
    crossings: dict[str, dict[str, str]] = {}
    try:
        with gzip.open(osm) if osm.name.endswith(".gz") else osm.open("rb") as file:
            for _, element in ET.iterparse(file):
                if element.tag == "node":
                    tags = {tag.get("k", ""): tag.get("v", "") for tag in element.iter("tag")}
                    if tags.get("highway") == "crossing":
                        crossings[element.attrib["id"]] = tags
                if element.tag in ("node", "way", "relation"):
                    element.clear()
    except FileNotFoundError:
        raise InputError(
            str(osm), "the file does not exist", "an OpenStreetMap file (.osm)"
        ) from None
    except (ET.ParseError, EOFError, zlib.error, LookupError, ValueError) as error:
        raise InputError(
            str(osm), f"is incomplete, or is not OpenStreetMap XML ({error})"
        ) from None
    except OSError as error:
        raise InputError(str(osm), f"cannot be read ({error.strerror or error})") from None
    return crossings


def _for_cars(edge: "Edge") -> bool:
    return not edge.isSpecial() and any(allows(lane, "passenger") for lane in edge.getLanes())


def _patch(network: RoadNetwork, tagged: dict[str, dict[str, str]]) -> tuple[str, list[str]]:
    """The connections file that corrects a network's crossings, and remarks on the others."""
    built: dict[str, list[Edge]] = defaultdict(list)
    for crossing in network.crossings.values():
        built[junction_of(crossing)].append(crossing)
    lines, remarks = [], []
    for node, tags in tagged.items():
        if tags.get("crossing") == "island" or tags.get("crossing:island") == "yes":
            remarks.append(f"node {node}: islands are not supported; it becomes one crossing")
        if node not in built:
            remarks.append(f"node {node}: netconvert built no crossing there")
            continue
        kind = tags.get("crossing", "")
        marked = tags.get("crossing:markings", "no") != "no"
        if kind == "traffic_signals":
            remarks.append(f"node {node}: it has a traffic light; see its signal in the list")
            continue
        # netconvert doubles a crossing only mid-block, where at most two road edges end; at a
        # larger junction each crossing is separate.  Footways do not count as roads.
        roads = [edge for edge in network.net.getNode(node).getIncoming() if _for_cars(edge)]
        doubled = len(built[node]) == 2 and len(roads) <= 2
        kept = [] if kind == "no" else built[node][:1] if doubled else built[node]
        for crossing in built[node]:
            crossed = " ".join(edge.getID() for edge in crossing.getCrossingEdges())
            named = f"node={quoteattr(node)} edges={quoteattr(crossed)}"
            if crossing not in kept:
                lines.append(f'    <crossing {named} discard="true"/>')
            elif _PRIORITY.get(kind, marked):
                # netconvert refuses a crossing that changes nothing; it builds none with priority,
                # so setting priority is always a change.
                width = f'width="{crossing.getLane(0).getWidth():g}"'
                lines.append(f'    <crossing {named} priority="true" {width}/>')
    return "\n".join(["<connections>", *lines, "</connections>", ""]), remarks
