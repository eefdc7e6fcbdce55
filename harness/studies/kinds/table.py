"""The simulation of every kind of run, by the kind's name."""

from collections.abc import Mapping

from harness.scenario import Scenario
from harness.store.kinds import kind_of
from harness.studies.kinds.encounters import ENCOUNTER_SIMULATION
from harness.studies.kinds.hours import HOUR_SIMULATION
from harness.studies.kinds.simulation import Simulation
from harness.studies.kinds.simulations import OWN_SIMULATION

SIMULATIONS: Mapping[str, Simulation] = {
    "encounters": ENCOUNTER_SIMULATION,
    "hours of traffic": HOUR_SIMULATION,
    "own simulations": OWN_SIMULATION,
}


def simulation_of(scenario: Scenario) -> Simulation:
    """Return the simulation of this scenario's kind of run."""
    return SIMULATIONS[kind_of(scenario).name]
