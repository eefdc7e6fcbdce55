"""A SUMO network in; the geometry of one crosswalk on it out."""

from harness.site.crosswalks import Crosswalk, WayOver, crosswalks_of
from harness.site.locate import site_at
from harness.site.reading import GENERATED_CROSSING, Place, Survey, read_site, survey
from harness.site.road_network import RoadNetwork, read_network
from harness.site.site import RoadFrame, Site, Way
from harness.site.streams import Stream, streams_of

__all__ = [
    "GENERATED_CROSSING",
    "Crosswalk",
    "Place",
    "RoadFrame",
    "RoadNetwork",
    "Site",
    "Stream",
    "Survey",
    "Way",
    "WayOver",
    "crosswalks_of",
    "read_network",
    "read_site",
    "site_at",
    "streams_of",
    "survey",
]
