"""A scenario in; its SUMO network and its crosswalk in that network out."""

from pathlib import Path

from harness.core.errors import InputError
from harness.core.resources import shipped_directory
from harness.engine.network.build import network_for
from harness.scenario import Scenario
from harness.site import Place
from harness.site.reading import sha256_of


def network_of(scenario: Scenario) -> Path:
    """The SUMO network of a scenario: the user's file, a shipped one, or one in the cache.

    Raises:
        InputError: the user's file has changed since the scenario's geometry was read from it.
    """
    crossing = scenario.crossing
    if crossing.net is None:
        return network_for(crossing, shipped_directory("networks"))
    net = Path(crossing.net)
    digest = sha256_of(net)
    if crossing.read is not None and digest != crossing.read.sha256:
        problem = f"{net} has changed (sha256 {digest[:12]}…)"
        raise InputError("crossing.net", problem, f"the file of sha256 {crossing.read.sha256}")
    return net


def check_network(scenario: Scenario) -> None:
    """Build a scenario's network if it is missing, or refuse the scenario; see ``network_of``."""
    network_of(scenario)


def place_of(scenario: Scenario) -> Place:
    """The crosswalk of a scenario in its SUMO network.

    Raises:
        InputError: see ``network_of``.
    """
    crossing, net = scenario.crossing, network_of(scenario)
    if crossing.net is None or crossing.edge is None:
        return Place(net, lane=scenario.ego.lane)
    return Place(net, crossing.edge, crossing.approach, scenario.ego.lane)
