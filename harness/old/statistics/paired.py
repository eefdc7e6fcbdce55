"""Compares two cells over the same pairs: the difference of means and of crash rates.

Entry i of every column belongs to pair i, whose pedestrians draw the same random numbers in both
cells.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from harness.core.encounter import FloatArray
from harness.old.statistics.bootstrap import Resampled, bootstrap_mean, bootstrap_ratio
from harness.old.statistics.intervals import CONFIDENCE

_FLIPPED = 16

_ROUNDING = 1e-9
"""Smaller differences are rounding errors of sums."""


@dataclass(frozen=True, slots=True)
class CrashTest:
    """Crashes of two cells over the same pairs, and the exact McNemar test of equal crash rates.

    ``pairs`` is the number of pairs that ran in both cells.  ``only_a`` and ``only_b`` are the
    numbers of discordant pairs, in which the AV crashed in only one cell.  ``ran_in_one`` is the
    number of pairs that ran in only one cell.
    """

    pairs: int
    only_a: int
    only_b: int
    p: float
    ran_in_one: int = 0

    @property
    def kappa_difference(self) -> float | None:
        """κ of cell A minus κ of cell B over these pairs; undefined if there are none."""
        return (self.only_a - self.only_b) / self.pairs if self.pairs else None


@dataclass(frozen=True, slots=True)
class Difference(Resampled):
    """A difference of two cells over the same pairs, and the p-value of the sign-flip test.

    The null hypothesis is that the cells do not differ.  ``informative`` is the number of pairs
    that differ.  The interval excludes 0 only if the test rejects.
    """

    p: float

    def columns(self, name: str, kind: str = "ci") -> dict[str, float | None]:
        """The columns of a bootstrap's interval, and ``<name>_p``."""
        return {**Resampled.columns(self, name, kind), f"{name}_p": self.p}


def paired_difference(
    a: FloatArray,
    b: FloatArray,
    rng: np.random.Generator | None,
    confidence: float = CONFIDENCE,
) -> Difference:
    """Mean of a − b with its interval over the pairs in which both are defined.

    The interval is the BCa bootstrap's.  It is extended to 0 if the sign-flip test does not reject
    at 1 − ``confidence``, because the bootstrap's interval always excludes 0 if few pairs differ
    and all differences have one sign.

    Args:
        a: shape (n,), NaN where undefined.
        b: the same column of the other cell, same shape.
        rng: draws the resamples; None: no interval is computed.
        confidence: two-sided confidence of the interval.

    Returns:
        The mean with its interval.  If all differences are equal, the interval is that point.  With
        one pair there is no interval; without a pair everything is None.
    """
    difference = _without_rounding(a - b)
    difference = difference[~np.isnan(difference)]
    return _tested(bootstrap_mean(difference, rng, confidence), difference, confidence)


def ratio_difference(
    a: FloatArray,
    b: FloatArray,
    reference: FloatArray,
    rng: np.random.Generator | None,
    confidence: float = CONFIDENCE,
) -> Difference:
    """Σ(a − b) / Σ ``reference`` over the pairs in which both are defined.

    Arguments, interval and test are as in ``paired_difference``; ``reference`` is above 0 where
    both are defined.
    """
    difference = _without_rounding(a - b)
    counted = ~np.isnan(difference)
    ratio = bootstrap_ratio(difference[counted], reference[counted], rng, confidence)
    return _tested(ratio, difference[counted], confidence)


def _without_rounding(difference: FloatArray) -> FloatArray:
    return np.where(np.abs(difference) < _ROUNDING, 0.0, difference)


def _tested(estimate: Resampled, differences: FloatArray, confidence: float) -> Difference:
    p, low, high = sign_flip_p(differences), estimate.low, estimate.high
    if low is not None and high is not None and p >= 1 - confidence:
        low, high = min(low, 0.0), max(high, 0.0)
    return Difference(estimate.value, low, high, int(np.count_nonzero(differences)), p)


def sign_flip_p(differences: FloatArray) -> float:
    """Two-sided p-value of the sum of paired differences under random signs (Fisher 1935).

    If the two cells have the same distribution, each difference is as likely to have either sign.
    All signs of the ``_FLIPPED`` largest differences are enumerated; the sum of the others is
    approximated by a normal distribution whose variance is their sum of squares.  If at most
    ``_FLIPPED`` differences are not 0, the test is exact: k differences of one sign have
    p = 2^(1 − k).

    Args:
        differences: shape (n,), finite.

    Returns:
        1 if all differences are 0.
    """
    sizes = np.sort(np.abs(differences[differences != 0]))[::-1]
    sums = np.zeros(1)
    for size in sizes[:_FLIPPED]:
        sums = np.concatenate([sums - size, sums + size])
    total = abs(float(np.sum(differences)))
    if len(sizes) <= _FLIPPED:
        beyond = np.mean(sums >= total * (1 - _ROUNDING))
    else:
        # The continuity correction is half the step between two sums if all sizes are equal.
        gap = (sums + sizes[-1] - total) / np.sqrt(np.sum(sizes[_FLIPPED:] ** 2))
        beyond = np.mean(special.ndtr(gap))
    return min(1.0, 2 * float(beyond))


def mcnemar(
    crashed_a: np.ndarray, crashed_b: np.ndarray, ran_a: np.ndarray, ran_b: np.ndarray
) -> CrashTest:
    """The exact McNemar (1947) test: given b + c discordant pairs, b is binomial with share ½.

    Args:
        crashed_a: whether the AV crashed, shape (n,).
        crashed_b: the same, of the other cell.
        ran_a: whether the AV's episode ran, that is, did not fail in the engine.
        ran_b: the same, of the other cell.

    Returns:
        The counts and the two-sided p, which is 1 if there are no discordant pairs.
    """
    ran = ran_a & ran_b
    only_a = int((ran & crashed_a & ~crashed_b).sum())
    only_b = int((ran & crashed_b & ~crashed_a).sum())
    discordant = only_a + only_b
    p = min(1.0, 2 * float(special.bdtr(min(only_a, only_b), discordant, 0.5)))
    return CrashTest(int(ran.sum()), only_a, only_b, p, int((ran_a ^ ran_b).sum()))


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjusted p-value of each test of a family (Holm 1979).

    The j-th smallest of m p-values is multiplied by m − j + 1.  The result is at most 1, and never
    below the result for a smaller p.  If tests are rejected below 5 %, the probability of any wrong
    rejection in the family is at most 5 %, even if the tests are dependent.
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p, kind="stable")
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(steps, 1.0)
    return [float(value) for value in adjusted]
