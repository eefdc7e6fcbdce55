"""A SUMO network as records: edges, lanes, connections, as its file says and no more.

The file is read once and as a stream, for a city's network of hundreds of megabytes too; its
numbers stay text until somebody needs them.
"""

import gzip
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from harness.errors import InputError

_CHUNK_BYTES = 1 << 20
_MOST_BYTES = 1 << 30
"""Memory is up to seven times that; a packed file of a megabyte may unpack to a gigabyte."""


class Lane(NamedTuple):
    """One lane of an edge."""

    id: str
    edge: str
    number: str
    length: str
    speed: str
    width: str
    shape: str
    allow: str
    disallow: str

    def allows(self, vehicle_class: str) -> bool:
        """Whether a vehicle class may use it."""
        if self.allow:
            return vehicle_class in (words := self.allow.split()) or "all" in words
        return vehicle_class not in (words := self.disallow.split()) and "all" not in words

    @property
    def length_m(self) -> float:
        """Its length as SUMO counts it, which may differ from that of its shape."""
        return _number(self.length, f"the length of lane {self.id}")

    @property
    def width_m(self) -> float:
        """Its width; SUMO's default is 3.2 m."""
        return _number(self.width, f"the width of lane {self.id}") if self.width else 3.2

    @property
    def speed_mps(self) -> float:
        """Its speed limit."""
        return _number(self.speed, f"the speed of lane {self.id}")

    @property
    def line(self) -> "Line":
        """Its centre line."""
        return _line(self)


class Line(NamedTuple):
    """A lane's centre line: at least two points, east + i north, and its length as drawn.

    Where two edges meet without a gap, the lane between them is drawn 0 m long.
    """

    points: tuple[complex, ...]
    drawn_m: float


@lru_cache(maxsize=4096)
def _line(lane: Lane) -> Line:
    what = f"the shape of lane {lane.id}"
    pairs = [point.split(",") for point in lane.shape.split()]
    if len(pairs) < 2 or min(map(len, pairs)) < 2:
        raise ValueError(f"{what} is {lane.shape[:40]!r}")
    points = tuple(complex(_number(pair[0], what), _number(pair[1], what)) for pair in pairs)
    return Line(points, sum(abs(b - a) for a, b in pairwise(points)))


class Edge(NamedTuple):
    """An edge of any function; ``crossed`` are the roads that a crossing leads over."""

    id: str
    function: str
    start: str
    end: str
    name: str
    crossed: tuple[str, ...]
    lanes: list[Lane]


class Link(NamedTuple):
    """A connection between two lanes, by way of an internal lane or of none."""

    start: str
    end: str
    via: str
    state: str
    signal: str
    signal_index: str


@dataclass(frozen=True)
class RoadNetwork:
    """Everything of a network that a crosswalk's place and surroundings follow from.

    ``into`` are the roads that end at a junction; ``onward`` and ``backward`` are the connections
    from a lane and to it.
    """

    edges: dict[str, Edge] = field(default_factory=dict)
    lanes: dict[str, Lane] = field(default_factory=dict)
    into: dict[str, list[Edge]] = field(default_factory=dict)
    onward: dict[str, list[Link]] = field(default_factory=dict)
    backward: dict[str, list[Link]] = field(default_factory=dict)
    location: dict[str, str] = field(default_factory=dict)
    header: dict[str, str] = field(default_factory=dict)

    @property
    def left_hand(self) -> bool:
        """Whether its traffic keeps left."""
        return self.header.get("lefthand") in ("true", "1")

    @cached_property
    def crossings_over(self) -> dict[str, list[Edge]]:
        """The pedestrian crossings over each road, by the road's id."""
        over: dict[str, list[Edge]] = {}
        for crossing in self.crossings():
            for road in crossing.crossed:
                over.setdefault(road, []).append(crossing)
        return over

    def crossings(self) -> list[Edge]:
        """Its pedestrian crossings, in the file's order."""
        return [edge for edge in self.edges.values() if edge.function == "crossing"]


def junction_of(crossing: str) -> str:
    """The junction of a crossing, which SUMO names ``:<junction>_c<number>``."""
    return crossing[1:].rpartition("_c")[0]


def read_network(path: Path) -> RoadNetwork:
    """Read a SUMO network, packed by gzip or not.

    Raises:
        InputError: the file cannot be read, is cut off or no XML, or is no SUMO network.
    """
    reader = _Reader()
    parser = ET.XMLParser(target=reader)
    try:
        for chunk in _chunks(path):
            parser.feed(chunk)
        parser.close()
    except FileNotFoundError:
        raise InputError(str(path), "no such network", "a SUMO network (.net.xml)") from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(str(path), f"cannot be read ({reason})") from None
    except (ET.ParseError, EOFError, zlib.error) as error:
        raise InputError(str(path), f"cut off, or no XML ({error})", "a SUMO network") from None
    except (LookupError, ValueError) as error:  # an unknown encoding, a missing attribute
        raise InputError(str(path), f"no SUMO network ({error})", "a .net.xml file") from None
    return reader.network


def _chunks(path: Path) -> Iterator[bytes]:
    packed = path.name.endswith(".gz")
    with gzip.open(path) if packed else path.open("rb") as file:
        read = 0
        while chunk := file.read(_CHUNK_BYTES):
            read += len(chunk)
            if read > _MOST_BYTES:
                allowed = "a part of it: netconvert --keep-edges.in-boundary"
                raise InputError(str(path), f"more than {_MOST_BYTES >> 20} MB unpacked", allowed)
            yield chunk


def _number(text: str, what: str) -> float:
    number = float(text) if text else 0.0
    if not abs(number) < 1e9:
        raise ValueError(f"{what} is {text}")
    return number


class _Reader:
    """Receives the elements of a network's file as the parser meets them."""

    def __init__(self) -> None:
        self.network = RoadNetwork()
        self._edge: Edge | None = None
        self._root = True

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """One element begins."""
        if self._root:
            if tag != "net":
                raise ValueError(f"its first element is <{tag[:40]}>, not <net>")
            self._root = False
            self.network.header.update(attributes)
        elif tag == "lane":
            self._add_lane(attributes)
        elif tag == "connection":
            self._add_link(attributes)
        elif tag == "edge":
            if not self.network.location:
                raise ValueError("no <location> before its first edge; netconvert -s writes one")
            get = attributes.get
            crossed = tuple(get("crossingEdges", "").split())
            names = (get("function", "normal"), get("from", ""), get("to", ""), get("name", ""))
            self._edge = Edge(attributes["id"], *names, crossed, [])
            self.network.edges[self._edge.id] = self._edge
            if self._edge.function == "normal":
                self.network.into.setdefault(self._edge.end, []).append(self._edge)
        elif tag == "location":
            self.network.location.update(attributes)

    def end(self, tag: str) -> None:
        """One element ends."""

    def close(self) -> None:
        """The file ends."""

    def _add_lane(self, attributes: dict[str, str]) -> None:
        edge = self._edge
        if edge is None:
            raise ValueError("a lane outside every edge")
        get = attributes.get
        shape, limits = attributes["shape"], (get("allow", ""), get("disallow", ""))
        sizes = (attributes["length"], attributes["speed"], get("width", ""))
        lane = Lane(attributes["id"], edge.id, attributes["index"], *sizes, shape, *limits)
        edge.lanes.append(lane)
        self.network.lanes[lane.id] = lane

    def _add_link(self, attributes: dict[str, str]) -> None:
        get = attributes.get
        start, end = (
            f"{attributes[edge]}_{attributes[lane]}"
            for edge, lane in (("from", "fromLane"), ("to", "toLane"))
        )
        signal = (get("tl", ""), get("linkIndex", ""))
        link = Link(start, end, get("via", ""), get("state", ""), *signal)
        self.network.onward.setdefault(start, []).append(link)
        self.network.backward.setdefault(end, []).append(link)
