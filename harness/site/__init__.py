"""A SUMO network in; the geometry of the crosswalks on it out."""

from harness.site.locate import Place, read_site
from harness.site.road_network import RoadNetwork, read_network
from harness.site.site import RoadFrame, Site, Way

__all__ = [
    "Place",
    "RoadFrame",
    "RoadNetwork",
    "Site",
    "Way",
    "read_network",
    "read_site",
]
