"""A scenario in; its SUMO network out, which is shipped or built."""

from harness.engine.network.build import (
    build_network,
    network_of,
    opendrive,
    place_of,
)
from harness.engine.network.sources import plain_sources

__all__ = [
    "build_network",
    "network_of",
    "opendrive",
    "place_of",
    "plain_sources",
]
