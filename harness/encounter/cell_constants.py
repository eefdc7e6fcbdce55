"""The constants of all episodes of a cell."""

from dataclasses import dataclass, field

from harness.core.encounter import Arm, Behaviour, Crossing, Vehicle
from harness.scenario import Scenario
from harness.scenario.people import ThresholdSection


@dataclass(frozen=True, slots=True)
class CellConstants:
    """The cell's constants.

    Pedestrians step off if the next vehicle needs at least ``kerb_wait_s`` to arrive
    (``deciding.keeps_waiting``).  A pedestrian's critical gap, if there is one, replaces
    ``kerb_wait_s``.
    """

    vehicle: Vehicle
    crossing: Crossing
    kerb_wait_s: float
    step_s: float
    timeout_s: float
    behaviour: Behaviour
    threshold: ThresholdSection = field(default_factory=ThresholdSection)
    """The weights of the decision, with behaviour ``threshold``."""


def constants_of(scenario: Scenario, driver: Arm | None = None) -> CellConstants:
    """The constants of a scenario; with a driver, ``vehicle`` is that driver's."""
    pedestrians, experiment = scenario.pedestrians, scenario.experiment
    return CellConstants(
        vehicle=scenario.vehicle(driver),
        crossing=scenario.crosswalk(),
        kerb_wait_s=pedestrians.kerb_wait_s,
        step_s=experiment.step_s,
        timeout_s=experiment.timeout_s,
        behaviour=pedestrians.behaviour,
        threshold=pedestrians.threshold,
    )
