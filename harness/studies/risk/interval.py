"""A probability from weighted draws, with its interval."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from harness.core.encounter import FloatArray
from harness.statistics.intervals import CONFIDENCE, clopper_pearson


@dataclass(frozen=True, slots=True)
class Tally:
    """Independent draws from the nominal density, and how many of them were in the event."""

    draws: int
    events: int

    def __add__(self, other: "Tally") -> "Tally":
        return Tally(self.draws + other.draws, self.events + other.events)

    @property
    def high(self) -> float:
        """What they exclude alone: Clopper and Pearson's one-sided bound.

        It bounds the whole probability, so that of any ways to the event as well.

        >>> round(Tally(6_000, 0).high * 6_000, 2)
        2.99
        """
        return clopper_pearson(self.events, self.draws, 2 * CONFIDENCE - 1)[1]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A probability with its two-sided interval; None where no draw was in the event.

    Then ``ci_high`` is ``nominal.high``.  ``nominal`` are all nominal draws, those of other stages
    included: a weighted estimate is one of the ways to the event that the exploration found, and
    what the nominal draws exclude is all that is known of other ways.

    ``effective_sample_size`` is (Σw)²/Σw² over the draws in the event; ``largest_share`` the
    largest weight's part of the estimate, None where there is none.
    """

    probability: float | None
    coefficient_of_variation: float | None
    ci_low: float
    ci_high: float
    effective_sample_size: float
    largest_share: float | None
    draws: int
    events: int
    nominal: Tally


def estimate_of(weight: FloatArray, event: NDArray[np.bool_], nominal: Tally) -> Estimate:
    """Mean of w·1_F with its interval.

    Where all weights are 1 the interval is Clopper–Pearson's.  Else it is the one of Student's t on
    the scale of ln p, p̂ exp(± t s/(p̂ √n)), as weights and estimate are skew, with as many degrees
    of freedom as the effective sample size leaves: one draw that holds the estimate says hardly
    anything.  Large weights are rare, so the spread s of most samples is too small: one more of the
    largest is counted in it.

    Args:
        weight: φ/q of every draw, shape (n,).
        event: whether the draw is in the event, shape (n,).
        nominal: all nominal draws.

    >>> estimate_of(np.ones(1_000), np.arange(1_000) < 3, Tally(1_000, 3)).probability
    0.003
    """
    n, events = len(weight), int(event.sum())
    if events == 0:
        return Estimate(None, None, 0.0, nominal.high, 0.0, None, n, 0, nominal)
    values = weight * event
    total = float(values.sum())
    p, largest = total / n, float(values.max()) / total
    size = total**2 / float(np.sum(values**2))
    cv = float(values.std(ddof=1)) / math.sqrt(n) / p
    if np.all(weight == 1):
        return Estimate(p, cv, *clopper_pearson(events, n), size, largest, n, events, nominal)
    quantile = float(stats.t.ppf((1 + CONFIDENCE) / 2, max(size - 1, 1)))
    factor = math.exp(quantile * math.hypot(cv, largest))
    return Estimate(p, cv, p / factor, min(1.0, p * factor), size, largest, n, events, nominal)
