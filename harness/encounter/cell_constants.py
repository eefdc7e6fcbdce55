"""The constants of all episodes of a cell, with the keys of pedestrians."""

from dataclasses import dataclass

from harness.core.vocabulary import Arm, Crossing, Vehicle
from harness.scenario import Scenario
from harness.scenario.pedestrians import PedestriansSection


@dataclass(frozen=True, slots=True)
class CellConstants:
    """The cell's constants.

    Pedestrians step off if the next vehicle needs at least ``pedestrians.kerb_wait_s`` to arrive
    (``deciding.must_wait``).  A pedestrian's critical gap, if there is one, replaces it.
    """

    vehicle: Vehicle
    crossing: Crossing
    pedestrians: PedestriansSection
    step_s: float
    timeout_s: float


def constants_of(scenario: Scenario, driver: Arm | None = None) -> CellConstants:
    """The constants of a scenario; with a driver, ``vehicle`` is that driver's."""
    experiment = scenario.experiment
    return CellConstants(
        vehicle=scenario.vehicle(driver),
        crossing=scenario.crosswalk(),
        pedestrians=scenario.pedestrians,
        step_s=experiment.step_s,
        timeout_s=experiment.timeout_s,
    )
