"""Takes weighted draws and returns the probability of the event with its interval."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import stats

from harness.core.encounter import FloatArray
from harness.old.statistics.intervals import CONFIDENCE, clopper_pearson


@dataclass(frozen=True, slots=True)
class Tally:
    """The number of independent nominal draws, and the number of events among them."""

    draws: int
    events: int

    def __add__(self, other: "Tally") -> "Tally":
        return Tally(self.draws + other.draws, self.events + other.events)

    @property
    def high(self) -> float:
        """The one-sided Clopper–Pearson upper bound from these draws alone.

        It bounds the probability of all ways to the event together.

        >>> round(Tally(6_000, 0).high * 6_000, 2)
        2.99
        """
        return clopper_pearson(self.events, self.draws, 2 * CONFIDENCE - 1)[1]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A probability with its two-sided interval; None if no draw was in the event.

    Without an event ``ci_high`` is ``nominal.high``.  ``nominal`` counts the nominal draws of all
    stages.  A weighted estimate covers only the ways to the event that the exploration found; only
    the nominal draws bound other ways.

    ``effective_sample_size`` is (Σw)²/Σw² over the draws in the event.  ``largest_share`` is the
    largest weight's share of the estimate; None without an estimate.
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


def estimate_of(value: FloatArray, nominal: Tally, *, weighted: bool) -> Estimate:
    """Return the mean of the draws' values with its interval.

    If no draw is weighted, the interval is Clopper–Pearson's.  Otherwise it is Student's t interval
    of ln p, p̂ exp(± t s/(p̂ √n)), because weights and estimate are skewed.  Its degrees of freedom
    follow from the effective sample size, because an estimate from one dominant draw is very
    uncertain.  Large weights are rare, so s is too small in most samples.  Therefore s includes
    the largest weight twice.

    Args:
        value: w·1_F of every draw, shape (n,); without weights 1 for events and 0 for others.
        nominal: all nominal draws.
        weighted: whether the draws are weighted.

    >>> event = np.arange(1_000) < 3
    >>> estimate_of(event.astype(float), Tally(1_000, 3), weighted=False).probability
    0.003
    """
    n, events = len(value), int(np.count_nonzero(value))
    if events == 0:
        return Estimate(None, None, 0.0, nominal.high, 0.0, None, n, 0, nominal)
    total = float(value.sum())
    p, largest = total / n, float(value.max()) / total
    size = total**2 / float(np.sum(value**2))
    cv = float(value.std(ddof=1)) / math.sqrt(n) / p
    if not weighted:
        return Estimate(p, cv, *clopper_pearson(events, n), size, largest, n, events, nominal)
    quantile = float(stats.t.ppf((1 + CONFIDENCE) / 2, max(size - 1, 1)))
    factor = math.exp(quantile * math.hypot(cv, largest))
    return Estimate(p, cv, p / factor, min(1.0, p * factor), size, largest, n, events, nominal)
