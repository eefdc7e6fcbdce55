"""The simulation of every kind of run, by the kind's name, and the run of a task."""

from collections.abc import Mapping

from harness.engine.shared import close_engine
from harness.old.studies.kinds.hours import HOUR_SIMULATION
from harness.old.studies.kinds.simulation import Simulation
from harness.old.studies.kinds.simulations import OWN_SIMULATION
from harness.old.studies.kinds.tasks import Task, TaskResult
from harness.scenario import Scenario

SIMULATIONS: Mapping[str, Simulation] = {
    "hours of traffic": HOUR_SIMULATION,
    "own simulations": OWN_SIMULATION,
}


def simulation_of(scenario: Scenario) -> Simulation:
    """Return the simulation of this scenario's kind of run."""
    return SIMULATIONS[scenario.kind]


def run_task(task: Task) -> tuple[TaskResult, ...]:
    """Run every pair of a task in the one SUMO of this process; return those of ``task.each``."""
    try:
        return simulation_of(task.scenario).run(task)
    except BaseException:
        # An interrupted episode must not affect the next one.
        close_engine()
        raise
