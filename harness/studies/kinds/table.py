"""The simulation of every kind of run, by the kind's name."""

from collections.abc import Mapping

from harness.scenario import Scenario
from harness.store.kinds import kind_of
from harness.studies.kinds.encounters import EncounterSimulation
from harness.studies.kinds.hours import HourSimulation
from harness.studies.kinds.protocol import Simulation

SIMULATIONS: Mapping[str, Simulation] = {
    "encounters": EncounterSimulation(),
    "hours of traffic": HourSimulation(),
}


def simulation_of(scenario: Scenario) -> Simulation:
    """How runs of this scenario are simulated."""
    return SIMULATIONS[kind_of(scenario).name]
