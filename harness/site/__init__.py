"""A SUMO network in; the geometry of the crosswalks on it out."""

from harness.site.crosswalks import Crosswalk, WayOver, crosswalks_of
from harness.site.locate import Place, read_site
from harness.site.road_network import RoadNetwork, read_network
from harness.site.site import RoadFrame, Site, Way

__all__ = [
    "Crosswalk",
    "Place",
    "RoadFrame",
    "RoadNetwork",
    "Site",
    "Way",
    "WayOver",
    "crosswalks_of",
    "read_network",
    "read_site",
]
