"""A probability from weighted draws, with its interval."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from harness.comparison.intervals import CONFIDENCE, clopper_pearson, zero_bound
from harness.encounter import FloatArray
from harness.risk.proposal import NOMINAL_SHARE


@dataclass(frozen=True, slots=True)
class Estimate:
    """A probability with its two-sided interval; None where no draw was in the event.

    Then ``ci_high`` is the one-sided bound that the draws give.

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


def estimate_of(weight: FloatArray, event: NDArray[np.bool_]) -> Estimate:
    """Mean of w·1_F with its interval.

    Where all weights are 1 the interval is Clopper–Pearson's.  Else it is the one of Student's t on
    the scale of ln p, p̂ exp(± t s/(p̂ √n)), as weights and estimate are skew.  Large weights are
    rare, so the spread s of most samples is too small: one more of the largest is counted in it.

    Args:
        weight: φ/q of every draw, shape (n,).
        event: whether the draw is in the event, shape (n,).

    >>> estimate_of(np.ones(1_000), np.arange(1_000) < 3).probability
    0.003
    """
    n, events = len(weight), int(event.sum())
    if events == 0:
        # Weighted draws: no weight exceeds 1/NOMINAL_SHARE.
        most = 1.0 if np.all(weight == 1) else 1 / NOMINAL_SHARE
        return Estimate(None, None, 0.0, min(1.0, most * zero_bound(n)), 0.0, None, n, 0)
    values = weight * event
    total = float(values.sum())
    p, largest = total / n, float(values.max()) / total
    size = total**2 / float(np.sum(values**2))
    cv = float(values.std(ddof=1)) / math.sqrt(n) / p
    if np.all(weight == 1):
        return Estimate(p, cv, *clopper_pearson(events, n), size, largest, n, events)
    quantile = float(stats.t.ppf((1 + CONFIDENCE) / 2, max(events - 1, 1)))
    factor = math.exp(quantile * math.hypot(cv, largest))
    return Estimate(p, cv, p / factor, min(1.0, p * factor), size, largest, n, events)
