"""Named random streams, one for each random key or error; a risk samples most of them (risk.md).

Every random number of a run comes from a stream keyed by (root seed, purpose, pair) and not by the
order of execution or by the cell.  A pair therefore draws the same numbers in any worker, in any
cell and after any resumption.  Within a stream the i-th draw belongs to pedestrian i (or to their
group, if it describes one), unless the stream is keyed by the pedestrian too.  In ``warm_up`` the
i-th group has the i-th row of four draws.
"""

from collections.abc import Container, Mapping, Sequence
from itertools import count
from typing import Any, Literal, TypeVar, get_args

import numpy as np

# fmt: off
Purpose = Literal[
    "arrival", "side", "quantile", "strategy", "critical_gap", "vehicle_arrival", "detection",
    "timed_detection", "redetection", "dropout", "perception_error", "warm_up", "av_strategy",
    "threshold", "latency", "group_size", "walking_class", "risk",
]
# fmt: on
"""What random numbers of a pair are for; a new one is added at the end."""

Resampled = Literal["folds", "summary", "comparison", "validation", "risk"]
"""What random numbers that belong to no pair are for; a new one is added at the end."""

Given = Mapping[Purpose, Sequence[float]]
"""Uniforms in (0, 1) that replace the first draws of a pair's streams: one for each pedestrian (two
in ``perception_error``), and at most ``GIVEN_DRAWS`` for a strategy."""

_Name = TypeVar("_Name", bound=str)


def _numbered(names: Sequence[_Name], gone: Container[int]) -> Mapping[_Name, int]:
    """The names by number, from 1 on; the numbers of names that went are not used again."""
    return dict(zip(names, (n for n in count(1) if n not in gone), strict=False))


# The seeds depend on these numbers: changing one changes every result.
_PURPOSES = _numbered(get_args(Purpose), gone=(7, 15, 16))
# These seeds have another form than those of the streams, so no two coincide.
_RESAMPLINGS = _numbered(get_args(Resampled), gone=(2, 3, 4))


def stream(root_seed: int, purpose: Purpose, pair: int, *part: int) -> np.random.Generator:
    """The generator of one purpose for one pair.

    Args:
        root_seed: the experiment's seed, ≥ 0.
        purpose: what the numbers are for.
        pair: index of the pair, ≥ 0.
        part: numbers ≥ 0 that distinguish vehicles, lanes or pedestrians of a pair, if each has
            its own stream.
    """
    # A spawn key, and not more entropy: seeds above 2**32 must not overlap with the purpose.
    key = (_PURPOSES[purpose], pair, *part)
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(root_seed, spawn_key=key)))


GIVEN_DRAWS = 2
"""Number of first draws of a generator that can be given."""


class GivenFirst(np.random.Generator):
    """A generator whose first draws of ``random()`` are given; everything else it draws itself.

    Args:
        bits: its source of all other draws.
        uniforms: values in [0, 1), at most ``GIVEN_DRAWS``.
    """

    def __init__(self, bits: np.random.BitGenerator, uniforms: Sequence[float] = ()) -> None:
        super().__init__(bits)
        self._given = [*uniforms]

    def random(self, size: Any = None, *args: Any, **kwargs: Any) -> Any:
        """As NumPy's, but for the given draws, which come first."""
        drawn = super().random(size, *args, **kwargs)
        if not isinstance(drawn, np.ndarray):
            return self._given.pop(0) if self._given else drawn
        for place in range(min(len(self._given), drawn.size)):
            drawn.flat[place] = self._given.pop(0)
        return drawn


def resampling(root_seed: int, purpose: Resampled) -> np.random.Generator:
    """The generator of random numbers that belong to no pair; the same for every cell of a run.

    Args:
        root_seed: the experiment's or the fit's seed, ≥ 0.
        purpose: the folds of a fit, the bootstrap of a summary, comparison or validation, or the
            points of a risk.
    """
    return np.random.default_rng((root_seed, _RESAMPLINGS[purpose]))


def start_of_fit(root_seed: int, *key: int) -> np.random.Generator:
    """The generator of one start of a fit.

    The stream whose purpose has the number of the fit has the same numbers with the same seed.  No
    result depends on both: a fit's rows are recorded ones or draws of a test, never of a pair, and
    its starts only say where the climb to the same maximum begins.  (Another key would change the
    starts of the shipped models.)

    Args:
        root_seed: the fit's seed, ≥ 0.
        key: the numbers of the fit and of its start, ≥ 0.
    """
    return np.random.default_rng(np.random.SeedSequence(root_seed, spawn_key=key))
