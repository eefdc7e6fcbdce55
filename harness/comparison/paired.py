"""Two cells over the same pairs: the difference of means, and of crash rates.

Entry i of every column belongs to pair i, whose pedestrians draw the same random numbers in both
cells.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from harness.comparison.intervals import CONFIDENCE, Interval, bootstrap_mean
from harness.encounter import FloatArray


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


def paired_difference(
    a: FloatArray, b: FloatArray, rng: np.random.Generator, confidence: float = CONFIDENCE
) -> Interval:
    """Mean of a − b with the BCa interval over the pairs in which both are defined.

    Args:
        a: shape (n,), NaN where undefined.
        b: the other cell's, of the same shape.
        rng: draws the resamples.
        confidence: of the interval, two-sided.

    Returns:
        As ``bootstrap_mean``: the same difference in all pairs gives the point as its own
        interval, one pair gives no interval, none gives nothing.
    """
    difference = a - b
    return bootstrap_mean(difference[~np.isnan(difference)], rng, confidence)


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
