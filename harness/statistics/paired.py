"""Two cells over the same pairs: the difference of means, and of crash rates.

Entry i of every column belongs to pair i, whose pedestrians draw the same random numbers in both
cells.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from harness.core.encounter import FloatArray
from harness.statistics.bootstrap import Resampled, bootstrap_mean, bootstrap_ratio
from harness.statistics.intervals import CONFIDENCE

_FLIPPED = 16

_ROUNDING = 1e-9
"""Differences below are of the last bits of sums."""


@dataclass(frozen=True, slots=True)
class CrashTest:
    """Crashes of two cells over the same pairs, and the exact McNemar test of equal crash rates.

    ``pairs`` ran in both cells; ``only_a`` and ``only_b`` are the discordant ones, in which the AV
    crashed in that cell alone.  ``ran_in_one`` counts the pairs that ran in one cell alone.
    """

    pairs: int
    only_a: int
    only_b: int
    p: float
    ran_in_one: int = 0

    @property
    def kappa_difference(self) -> float | None:
        """κ of cell A less κ of cell B over these pairs; undefined without any."""
        return (self.only_a - self.only_b) / self.pairs if self.pairs else None


@dataclass(frozen=True, slots=True)
class Difference(Resampled):
    """A difference of two cells over the same pairs, and the p of the sign-flip test of none.

    ``informative`` pairs differ.  The interval leaves out 0 only where the test rejects.
    """

    p: float

    def columns(self, name: str, kind: str = "ci") -> dict[str, float | None]:
        """As of a bootstrap's interval, with ``<name>_p``."""
        return {**Resampled.columns(self, name, kind), f"{name}_p": self.p}


def paired_difference(
    a: FloatArray, b: FloatArray, rng: np.random.Generator, confidence: float = CONFIDENCE
) -> Difference:
    """Mean of a − b with its interval over the pairs in which both are defined.

    The interval is the BCa bootstrap's, drawn out to 0 where the sign-flip test does not reject at
    1 − ``confidence``: the bootstrap of few pairs that differ, all of one sign, leaves out 0
    always.

    Args:
        a: shape (n,), NaN where undefined.
        b: the other cell's, of the same shape.
        rng: draws the resamples.
        confidence: of the interval, two-sided.

    Returns:
        As ``bootstrap_mean``: the same difference in all pairs gives the point as its own
        interval, one pair gives no interval, none gives nothing.
    """
    difference = _without_rounding(a - b)
    difference = difference[~np.isnan(difference)]
    return _tested(bootstrap_mean(difference, rng, confidence), difference, confidence)


def ratio_difference(
    a: FloatArray,
    b: FloatArray,
    reference: FloatArray,
    rng: np.random.Generator,
    confidence: float = CONFIDENCE,
) -> Difference:
    """Σ(a − b) / Σ ``reference`` over the pairs in which both are defined.

    Args, interval and test as of ``paired_difference``; ``reference`` is above 0 where both are
    defined.
    """
    difference = _without_rounding(a - b)
    counted = ~np.isnan(difference)
    found = bootstrap_ratio(difference[counted], reference[counted], rng, confidence)
    return _tested(found, difference[counted], confidence)


def _without_rounding(difference: FloatArray) -> FloatArray:
    return np.where(np.abs(difference) < _ROUNDING, 0.0, difference)


def _tested(found: Resampled, differences: FloatArray, confidence: float) -> Difference:
    p, low, high = sign_flip_p(differences), found.low, found.high
    if low is not None and high is not None and p >= 1 - confidence:
        low, high = min(low, 0.0), max(high, 0.0)
    return Difference(found.value, low, high, int(np.count_nonzero(differences)), p)


def sign_flip_p(differences: FloatArray) -> float:
    """Two-sided p of the sum of paired differences, each of which might have had either sign.

    So it is where the cells are equal in law (Fisher 1935, permutation of the arms within pairs).
    All signs of the ``_FLIPPED`` largest are tried; the sum of the others, none of them larger, is
    taken as normal with their sum of squares.  With no more than ``_FLIPPED`` that differ from 0
    the test is exact: k of one sign have p = 2^(1 − k).

    Args:
        differences: shape (n,), finite.

    Returns:
        1 where none differs from 0.
    """
    sizes = np.sort(np.abs(differences[differences != 0]))[::-1]
    sums = np.zeros(1)
    for size in sizes[:_FLIPPED]:
        sums = np.concatenate([sums - size, sums + size])
    total = abs(float(np.sum(differences)))
    if len(sizes) <= _FLIPPED:
        beyond = np.mean(sums >= total * (1 - _ROUNDING))
    else:
        # As far as half the step between two sums where all sizes are the same.
        gap = (sums + sizes[-1] - total) / np.sqrt(np.sum(sizes[_FLIPPED:] ** 2))
        beyond = np.mean(special.ndtr(gap))
    return min(1.0, 2 * float(beyond))


def mcnemar(
    crashed_a: np.ndarray, crashed_b: np.ndarray, ran_a: np.ndarray, ran_b: np.ndarray
) -> CrashTest:
    """The exact McNemar (1947) test: given b + c discordant pairs, b is binomial with share ½.

    Args:
        crashed_a: whether the AV crashed, shape (n,).
        crashed_b: the other cell's.
        ran_a: whether its episode ran, that is, did not fail in the engine.
        ran_b: the other cell's.

    Returns:
        With the two-sided p; p = 1 without discordant pairs.
    """
    ran = ran_a & ran_b
    only_a = int((ran & crashed_a & ~crashed_b).sum())
    only_b = int((ran & crashed_b & ~crashed_a).sum())
    discordant = only_a + only_b
    p = min(1.0, 2 * float(special.bdtr(min(only_a, only_b), discordant, 0.5)))
    return CrashTest(int(ran.sum()), only_a, only_b, p, int((ran_a ^ ran_b).sum()))


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjusted p of each test of a family (Holm 1979).

    The j-th smallest of m is multiplied by m − j + 1, never falls below a smaller one's, and is
    at most 1.  Rejecting where it is below 5 % is wrong anywhere in the family with at most 5 %,
    however the tests depend on each other.
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p, kind="stable")
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(steps, 1.0)
    return [float(value) for value in adjusted]
