"""How near ego and pedestrians came: gap, time to collision, time advantage.

Over the states of the record: the beginning of each step, and the moment someone steps off.
"""

import numpy as np

from harness.encounter import FloatArray
from harness.measures.chunk import Chunk
from harness.motion.contact import gap


def min_gap_m(chunk: Chunk) -> FloatArray:
    """Smallest distance of the ego's rectangle and the disc's edge in m; 0 after a contact."""
    met = chunk.met
    distance = gap(met.ahead_m, met.walker_y_m, chunk.body)
    return np.where(chunk.crashed, 0.0, chunk.smallest(met.trace, distance))


def min_ttc_s(chunk: Chunk) -> FloatArray:
    """Smallest time to collision in s (Hayward 1972), of rectangle and disc; 0 at a contact."""
    return np.where(chunk.crashed, 0.0, chunk.smallest(chunk.met.trace, chunk.ttc_s))


def min_time_advantage_s(chunk: Chunk) -> FloatArray:
    """Smallest abs(R/v − L/v_p) in s while both approach the point where their paths cross."""
    met = chunk.met
    lateral_m = (chunk.crossing.lane_centre_m - met.walker_y_m) * np.sign(met.walker_y_mps)
    both = (met.ahead_m > 0) & (lateral_m > 0) & (met.speed_mps > 0)
    advantage = np.abs(
        met.ahead_m[both] / met.speed_mps[both] - lateral_m[both] / np.abs(met.walker_y_mps[both])
    )
    return chunk.smallest(met.trace[both], advantage)
