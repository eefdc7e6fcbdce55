"""A crosswalk's SUMO network: from the scenario's geometry, of the user's own, or from a map."""

from harness.network.build import NetworkFiles, build_network, network_for
from harness.network.place import network_of, place_of
from harness.network.sources import plain_sources

__all__ = [
    "NetworkFiles",
    "build_network",
    "network_for",
    "network_of",
    "place_of",
    "plain_sources",
]
