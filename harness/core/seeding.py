"""A seed, a purpose and a pair in; an independent stream of random numbers out.

Every random number of a run comes from a stream keyed by (root seed, purpose, pair) and not by the
order of execution or by the cell.  A pair therefore draws the same numbers in any worker, in any
cell and after any resumption.  Within a stream the i-th draw belongs to pedestrian i (or to their
group, if it describes one), unless the stream is keyed by the pedestrian too.  In ``warm_up`` the
i-th group has the i-th row of four draws.  A risk samples most streams (docs/risk.md).
"""

import hashlib
from collections.abc import Container, Mapping, Sequence
from itertools import count
from typing import Any, Literal, TypeVar, get_args

import numpy as np

# fmt: off
Purpose = Literal[
    "arrival", "side", "quantile", "strategy", "critical_gap", "vehicle_arrival", "detection",
    "timed_detection", "redetection", "dropout", "perception_error", "warm_up", "av_strategy",
    "threshold", "latency", "group_size", "walking_class", "risk", "automated", "recorded_drive",
    "start_of_fit",
]
# fmt: on
"""What random numbers of a pair (the last two: of a recorded passage, of a fit) are for; a new one
is added at the end."""

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


def number_of(name: str, key: bytes = b"") -> int:
    """A number from 0 to below ``NUMBERS`` that belongs to a vehicle, person or crosswalk.

    It keys random streams or, with a random key, is itself a random number.

    Args:
        name: SUMO's id.
        key: the first bytes of a stream; none: the number depends on the id alone.
    """
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=6, key=key).digest(), "big")


NUMBERS = 2**48
"""The numbers of ``number_of`` lie below this."""

SUMO_SEEDS_APART = 1_000_003
"""Distance of SUMO's seeds of two successive values of ``experiment.seed``, so a simulation's most
pairs; odd, so that the values do not repeat before all of SUMO's seeds are used."""
_SUMO_SEEDS = 2**31
"""SUMO's seeds lie below this."""


def sumo_seed(root_seed: int, config_seed: int, pair: int) -> int:
    """SUMO's seed of a pair: the configuration's plus the pair's number, for seed 1.

    The pairs of a run have different seeds, and none of the next value of ``experiment.seed``.
    SUMO has 2**31 seeds: values of ``experiment.seed`` that differ by a multiple share them all.

    Args:
        root_seed: the experiment's seed, ≥ 0.
        config_seed: the configuration's seed, ≥ 0.
        pair: index of the pair, ≥ 0 and below ``SUMO_SEEDS_APART``.
    """
    return (config_seed + pair + SUMO_SEEDS_APART * (root_seed - 1)) % _SUMO_SEEDS
