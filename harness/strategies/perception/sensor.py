"""``[perception]`` and the step in; the constants of a driver's sensor out."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from harness.core.seeding import Purpose
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
    """The sensor of a driver: its section of the scenario and the constants that follow from it.

    ``correlation`` is the correlation of an error with the error one update later.
    """

    section: PerceptionSection
    seed: int
    crossing: Crossing
    eye_behind_m: float
    latency_steps: int
    update_steps: int
    correlation: float
    obstacles: tuple[Rectangle, ...]


class TrackStream(NamedTuple):
    """Random numbers of the track of one pedestrian, from the stream of one purpose.

    Attributes:
        drawn: whether a sensor draws them on the way to the crosswalk.
        given: how many of a pedestrian's first ones can be given, as those that a risk samples.
        later: what the others decide, in words; empty if a risk need not tell.
    """

    drawn: Callable[[Sensor], bool]
    given: int = 0
    later: str = ""


def _detects_again(sensor: Sensor) -> bool:
    section = sensor.section
    loses = section.dropout_probability > 0 or bool(sensor.obstacles)
    return section.detection_probability < 1 and loses


TRACK_STREAMS: Mapping[Purpose, TrackStream] = {
    "redetection": TrackStream(_detects_again, given=1),
    "dropout": TrackStream(
        lambda sensor: sensor.section.dropout_probability > 0,
        later="the updates at which perception loses a pedestrian",
    ),
    "perception_error": TrackStream(
        lambda sensor: sensor.section.position_sd_m > 0 or sensor.section.speed_sd_mps > 0,
        given=2,
        later="the change of perception errors after a pedestrian's first update",
    ),
}
"""What tracks draw at random, by purpose, in the order in which a risk samples it."""


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
        update_steps=round(update_s / step_s),
        correlation=math.exp(-update_s / section.correlation_s) if section.correlation_s else 0.0,
        obstacles=tuple(Rectangle(*o.x_bounds_m, *o.y_bounds_m) for o in obstacles),
    )
