"""The uniforms behind an episode that are sampled: those of the first pedestrians.

An episode is a function of uniforms: when each pedestrian comes, from which side, at which quantile
of the walking speed, with which critical gap, and when they are first detected.  At most
``MOST_DIMENSIONS`` of them are sampled by weight.  Everything else is drawn from the streams of the
episode's number, with weight 1.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from harness.encounter import FloatArray
from harness.episode.arrivals import Given
from harness.errors import InputError
from harness.scenario import Scenario
from harness.seeding import Purpose

MOST_DIMENSIONS = 30

_OPEN = 2.0**-53
"""Uniforms keep this far from 0 and 1, whose quantiles are infinite."""


@dataclass(frozen=True, slots=True)
class Space:
    """Which uniform each dimension is: (purpose, number of the pedestrian)."""

    axes: tuple[tuple[Purpose, int], ...]

    @property
    def dimensions(self) -> int:
        """d, the number of sampled uniforms."""
        return len(self.axes)

    @property
    def people(self) -> int:
        """How many pedestrians have sampled uniforms."""
        return 1 + max(number for _, number in self.axes)

    def given(self, z: FloatArray) -> Given:
        """The uniforms Φ(z) by purpose, in place of the first draws of each stream.

        Args:
            z: one point in standard normal space, shape (d,).
        """
        uniforms = np.clip(ndtr(z), _OPEN, 1 - _OPEN).tolist()
        values: dict[Purpose, list[float]] = {}
        for (purpose, number), uniform in zip(self.axes, uniforms, strict=True):
            # Only the first arrival may be missing, of someone who is there at the trigger.
            of_purpose = values.setdefault(purpose, [0.5] * number)
            of_purpose.append(uniform)
        return values


def space_of(scenario: Scenario) -> Space:
    """The sampled uniforms of a scenario.

    Raises:
        InputError: SUMO's own pedestrians walk, who are no function of uniforms, or nobody's
            coming is random.
    """
    pedestrians = scenario.pedestrians
    if pedestrians.behaviour == "sumo":
        raise InputError(
            "pedestrians.behaviour",
            '"sumo" cannot be sampled: SUMO moves these pedestrians by itself',
            '"constant", "gap_acceptance" or "reactive"',
        )
    if pedestrians.drawn:
        raise InputError("pedestrians.drawn", "leaves nothing to chance", "a scenario without it")
    purposes: list[Purpose] = ["arrival", "side", "quantile"]
    if pedestrians.behaviour == "gap_acceptance":
        purposes.append("critical_gap")
    if scenario.perception.detection_probability < 1:
        purposes.append("detection")
    people = MOST_DIMENSIONS // len(purposes)
    if pedestrians.max_count is not None:
        people = min(people, pedestrians.max_count)
    if pedestrians.flow_per_hour == 0:
        people = min(people, int(pedestrians.first_at_trigger))
    axes = [(purpose, number) for number in range(people) for purpose in purposes]
    if pedestrians.first_at_trigger and axes:
        axes.remove(("arrival", 0))
    if not axes:
        raise InputError(
            "pedestrians.flow_per_hour",
            "is 0: nothing in an episode is left to chance",
            "a flow above 0; for timed pedestrians: harness run",
        )
    return Space(tuple(axes))
