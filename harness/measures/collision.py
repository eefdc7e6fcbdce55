"""The kind, time and speed of a contact."""

import numpy as np

from harness.encounter import FloatArray
from harness.measures.chunk import Chunk


def contact_speed_mps(chunk: Chunk) -> FloatArray:
    """The ego's speed at the contact in m/s; NaN without one."""
    return np.array(
        [np.nan if strike is None else strike.speed_mps for strike in chunk.strikes], dtype=float
    )
