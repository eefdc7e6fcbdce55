"""Point estimates with intervals: BCa bootstrap for means and c_v, Clopper–Pearson for shares.

Intervals are two-sided 95 % unless asked otherwise.  Undefined is None.
"""

import copy
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from harness.encounter import FloatArray

CONFIDENCE = 0.95

RESAMPLES = 4_999
"""Bootstrap resamples; fewer above 4,000 values, see ``_resamples``."""

INDICATIVE_BELOW = {
    "mu": 1_000,
    "cv": 4_000,
    "delay_s": 200,
    "delay_human_s": 50,
    "mu_all": 1_000,
    "time_ratio": 1_000,
    "time_ratio_worst": 1_000,
    "delay_worst_s": 1_000,
    "mu_worst": 1_000,
    "delay_difference_human_s": 1_000,
    "pedestrian_delay_s": 200,
    "pedestrian_delay_human_s": 200,
    "mu_met_someone": 1_000,
    "delay_met_someone_s": 200,
    "delay_human_met_someone_s": 200,
}
"""Fewer pairs than this cover less than 93.5 % in a shipped scenario (docs/method.md)."""

INDICATIVE_COMPARED_BELOW = {
    "time_ratio_difference": 2_000,
    "mu_difference": 2_000,
    "mu_worst_difference": 2_000,
    "delay_difference_s": 1_000,
    "mu_bound": 2_000,
}
"""The same for paired differences, and for the upper bound of μ in a sweep of a parameter."""

_DRAWS_IN_MEMORY = 2_000_000

_RESAMPLES_BEYOND = 20
"""At least so many resamples lie beyond each limit of an interval."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A point estimate with its two-sided interval; None where undefined."""

    value: float | None
    low: float | None
    high: float | None

    @property
    def half_width(self) -> float | None:
        """Half of the distance between the limits; None where there are none."""
        return None if self.low is None or self.high is None else (self.high - self.low) / 2

    def columns(self, name: str, kind: str = "ci") -> dict[str, float | None]:
        """The value under a name, its limits under ``<name>_<kind>_low`` and ``_high``."""
        return {name: self.value, f"{name}_{kind}_low": self.low, f"{name}_{kind}_high": self.high}

    def words(self, form: str) -> str:
        """The value with its limits, where there are any; ``form`` as in ``format``."""
        if self.value is None:
            return "undefined"
        if self.low is None or self.high is None:
            return f"{self.value:{form}}"
        return f"{self.value:{form}} ({self.low:{form}} … {self.high:{form}})"


UNDEFINED = Interval(None, None, None)


@dataclass(frozen=True, slots=True)
class Proportion(Interval):
    """A share of ``trials`` with its interval."""

    successes: int
    trials: int


UNKNOWN_PROPORTION = Proportion(None, None, None, 0, 0)


def coefficient_of_variation(values: FloatArray) -> FloatArray:
    """Population standard deviation over the mean, along the last axis."""
    result: FloatArray = np.std(values, axis=-1) / np.mean(values, axis=-1)
    return result


def student_mean(values: FloatArray, confidence: float = CONFIDENCE) -> Interval:
    """Mean with Student's t interval; no interval of fewer than two values.

    >>> student_mean(np.array([1.0, 2.0, 3.0]))
    Interval(value=2.0, low=-0.484137711..., high=4.484137711...)
    """
    count = len(values)
    if count == 0:
        return UNDEFINED
    mean = float(np.mean(values))
    if count == 1:
        return Interval(mean, None, None)
    error = float(np.std(values, ddof=1)) / np.sqrt(count)
    reach = float(special.stdtrit(count - 1, (1 + confidence) / 2) * error)
    return Interval(mean, mean - reach, mean + reach)


def bootstrap_mean(
    values: FloatArray, rng: np.random.Generator, confidence: float = CONFIDENCE
) -> Interval:
    """Mean with its BCa interval.

    Args:
        values: shape (n,), finite.
        rng: draws the resamples, in batches of bounded memory.
        confidence: of the interval, two-sided.

    Returns:
        Zero spread gives the point as its own interval; n = 1 gives no interval; n = 0 nothing.
    """
    n = len(values)
    if n == 0:
        return UNDEFINED
    mean = float(np.mean(values))
    if n == 1:
        return Interval(mean, None, None)
    if np.ptp(values) == 0:
        return Interval(mean, mean, mean)
    total = _resamples(n, confidence)
    means = np.concatenate([np.mean(sample, axis=-1) for sample in _samples(values, rng, total)])
    return _bca(mean, means, mean - (values - mean) / (n - 1), confidence)


def bootstrap_mean_and_cv(
    values: FloatArray, rng: np.random.Generator, confidence: float = CONFIDENCE
) -> tuple[Interval, Interval]:
    """Mean and coefficient of variation with BCa intervals from the same resamples.

    As ``bootstrap_mean``; c_v needs a positive mean.
    """
    n = len(values)
    if n < 2 or np.ptp(values) == 0:
        spread = UNDEFINED if n < 2 else Interval(0.0, 0.0, 0.0)
        return bootstrap_mean(values, rng, confidence), spread
    mean, cv = float(np.mean(values)), float(coefficient_of_variation(values))
    means, cvs = [], []
    for sample in _samples(values, rng, _resamples(n, confidence)):
        means.append(np.mean(sample, axis=-1))
        with np.errstate(divide="ignore", invalid="ignore"):
            cvs.append(np.std(sample, axis=-1) / means[-1])
    deviation = values - mean
    left_out_mean = mean - deviation / (n - 1)
    # Variance without value i, from Σd² of the whole: no n × n table.
    left_out_variance = (np.sum(deviation**2) - deviation**2) / (n - 1) - (deviation / (n - 1)) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        left_out_cv = np.sqrt(np.maximum(left_out_variance, 0.0)) / left_out_mean
    return (
        _bca(mean, np.concatenate(means), left_out_mean, confidence),
        _bca(cv, np.concatenate(cvs), left_out_cv, confidence),
    )


def bootstrap_ratio(
    numerators: FloatArray,
    denominators: FloatArray,
    rng: np.random.Generator,
    confidence: float = CONFIDENCE,
) -> Interval:
    """Ratio of two sums, Σ numerators / Σ denominators, with its BCa interval.

    Args:
        numerators: one for each unit that is resampled, shape (n,), finite.
        denominators: likewise, ≥ 0.
        rng: draws the resamples, in batches of bounded memory.
        confidence: of the interval, two-sided.

    Returns:
        None for all where the denominators are all 0.  No interval where a sum without one unit,
        or the sum of a resample, has a denominator of 0: too few units count then.
    """
    n, total = len(numerators), float(np.sum(denominators))
    if total == 0:
        return UNDEFINED
    value = float(np.sum(numerators)) / total
    rest = total - denominators
    if n < 2 or (rest == 0).any():
        return Interval(value, None, None)
    left_out = (np.sum(numerators) - numerators) / rest
    if np.ptp(left_out) < 1e-12 * max(1.0, abs(value)):
        return Interval(value, value, value)
    ratios = []
    for drawn in _draws(n, rng, _resamples(n, confidence)):
        below = denominators.take(drawn).sum(axis=-1)
        if (below == 0).any():
            return Interval(value, None, None)
        ratios.append(numerators.take(drawn).sum(axis=-1) / below)
    return _bca(value, np.concatenate(ratios), left_out, confidence)


def proportion(successes: int, trials: int, confidence: float = CONFIDENCE) -> Proportion:
    """A proportion with its Clopper–Pearson interval; undefined for no trials."""
    if trials == 0:
        return UNKNOWN_PROPORTION
    return Proportion(
        successes / trials, *clopper_pearson(successes, trials, confidence), successes, trials
    )


def clustered_proportion(
    successes: FloatArray, trials: FloatArray, confidence: float = CONFIDENCE
) -> Proportion:
    """A proportion of trials that come in clusters, within which they may go together.

    The interval of Korn and Graubard (1998): Clopper and Pearson's for as many independent trials
    as tell as much: the trials over the design effect, which is the variance between clusters over
    the binomial one and counts as 1 where it is smaller or there is nothing to tell it from; times
    the squared ratio of Student's t for the trials to that for the clusters.

    Args:
        successes: of each cluster, shape (k,).
        trials: likewise.
        confidence: of the interval, two-sided.

    Returns:
        Undefined for no trials; no interval for a single cluster.

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
    """The exact interval of a proportion (Clopper and Pearson 1934), by quantiles of the beta."""
    tail, failures = (1 - confidence) / 2, trials - successes
    low = special.betaincinv(successes, failures + 1, tail) if successes else 0.0
    high = special.betaincinv(successes + 1, failures, 1 - tail) if failures else 1.0
    return float(low), float(high)


def zero_bound(trials: int) -> float:
    """Upper one-sided 95 % bound of a proportion of which 0 of ``trials`` were seen."""
    return float(1 - (1 - CONFIDENCE) ** (1 / trials))


def _resamples(n: int, confidence: float) -> int:
    """So many that the work stays bounded: 4,999 up to 4,000 values, 1,999 from 10,000 on.

    More where the confidence leaves too few beyond the limits otherwise.
    """
    beyond = round(_RESAMPLES_BEYOND / ((1 - confidence) / 2))
    return max(1_999, min(RESAMPLES, 20_000_000 // n), beyond)


def _samples(values: FloatArray, rng: np.random.Generator, total: int) -> Iterator[FloatArray]:
    """``total`` resamples, in batches of shape (some, n)."""
    for drawn in _draws(len(values), rng, total):
        yield values.take(drawn)


def _draws(n: int, rng: np.random.Generator, total: int) -> Iterator[NDArray[np.int64]]:
    """Which of n values each of ``total`` resamples takes, in batches of shape (some, n).

    The generator is copied and never goes on: the same values have the same interval wherever they
    stand, whatever else was resampled before.
    """
    rng = copy.deepcopy(rng)
    batch = max(1, _DRAWS_IN_MEMORY // n)
    for begin in range(0, total, batch):
        yield rng.integers(0, n, size=(min(batch, total - begin), n))


def _bca(
    estimate: float, resampled: FloatArray, left_out: FloatArray, confidence: float
) -> Interval:
    """Efron (1987): percentiles shifted by the bias z0 and the acceleration a."""
    # A resample of the same values summed in another order is the same, whatever its last bit.
    same = 1e-9 * np.ptp(resampled)
    below = (np.mean(resampled < estimate - same) + np.mean(resampled <= estimate + same)) / 2
    bias = special.ndtri(below)
    influence = np.mean(left_out) - left_out
    scale = np.sum(influence**2) ** 1.5
    acceleration = np.sum(influence**3) / (6 * scale) if scale > 0 else 0.0
    tail = (1 - confidence) / 2
    z = bias + special.ndtri(np.array([tail, 1 - tail]))
    levels = special.ndtr(bias + z / (1 - acceleration * z))
    if not np.isfinite(levels).all():
        return Interval(estimate, None, None)
    low, high = np.quantile(resampled, levels)
    return Interval(estimate, float(low), float(high))
