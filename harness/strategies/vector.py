"""Observations as vectors of fixed length, for learned policies."""

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import Observation, Vehicle

EGO_ENTRIES = ("range_m", "speed_mps", "acceleration_mps2")
PEDESTRIAN_ENTRIES = ("present", "lateral_m", "remaining_m", "speed_mps", "on_crossing")
"""``present`` and ``on_crossing`` are 1 or 0; all entries of one who is not there are 0."""


def observation_vector(observation: Observation, nearest: int) -> NDArray[np.float32]:
    """An observation as numbers.

    Args:
        observation: what the strategy sees.
        nearest: k, how many pedestrians find room; those nearest to the centre of the ego's lane
            (smallest abs(lateral_m)) come first, of equals the one who arrived first.

    Returns:
        Shape (3 + 5 k,): ``EGO_ENTRIES``, then ``PEDESTRIAN_ENTRIES`` of each of the k.
    """
    vector = np.zeros(len(EGO_ENTRIES) + nearest * len(PEDESTRIAN_ENTRIES), dtype=np.float32)
    vector[: len(EGO_ENTRIES)] = observation.ego
    seen = observation.pedestrians
    if seen:
        if len(seen) > 1:
            seen = tuple(sorted(seen, key=lambda view: (abs(view.lateral_m), view.index)))[:nearest]
        at = len(EGO_ENTRIES)
        for view in seen[:nearest]:
            entries = (1.0, view.lateral_m, view.remaining_m, view.speed_mps, view.on_crossing)
            vector[at : at + len(PEDESTRIAN_ENTRIES)] = entries
            at += len(PEDESTRIAN_ENTRIES)
    return vector


def acceleration_of(action: float, vehicle: Vehicle) -> float:
    """A policy's action as the wanted acceleration.

    Args:
        action: from -1, the hardest braking, over 0, the same speed, to 1, full acceleration; what
            is beyond counts as the end.  NaN stays, and is refused where it is to be driven.
        vehicle: the ego.

    Returns:
        In m/s².

    >>> from harness.scenario import Scenario
    >>> [acceleration_of(action, Scenario().vehicle()) for action in (-1, -0.5, 0, 0.5, 7)]
    [-4.5, -2.25, 0.0, 1.5, 3.0]
    """
    cut = 1.0 if action > 1 else -1.0 if action < -1 else action
    return cut * (vehicle.max_acceleration_mps2 if cut > 0 else vehicle.max_deceleration_mps2)
