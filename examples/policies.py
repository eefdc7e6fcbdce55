"""Policies over the vector of ``harness.strategies.vector``, as strategies of the harness.

    harness run cctc_flow --set arms.av=examples.policies:YieldToTheNearest
    python -m examples.train_policy policy.json
    harness run cctc_flow --set arms.av=examples.policies:Trained \\
        --set 'strategies."examples.policies:Trained".weights=policy.json'
"""

import json
import math
from pathlib import Path

import numpy as np

from harness.strategies.vector import (
    EGO_ENTRIES,
    PEDESTRIAN_ENTRIES,
    acceleration_of,
    observation_vector,
)

NEAREST = 2
"""Pedestrians in the vector: the same number in training and in use."""

HARDEST_MPS2 = 4.5
"""The hardest braking of the shipped scenarios' vehicle, which is the action -1."""

LONGEST_S = 6.0
"""Times beyond this look alike."""


def yield_to_the_nearest(vector):
    """A hand-written policy: a smooth stop for whoever still has to pass the lane, else onwards.

    Args:
        vector: shape (3 + 5 k,), as ``observation_vector`` makes it.

    Returns:
        The action, -1 to 1: shares of the hardest braking and of full acceleration.
    """
    range_m, speed_mps, _ = vector[: len(EGO_ENTRIES)]
    present, lateral_m, _, _, on_crossing = _pedestrian(vector, 0)
    to_line_m = range_m - 3.0
    if present and on_crossing and lateral_m > -1.5 and to_line_m > 0:
        return max(-1.0, -(float(speed_mps) ** 2) / (2 * float(to_line_m)) / HARDEST_MPS2)
    return 0.7 if speed_mps < 5.0 else 0.0


def features(vector):
    """What the trained policy is linear in: shape (2 + 4 k,), each of the order of 1."""
    range_m, speed_mps, _ = (float(entry) for entry in vector[: len(EGO_ENTRIES)])
    found = [1.0, speed_mps / 5.0 - 1.0]
    arrival_s = range_m / max(speed_mps, 0.1)
    for index in range(NEAREST):
        present, lateral_m, _, walking_mps, on_crossing = _pedestrian(vector, index)
        if not present or range_m <= 0:
            found += [0.0, 0.0, 0.0, 0.0]
            continue
        passes_s = (float(lateral_m) + 1.5) / max(float(walking_mps), 0.3)
        missing_s = max(0.0, min(LONGEST_S, passes_s) - min(LONGEST_S, max(0.0, arrival_s)))
        conflict = float(on_crossing) if lateral_m > -1.5 else 0.0
        found += [
            conflict,
            conflict * missing_s / 3.0,
            conflict * speed_mps**2 / (2 * max(range_m - 2.5, 0.5)) / 3.0,
            float(1 - on_crossing),
        ]
    return np.array(found)


def linear(weights, vector):
    """The trained policy's action, -1 to 1."""
    return math.tanh(float(weights @ features(vector)))


def _pedestrian(vector, index):
    begin = len(EGO_ENTRIES) + index * len(PEDESTRIAN_ENTRIES)
    return vector[begin : begin + len(PEDESTRIAN_ENTRIES)]


class YieldToTheNearest:
    """The hand-written policy as a strategy."""

    def decide(self, observation):
        """Wanted acceleration in m/s²."""
        action = yield_to_the_nearest(observation_vector(observation, NEAREST))
        return acceleration_of(action, observation.vehicle)


class Trained:
    """A policy that ``examples.train_policy`` wrote, as a strategy.

    Args:
        weights: the file.
    """

    def __init__(self, *, weights: str = "policy.json") -> None:
        self._weights = np.array(json.loads(Path(weights).read_text(encoding="utf-8")))

    def decide(self, observation):
        """Wanted acceleration in m/s²."""
        action = linear(self._weights, observation_vector(observation, NEAREST))
        return acceleration_of(action, observation.vehicle)
