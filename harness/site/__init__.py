"""A SUMO network in; the geometry of the crosswalks on it out."""

from harness.site.road_network import RoadNetwork, read_network
from harness.site.site import Place, RoadFrame, Site, Way, read_site

__all__ = [
    "Place",
    "RoadFrame",
    "RoadNetwork",
    "Site",
    "Way",
    "read_network",
    "read_site",
]
