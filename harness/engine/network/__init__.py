"""A scenario in; its SUMO network out, which is shipped or built."""

from harness.engine.network.build import (
    NetworkFiles,
    build_network,
    network_for,
    network_of,
    place_of,
)
from harness.engine.network.sources import plain_sources

__all__ = [
    "NetworkFiles",
    "build_network",
    "network_for",
    "network_of",
    "place_of",
    "plain_sources",
]
