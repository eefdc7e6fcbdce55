"""The place: a crosswalk's geometry, its SUMO network, and that network in plain numbers."""

from harness.network.build import NetworkFiles, build_network, network_for
from harness.network.place import geometry_of, network_of
from harness.network.site import Site, read_site
from harness.network.sources import CrossingGeometry, plain_sources

__all__ = [
    "CrossingGeometry",
    "NetworkFiles",
    "Site",
    "build_network",
    "geometry_of",
    "network_for",
    "network_of",
    "plain_sources",
    "read_site",
]
