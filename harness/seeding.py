"""Named random streams.

Every random number of a run comes from a stream keyed by (root seed, purpose, pair), never by
the order of execution or by the cell: the same pair draws the same numbers in any worker, any
cell and after any resume.  Within a stream the i-th draw belongs to pedestrian i.
"""

from typing import Literal

import numpy as np

Purpose = Literal["arrival", "side", "quantile", "strategy", "critical_gap"]

# The numbers enter the seeds: changing one changes every result.
_PURPOSES: dict[Purpose, int] = {
    "arrival": 1,
    "side": 2,
    "quantile": 3,
    "strategy": 4,
    "critical_gap": 5,
}


Resampling = Literal["summary", "comparison"]

# Apart from the streams above by their form, not only by their numbers.
_RESAMPLINGS: dict[Resampling, int] = {"summary": 5, "comparison": 6}


def stream(root_seed: int, purpose: Purpose, pair: int) -> np.random.Generator:
    """The generator of one purpose for one pair.

    Args:
        root_seed: the experiment's seed, ≥ 0.
        purpose: what the numbers are for.
        pair: index of the pair, ≥ 0.
    """
    # As a spawn key, not as further entropy: seeds above 2**32 must not run into the purpose.
    key = (_PURPOSES[purpose], pair)
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(root_seed, spawn_key=key)))


def resampling(root_seed: int, purpose: Resampling) -> np.random.Generator:
    """The generator of the bootstrap's resamples: the same for every cell of a run.

    Args:
        root_seed: the experiment's seed, ≥ 0.
        purpose: what is resampled.
    """
    return np.random.default_rng((root_seed, _RESAMPLINGS[purpose]))
