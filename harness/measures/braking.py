"""How hard the ego braked."""

import numpy as np

from harness.encounter import FloatArray
from harness.measures.chunk import Chunk


def max_deceleration_mps2(chunk: Chunk) -> FloatArray:
    """Largest −Δv/Δt over the steps of the record in m/s²; 0 if it never braked."""
    ego = chunk.ego
    trace, state = chunk.record_steps()
    largest = np.zeros(len(chunk.traces))
    np.maximum.at(largest, trace, ego.speed_mps[state] - ego.speed_mps[state + 1])
    return largest / chunk.step_s
