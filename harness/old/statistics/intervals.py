"""Point estimates with intervals: Student's t for means, Clopper–Pearson for shares.

Intervals are two-sided, 95 % by default.  Undefined values are None.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from harness.core.encounter import FloatArray

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Interval:
    """A point estimate with its two-sided interval; None if undefined."""

    value: float | None
    low: float | None
    high: float | None

    @property
    def half_width(self) -> float | None:
        """Half of the distance between the limits; None if there is no interval."""
        return None if self.low is None or self.high is None else (self.high - self.low) / 2

    def within(self, least: float = -math.inf, most: float = math.inf) -> "Interval":
        """The interval cut at the possible range of the value, which loses no coverage."""
        if self.low is None or self.high is None:
            return self
        return Interval(self.value, max(self.low, least), min(self.high, most))


UNDEFINED = Interval(None, None, None)


@dataclass(frozen=True, slots=True)
class Proportion(Interval):
    """A share of ``trials`` with its interval."""

    successes: int
    trials: int


UNKNOWN_PROPORTION = Proportion(None, None, None, 0, 0)


def student_mean(values: FloatArray, confidence: float = CONFIDENCE) -> Interval:
    """Mean with Student's t interval; fewer than two different values have no interval.

    Equal values do not show their spread, so an interval without width would claim too much.

    >>> student_mean(np.array([1.0, 2.0, 3.0]))
    Interval(value=2.0, low=-0.484137711..., high=4.484137711...)
    >>> student_mean(np.array([2.0, 2.0]))
    Interval(value=2.0, low=None, high=None)
    """
    count = len(values)
    if count == 0:
        return UNDEFINED
    mean = float(np.mean(values))
    if np.all(values == values[0]):
        return Interval(mean, None, None)
    error = float(np.std(values, ddof=1)) / np.sqrt(count)
    reach = float(special.stdtrit(count - 1, (1 + confidence) / 2) * error)
    return Interval(mean, mean - reach, mean + reach)


def student_ratio(
    numerators: FloatArray, denominators: FloatArray, confidence: float = CONFIDENCE
) -> Interval:
    """Ratio of two sums, Σ a / Σ b, with the interval of Fieller (1954).

    The interval holds all ρ for which Student's t test does not reject that the mean of a − ρ b is
    0.  It is exact for any number of normally distributed (a, b).

    Args:
        numerators: a, one for each unit, shape (n,), finite.
        denominators: b, one for each unit, shape (n,), finite.
        confidence: two-sided confidence of the interval.

    Returns:
        Undefined if Σ b is 0; there is no interval for fewer than two units, or if it is unbounded.

    >>> student_ratio(np.array([20.0, 23.0, 23.0]), np.array([10.0, 11.0, 12.0]))
    Interval(value=2.0, low=1.7..., high=2.2...)
    """
    count, total = len(numerators), float(np.sum(denominators))
    if total == 0:
        return UNDEFINED
    value = float(np.sum(numerators)) / total
    if count < 2:
        return Interval(value, None, None)
    a, b = float(np.mean(numerators)), float(np.mean(denominators))
    reach = float(special.stdtrit(count - 1, (1 + confidence) / 2)) ** 2 / count
    (a_variance, covariance), (_, b_variance) = (reach * np.cov(numerators, denominators)).tolist()
    # (a − ρ b)² = reach · Var(a − ρ b), a quadratic in ρ.
    square, linear, constant = b**2 - b_variance, a * b - covariance, a**2 - a_variance
    if square <= 0:
        return Interval(value, None, None)
    root = math.sqrt(max(0.0, linear**2 - square * constant))
    return Interval(value, (linear - root) / square, (linear + root) / square)


def clustered_proportion(
    successes: FloatArray, trials: FloatArray, confidence: float = CONFIDENCE
) -> Proportion:
    """A proportion of trials that come in clusters, within which they may be correlated.

    The interval is Korn and Graubard's (1998): Clopper and Pearson's for the effective number of
    trials.  The effective number is the number of trials, divided by the design effect and times
    (t_trials / t_clusters)², where t is Student's quantile.  The design effect is the variance
    between clusters over the binomial variance; it is at least 1, and 1 if the binomial variance is
    0.

    Args:
        successes: number of successes in each cluster, shape (k,).
        trials: number of trials in each cluster, shape (k,).
        confidence: two-sided confidence of the interval.

    Returns:
        Undefined if there are no trials; a single cluster has no interval.

    >>> ones = np.ones(1_000)
    >>> clustered_proportion(np.arange(1_000) % 10 == 0, ones)  # nearly Clopper and Pearson's
    Proportion(value=0.1, low=0.082..., high=0.120..., successes=100, trials=1000)
    >>> clustered_proportion(np.repeat([1, 0], [1, 9]), 100 * np.ones(10))
    Proportion(value=0.001, low=8.828...e-06, high=0.00680..., successes=1, trials=1000)
    """
    clusters, events, count = len(trials), int(np.sum(successes)), int(np.sum(trials))
    if count == 0:
        return UNKNOWN_PROPORTION
    share = events / count
    if clusters == 1:
        return Proportion(share, None, None, events, count)
    between = clusters / (clusters - 1) * float(np.sum((successes - share * trials) ** 2))
    within = count * share * (1 - share)
    effect = max(1.0, between / within) if within else 1.0
    tail = (1 + confidence) / 2
    worth = float(special.stdtrit(count - 1, tail) / special.stdtrit(clusters - 1, tail)) ** 2
    equivalent = count / effect * min(1.0, worth)
    return Proportion(
        share, *clopper_pearson(share * equivalent, equivalent, confidence), events, count
    )


def clopper_pearson(
    successes: float, trials: float, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """The exact interval of a proportion (Clopper and Pearson 1934), by beta quantiles."""
    tail, failures = (1 - confidence) / 2, trials - successes
    low = special.betaincinv(successes, failures + 1, tail) if successes else 0.0
    high = special.betaincinv(successes + 1, failures, 1 - tail) if failures else 1.0
    return float(low), float(high)


def zero_bound(high: float, confidence: float = CONFIDENCE) -> float:
    """Upper one-sided 95 % bound of a proportion if no success was observed.

    Args:
        high: the upper limit of its two-sided Clopper–Pearson interval, for the effective number of
            trials.
        confidence: confidence of that interval.

    >>> round(zero_bound(clopper_pearson(0, 50)[1]), 4)  # 1 − 0.05^(1/50)
    0.0582
    """
    return float(1 - (1 - high) ** (np.log(1 - CONFIDENCE) / np.log((1 - confidence) / 2)))
