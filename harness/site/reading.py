"""A crosswalk's site read from the file of its network."""

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from harness.core.errors import InputError
from harness.site.locate import site_at
from harness.site.road_network import RoadNetwork, read_network
from harness.site.site import Site

GENERATED_CROSSING = ":crosswalk_c0"
"""The crossing of a network that is built from a scenario's own geometry."""

_AHEAD_M = 50.0
"""The ego's bearing is that of its road so far before and after the crosswalk."""


@dataclass(frozen=True, slots=True)
class Place:
    """Which crosswalk of which network, and which lane the ego comes by.

    ``approach`` None: the lane of number ``lane`` of the road that leads to it, counted from the
    near kerb.
    """

    net: Path
    edge: str = GENERATED_CROSSING
    approach: str | None = None
    lane: int = 0


class Whereabouts(NamedTuple):
    """A crosswalk's centre (WGS84) and the ego's direction clockwise from true north."""

    longitude_deg: float
    latitude_deg: float
    bearing_deg: float


@dataclass(frozen=True, slots=True)
class Survey:
    """A site with the network's hash and, where it has a projection, its place on the ground."""

    site: Site
    sha256: str
    where: Whereabouts | None


def read_site(place: Place) -> Site:
    """The site of a place.

    Raises:
        InputError: see ``read_network`` and ``site_at``.
    """
    return _site_of(read_network(place.net), place)


def survey(place: Place) -> Survey:
    """The site of a place with what identifies its network; read once while the file is the same.

    Raises:
        InputError: see ``read_network`` and ``site_at``.
    """
    return _survey(place, _state(place.net))


def sha256_of(net: Path) -> str:
    """The hash of a network's file; worked out once while the file is the same."""
    return _sha256(net, _state(net))


def _state(net: Path) -> tuple[int, int]:
    try:
        state = net.stat()
    except (OSError, ValueError):
        raise InputError(str(net), "no such network", "a SUMO network (.net.xml)") from None
    return state.st_mtime_ns, state.st_size


@lru_cache(maxsize=256)
def _survey(place: Place, state: tuple[int, int]) -> Survey:
    network = read_network(place.net)
    site = _site_of(network, place)
    return Survey(site, _sha256(place.net, state), _whereabouts(network, site))


def _whereabouts(network: RoadNetwork, site: Site) -> Whereabouts | None:
    from pyproj import Geod

    centre, before, after = (
        network.on_the_ground(*site.frame.to_network(x_m, y_m))
        for x_m, y_m in (
            (0.0, site.length_m / 2),
            (-_AHEAD_M, site.ego.centre_m),
            (_AHEAD_M, site.ego.centre_m),
        )
    )
    if centre is None or before is None or after is None:
        return None
    bearing_deg, _, _ = Geod(ellps="WGS84").inv(*before, *after)
    return Whereabouts(*centre, float(bearing_deg) % 360.0)


@lru_cache(maxsize=64)
def _sha256(net: Path, state: tuple[int, int]) -> str:  # noqa: ARG001  # the cache's key
    try:
        with net.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(str(net), f"cannot be read ({error.strerror})") from None


def _site_of(network: RoadNetwork, place: Place) -> Site:
    try:
        return site_at(network, place.edge, place.approach, lane=place.lane)
    except InputError as error:
        problem = f"{error.where}: {error.problem}"
        raise InputError(place.net.name, problem, error.allowed, error.nearest) from None
