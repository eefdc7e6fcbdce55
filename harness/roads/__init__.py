"""Roads of any SUMO network: what its file says, and a crosswalk's site in it."""

from harness.roads.locate import site_at
from harness.roads.reading import GENERATED_CROSSING, Place, Survey, read_site, survey
from harness.roads.road_network import RoadNetwork, read_network
from harness.roads.site import RoadFrame, Site, Way
from harness.roads.streams import Stream, streams_of

__all__ = [
    "GENERATED_CROSSING",
    "Place",
    "RoadFrame",
    "RoadNetwork",
    "Site",
    "Stream",
    "Survey",
    "Way",
    "read_network",
    "read_site",
    "site_at",
    "streams_of",
    "survey",
]
