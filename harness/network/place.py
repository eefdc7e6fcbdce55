"""From a scenario to its place: geometry and SUMO network."""

from pathlib import Path

from harness.network.build import network_for
from harness.network.sources import CrossingGeometry
from harness.resources import shipped_directory
from harness.scenario import Scenario


def geometry_of(scenario: Scenario) -> CrossingGeometry:
    """The crosswalk a scenario takes place at."""
    return CrossingGeometry(**scenario.crossing.model_dump())


def network_of(scenario: Scenario) -> Path:
    """The SUMO network of a scenario: a shipped one, or built into the cache."""
    return network_for(geometry_of(scenario), shipped_directory("networks"))
