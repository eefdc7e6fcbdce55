"""Named random streams.

Every random number of a run comes from a stream keyed by (root seed, purpose, pair) and not by the
order of execution or by the cell.  A pair therefore draws the same numbers in any worker, in any
cell and after any resumption.  Within a stream the i-th draw belongs to pedestrian i (or to their
group, if it describes one), unless the stream is keyed by the pedestrian too.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

Purpose = str
"""What random numbers are for: a key of ``_PURPOSES``."""

Given = Mapping[Purpose, Sequence[float]]
"""Uniforms in (0, 1) that replace the first draws of a pair's streams: one for each pedestrian (two
in ``perception_error``), and at most ``GIVEN_DRAWS`` for a strategy."""

# The seeds depend on these numbers: changing one changes every result.
_PURPOSES = {
    "arrival": 1,
    "side": 2,
    "quantile": 3,
    "strategy": 4,
    "critical_gap": 5,
    "vehicle_arrival": 6,
    "detection": 8,
    "timed_detection": 9,
    "redetection": 10,
    "dropout": 11,
    "perception_error": 12,
    "warm_up": 13,
    "av_strategy": 14,
    "vehicle_type": 16,
    "threshold": 17,
    "latency": 18,
    "group_size": 19,
    "walking_class": 20,
    "risk": 21,
}


# These seeds have another form than those of the streams above, so no two coincide.
_RESAMPLINGS = {
    "summary": 5,
    "comparison": 6,
    "validation": 7,
    "risk": 8,
    "refits": 10,
}


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


def beginning_with(uniforms: Sequence[float], rng: np.random.Generator) -> np.random.Generator:
    """A generator of the same kind whose first draws of ``random()`` are given.

    Each raw word of 64 bits has the 53 bits of the given uniform first, and drawn bits after them.
    So a normal or an integer that is drawn first is a function of the uniform, too.

    PCG64 is the linear congruential generator s' = a s + c modulo 2^128.  A word is the xor of a
    state's halves, rotated (O'Neill 2014, PCG XSL RR 128/64).  The upper halves of the first two
    states are drawn.  The lower halves follow from the words, and c follows from both states.
    Later draws are as random as the drawn halves.

    Args:
        uniforms: at most ``GIVEN_DRAWS`` values in [0, 1); without any, the result is ``rng``.
        rng: a new PCG64 generator, from which everything else is drawn.
    """
    if not len(uniforms):
        return rng
    words, halves = np.array_split(rng.bit_generator.random_raw(2 * GIVEN_DRAWS), 2)
    below = [int(word) & 0x7FF for word in words]
    given = [
        int(math.ldexp(uniform, 53)) << 11 | bits
        for uniform, bits in zip(uniforms, below, strict=False)
    ]
    given += words[len(given) :].tolist()
    first, second = (_state(int(half), word) for half, word in zip(halves, given, strict=True))
    increment = (second - _MULTIPLIER * first) % 2**128
    if increment % 2 == 0:  # c must be odd; another upper half makes it odd
        second = _state(int(halves[1]) ^ 1, given[1])
        increment = (second - _MULTIPLIER * first) % 2**128
    before = (first - increment) * pow(_MULTIPLIER, -1, 2**128) % 2**128
    rng.bit_generator.state = {
        **rng.bit_generator.state,
        "state": {"state": before, "inc": increment},
    }
    return rng


def has_drawn_more(rng: np.random.Generator, begun: np.random.Generator) -> bool:
    """Whether more than ``GIVEN_DRAWS`` raw words were drawn from a PCG64 generator.

    Args:
        rng: the generator.
        begun: another generator in the initial state of ``rng``; it is used up.
    """
    now = rng.bit_generator.state["state"]
    for _ in range(GIVEN_DRAWS + 1):
        if begun.bit_generator.state["state"] == now:
            return False
        begun.bit_generator.random_raw()
    return True


_MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645
"""The multiplier a of PCG64."""


def _state(upper: int, word: int) -> int:
    """The state with a given upper half for which PCG64 returns a given word."""
    turned = upper >> 58
    lower = upper ^ ((word << turned | word >> (64 - turned)) & 2**64 - 1)
    return upper << 64 | lower


def resampling(root_seed: int, purpose: str) -> np.random.Generator:
    """The generator of random numbers that belong to no pair; the same for every cell of a run.

    Args:
        root_seed: the experiment's seed, ≥ 0.
        purpose: the bootstrap of a summary, comparison or validation, the points of a risk, the
            or the vehicles of refits.
    """
    return np.random.default_rng((root_seed, _RESAMPLINGS[purpose]))
