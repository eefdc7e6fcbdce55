"""Named random streams.

Every random number of a run comes from a stream keyed by (root seed, purpose, pair), never by
the order of execution or by the cell: the same pair draws the same numbers in any worker, any
cell and after any resume.  Within a stream the i-th draw belongs to pedestrian i, or the
stream is keyed by the pedestrian too.
"""

from typing import Literal

import numpy as np

Purpose = Literal[
    "arrival",
    "side",
    "quantile",
    "strategy",
    "critical_gap",
    "vehicle_arrival",
    "automation",
    "detection",
    "timed_detection",
    "redetection",
    "dropout",
    "perception_error",
    "warm_up",
    "av_strategy",
    "pilot",
]

# The numbers enter the seeds: changing one changes every result.
_PURPOSES: dict[Purpose, int] = {
    "arrival": 1,
    "side": 2,
    "quantile": 3,
    "strategy": 4,
    "critical_gap": 5,
    "vehicle_arrival": 6,
    "automation": 7,
    "detection": 8,
    "timed_detection": 9,
    "redetection": 10,
    "dropout": 11,
    "perception_error": 12,
    "warm_up": 13,
    "av_strategy": 14,
    "pilot": 15,
}


Resampling = Literal["summary", "comparison", "validation", "risk", "audit"]

# Apart from the streams above by their form, not only by their numbers.
_RESAMPLINGS: dict[Resampling, int] = {
    "summary": 5,
    "comparison": 6,
    "validation": 7,
    "risk": 8,
    "audit": 9,
}


def stream(root_seed: int, purpose: Purpose, pair: int, *part: int) -> np.random.Generator:
    """The generator of one purpose for one pair.

    Args:
        root_seed: the experiment's seed, ≥ 0.
        purpose: what the numbers are for.
        pair: index of the pair, ≥ 0.
        part: numbers ≥ 0 that tell vehicles, lanes or pedestrians of a pair apart, where each has
            a stream of its own.
    """
    # As a spawn key, not as further entropy: seeds above 2**32 must not run into the purpose.
    key = (_PURPOSES[purpose], pair, *part)
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(root_seed, spawn_key=key)))


def resampling(root_seed: int, purpose: Resampling) -> np.random.Generator:
    """The generator of what is drawn beyond the pairs: the same for every cell of a run.

    Args:
        root_seed: the experiment's seed, ≥ 0.
        purpose: the bootstrap of a summary or a comparison, the points of a risk, or which pairs
            an audit repeats.
    """
    return np.random.default_rng((root_seed, _RESAMPLINGS[purpose]))
