"""Observations as vectors of fixed length, for learned policies."""

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import checked
from harness.core.vocabulary import Observation, Vehicle

EGO_ENTRIES = ("range_m", "speed_mps", "acceleration_mps2")
"""The first entries of every vector."""
PEDESTRIAN_ENTRIES = ("present", "lateral_m", "remaining_m", "speed_mps", "on_crossing")
"""``present`` and ``on_crossing`` are 1 or 0; all entries of a missing pedestrian are 0."""


@checked
def observation_vector(observation: Observation, nearest: int) -> NDArray[np.float32]:
    """An observation as a vector.

    Args:
        observation: what the strategy sees.
        nearest: k, the number of pedestrians in the vector.  Pedestrians nearest to the centre of
            the ego's lane (smallest abs(lateral_m)) come first; at equal distances the one whom
            the driver saw first.

    Returns:
        Shape (3 + 5 k,): ``EGO_ENTRIES``, then ``PEDESTRIAN_ENTRIES`` of each of the k.
    """
    vector = np.zeros(len(EGO_ENTRIES) + nearest * len(PEDESTRIAN_ENTRIES), dtype=np.float32)
    vector[: len(EGO_ENTRIES)] = observation.ego
    views = sorted(observation.pedestrians, key=lambda view: (abs(view.lateral_m), view.index))
    at = len(EGO_ENTRIES)
    for view in views[:nearest]:
        entries = (1.0, view.lateral_m, view.remaining_m, view.speed_mps, view.on_crossing)
        vector[at : at + len(PEDESTRIAN_ENTRIES)] = entries
        at += len(PEDESTRIAN_ENTRIES)
    return vector


def acceleration_of(action: float | NDArray[np.floating], vehicle: Vehicle) -> float:
    """The commanded acceleration of a policy's action.

    Args:
        action: -1 is the hardest braking, 0 keeps the speed, 1 is full acceleration; values outside
            are clipped.  NaN stays NaN; the harness refuses it as a command.  An array has shape
            (1,), as an action of the environment, or ().
        vehicle: the ego.

    Returns:
        The acceleration in m/s².

    >>> from harness.scenario import Scenario
    >>> [acceleration_of(action, Scenario().vehicle()) for action in (-1, -0.5, 0, 0.5, 7)]
    [-4.5, -2.25, 0.0, 1.5, 3.0]
    >>> acceleration_of(np.array([-0.5], dtype=np.float32), Scenario().vehicle())
    -2.25
    """
    if isinstance(action, np.ndarray):
        action = float(action.item())
    cut = 1.0 if action > 1 else -1.0 if action < -1 else action
    return cut * (vehicle.max_acceleration_mps2 if cut > 0 else vehicle.max_deceleration_mps2)
