"""``[perception]`` and the step in; the constants of a driver's sensor out."""

from dataclasses import dataclass

from harness.core.vocabulary import Arm, Crossing
from harness.scenario import Scenario
from harness.scenario.sections import PerceptionSection
from harness.strategies.perception.occlusion import Rectangle

EYE_BEHIND_BUMPER_M = 2.4
"""The eye is on the vehicle's centre line, this far behind its front bumper.

AASHTO's Green Book has the driver's eye 8 ft behind the front of the car at intersections.
"""


@dataclass(frozen=True, slots=True)
class Sensor:
    """The sensor of a driver: its section of the scenario and the constants that follow from it."""

    section: PerceptionSection
    seed: int
    crossing: Crossing
    eye_behind_m: float
    latency_steps: int
    update_s: float
    update_steps: int
    obstacles: tuple[Rectangle, ...]


def sensor_of(scenario: Scenario, driver: Arm) -> Sensor | None:
    """The sensor of a driver; None if they see the truth within the detection range.

    Human drivers have the sensor of the AVs if ``perception.human`` is set; otherwise only
    obstacles limit their sight.
    """
    perception = scenario.perception
    imperfect = driver is Arm.AV or perception.human
    section = perception if imperfect else PerceptionSection()
    step_s = scenario.experiment.step_s
    update_s = step_s if section.update_s is None else section.update_s
    obstacles = scenario.obstacles() if section.occlusion else ()
    if section.is_perfect(step_s) and not obstacles:
        return None
    return Sensor(
        section=section,
        seed=scenario.experiment.seed,
        crossing=scenario.crosswalk(),
        # The eye is not behind the vehicle's rear.
        eye_behind_m=min(EYE_BEHIND_BUMPER_M, scenario.vehicle().length_m),
        latency_steps=round(section.latency_s / step_s),
        update_s=update_s,
        update_steps=round(update_s / step_s),
        obstacles=tuple(Rectangle(*o.x_bounds_m, *o.y_bounds_m) for o in obstacles),
    )
