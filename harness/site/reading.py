"""A network's file and a crossing in; the site and its place on the ground out."""

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
"""The ego's bearing is measured between points this far before and after the crosswalk."""


@dataclass(frozen=True, slots=True)
class Place:
    """A crosswalk in a network, and the ego's lane.

    If ``approach`` is None, the ego is on lane number ``lane`` of the road that leads over the
    crosswalk, counted from the near kerb.
    """

    net: Path
    edge: str = GENERATED_CROSSING
    approach: str | None = None
    lane: int = 0


class Whereabouts(NamedTuple):
    """The crosswalk's centre (WGS84) and the ego's bearing, clockwise from true north."""

    longitude_deg: float
    latitude_deg: float
    bearing_deg: float


@dataclass(frozen=True, slots=True)
class Survey:
    """A site with its network's hash, and its place on the ground if the network is projected."""

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
    """The site of a place with its network's hash; cached until the file changes.

    Raises:
        InputError: see ``read_network`` and ``site_at``.
    """
    return _survey(place, _state(place.net))


def sha256_of(net: Path) -> str:
    """The hash of a network's file; cached until the file changes."""
    return _sha256(net, _state(net))


def _state(net: Path) -> tuple[int, int]:
    try:
        state = net.stat()
    except (OSError, ValueError):
        raise InputError(
            str(net), "the network does not exist", "a SUMO network (.net.xml)"
        ) from None
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
