"""A network's file in; the network out as sumolib reads it, with facts that sumolib leaves out."""

import gzip
import math
import xml.etree.ElementTree as ET
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax import SAXException

from harness.core.errors import InputError

if TYPE_CHECKING:
    from sumolib.net import Net
    from sumolib.net.edge import Edge
    from sumolib.net.lane import Lane

_MOST_BYTES = 1 << 30
"""Largest unpacked size.

sumolib needs eleven times as much memory, and a packed megabyte may unpack to a gigabyte.
"""
_MOST = 1e9
"""Upper limit of every length, width, speed and coordinate of a network."""


@dataclass(frozen=True)
class RoadNetwork:
    """A SUMO network.

    Attributes:
        net: its edges, lanes and connections.
        left_hand: whether traffic keeps left.
    """

    net: "Net"
    left_hand: bool

    @cached_property
    def crossings(self) -> dict[str, "Edge"]:
        """The pedestrian crossings by id, in the order of the file."""
        edges = self.net.getEdges()
        return {edge.getID(): edge for edge in edges if edge.getFunction() == "crossing"}


def allows(lane: "Lane", vehicle_class: str) -> bool:
    """Whether a vehicle class may use a lane; sumolib treats "all" as a class of its own."""
    return not {"all", vehicle_class}.isdisjoint(lane.getPermissions())


def read_network(path: Path) -> RoadNetwork:
    """Read a SUMO network, packed by gzip or not.

    Raises:
        InputError: the file cannot be read, is not complete XML, or is not a SUMO network.
    """
    # This import takes a third of a second, which a scenario without a network does not need.
    import sumolib.net

    try:
        header = _beginning(path)
        net = sumolib.net.readNet(
            path, withPedestrianConnections=True, withFoes=True, lxml=False, maxcache=0
        )
        _check(net)
    except FileNotFoundError:
        raise InputError(
            str(path), "the network does not exist", "a SUMO network (.net.xml)"
        ) from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(str(path), f"cannot be read ({reason})") from None
    except (ET.ParseError, SAXException, EOFError, zlib.error) as error:
        raise InputError(
            str(path), f"is incomplete, or is not XML ({error})", "a SUMO network"
        ) from None
    # sumolib does not check that attributes and references exist.
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise InputError(str(path), f"is not a SUMO network ({error})", "a .net.xml file") from None
    return RoadNetwork(net, header.get("lefthand") in ("true", "1"))


def _beginning(path: Path) -> dict[str, str]:
    """The attributes of the element ``net``, whose location comes before all edges."""
    with path.open("rb") as file:
        packed = file.read(2) == b"\x1f\x8b"
    with gzip.open(path) if packed else path.open("rb") as file:
        file.seek(_MOST_BYTES)
        if file.read(1):
            allowed = "a part of it: netconvert --keep-edges.in-boundary"
            raise InputError(str(path), f"more than {_MOST_BYTES >> 20} MB unpacked", allowed)
        file.seek(0)
        elements = (element for _, element in ET.iterparse(file, ("start",)))
        root = next(elements)
        if root.tag != "net":
            raise ValueError(f"its first element is <{root.tag[:40]}>, not <net>")
        first = next((element for element in elements if element.tag in ("location", "edge")), root)
        if first.tag == "edge":
            raise ValueError("no <location> before its first edge; netconvert -s writes one")
        return dict(root.attrib)


def _check(net: "Net") -> None:
    """Refuse edges without two junctions, and lanes whose shape or size is not valid."""
    for edge in net.getEdges():
        if edge.getFromNode() is None or edge.getToNode() is None:
            raise ValueError(f"edge {edge.getID()} does not join two junctions")
        for lane in edge.getLanes():
            line = lane.getShape()
            numbers = [lane.getLength(), lane.getWidth(), lane.getSpeed()]
            numbers += [coordinate for point in line for coordinate in point]
            if len(line) < 2 or not max(map(abs, numbers)) < _MOST or any(map(math.isnan, numbers)):
                raise ValueError(f"lane {lane.getID()} has an invalid shape or size")
