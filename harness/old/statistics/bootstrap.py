"""The BCa bootstrap of means, coefficients of variation and ratios.

Intervals are two-sided, 95 % by default.  Undefined values are None.
"""

import copy
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from harness.core.encounter import FloatArray
from harness.old.statistics.intervals import CONFIDENCE, Interval

RESAMPLES = 4_999
"""Bootstrap resamples; fewer above 4,000 values, see ``_resamples``."""

FEWEST_RESAMPLES = 1_999

_DRAWS_IN_MEMORY = 2_000_000

_DIGITS = 9
"""Values that agree to this many decimals count as equal, because sums have rounding errors."""

_RESAMPLES_BEYOND = 20
"""At least this many resamples lie beyond each limit of an interval."""


@dataclass(frozen=True, slots=True)
class Resampled(Interval):
    """A bootstrap's interval, and the number of values that inform it.

    ``informative`` is the number of values that differ from the most common one.  With a flow of
    pedestrians the most common value usually belongs to pairs that met nobody.  If no two values
    are equal, all are informative.
    """

    informative: int

    def columns(self, name: str, kind: str = "ci") -> dict[str, float | None]:
        """The columns of an interval, and ``<name>_<kind>_informative``."""
        limits = Interval.columns(self, name, kind)
        return {**limits, f"{name}_{kind}_informative": self.informative}


UNKNOWN = Resampled(None, None, None, 0)


def coefficient_of_variation(values: FloatArray) -> FloatArray:
    """Population standard deviation over the mean, along the last axis."""
    result: FloatArray = np.std(values, axis=-1) / np.mean(values, axis=-1)
    return result


def bootstrap_mean(
    values: FloatArray, rng: np.random.Generator | None, confidence: float = CONFIDENCE
) -> Resampled:
    """Mean with its BCa interval.

    Args:
        values: shape (n,), finite.
        rng: draws the resamples, in batches of bounded memory; None: no interval is computed.
        confidence: two-sided confidence of the interval.

    Returns:
        If all values are equal, the interval is that point.  With n = 1 there is no interval; with
        n = 0 everything is None.
    """
    n = len(values)
    if n == 0:
        return UNKNOWN
    mean, informative = float(np.mean(values)), _informative(values)
    if n == 1 or rng is None:
        return Resampled(mean, None, None, informative)
    if informative == 0:
        return Resampled(mean, mean, mean, 0)
    total = _resamples(n, confidence)
    means = np.concatenate([np.mean(sample, axis=-1) for sample in _samples(values, rng, total)])
    return _bca(mean, means, mean - (values - mean) / (n - 1), informative, confidence)


def bootstrap_mean_and_cv(
    values: FloatArray, rng: np.random.Generator | None, confidence: float = CONFIDENCE
) -> tuple[Resampled, Resampled]:
    """Mean and coefficient of variation with BCa intervals from the same resamples.

    Arguments and results are as in ``bootstrap_mean``; c_v needs a positive mean.
    """
    n, informative = len(values), _informative(values)
    if n < 2 or informative == 0:
        spread = UNKNOWN if n < 2 else Resampled(0.0, 0.0, 0.0, 0)
        return bootstrap_mean(values, rng, confidence), spread
    mean, cv = float(np.mean(values)), float(coefficient_of_variation(values))
    if rng is None:
        return Resampled(mean, None, None, informative), Resampled(cv, None, None, informative)
    means, cvs = [], []
    for sample in _samples(values, rng, _resamples(n, confidence)):
        means.append(np.mean(sample, axis=-1))
        with np.errstate(divide="ignore", invalid="ignore"):
            cvs.append(np.std(sample, axis=-1) / means[-1])
    deviation = values - mean
    left_out_mean = mean - deviation / (n - 1)
    # Variance without value i, computed from Σd² of all values: it needs no n × n table.
    left_out_variance = (np.sum(deviation**2) - deviation**2) / (n - 1) - (deviation / (n - 1)) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        left_out_cv = np.sqrt(np.maximum(left_out_variance, 0.0)) / left_out_mean
    return (
        _bca(mean, np.concatenate(means), left_out_mean, informative, confidence),
        _bca(cv, np.concatenate(cvs), left_out_cv, informative, confidence),
    )


def bootstrap_ratio(
    numerators: FloatArray,
    denominators: FloatArray,
    rng: np.random.Generator | None,
    confidence: float = CONFIDENCE,
) -> Resampled:
    """Ratio of two sums, Σ numerators / Σ denominators, with its BCa interval.

    Args:
        numerators: one for each unit that is resampled, shape (n,), finite.
        denominators: one for each unit, shape (n,), finite, ≥ 0.
        rng: draws the resamples, in batches of bounded memory; None: no interval is computed.
        confidence: two-sided confidence of the interval.

    Returns:
        Everything is None if all denominators are 0.  There is no interval if the denominators sum
        to 0 in a resample or after one unit is left out, because too few units count then.
    """
    n, total = len(numerators), float(np.sum(denominators))
    if total == 0:
        return UNKNOWN
    value = float(np.sum(numerators)) / total
    rest, informative = total - denominators, _informative(numerators - value * denominators)
    if n < 2 or rng is None or (rest == 0).any():
        return Resampled(value, None, None, informative)
    if informative == 0:
        return Resampled(value, value, value, 0)
    left_out = (np.sum(numerators) - numerators) / rest
    ratios = []
    for drawn in _draws(n, rng, _resamples(n, confidence)):
        below = denominators.take(drawn).sum(axis=-1)
        if (below == 0).any():
            return Resampled(value, None, None, informative)
        ratios.append(numerators.take(drawn).sum(axis=-1) / below)
    return _bca(value, np.concatenate(ratios), left_out, informative, confidence)


def _informative(values: FloatArray) -> int:
    """The number of values other than the most common one (up to rounding); n if all differ."""
    _, counts = np.unique(np.round(values, _DIGITS), return_counts=True)
    most = int(counts.max(initial=0))
    return len(values) - (most if most > 1 else 0)


def _resamples(n: int, confidence: float) -> int:
    """The number of resamples: 4,999 up to 4,000 values, 1,999 from 10,000 on, to bound the work.

    There are more if otherwise too few would lie beyond the limits at this confidence.
    """
    beyond = round(_RESAMPLES_BEYOND / ((1 - confidence) / 2))
    return max(FEWEST_RESAMPLES, min(RESAMPLES, 20_000_000 // n), beyond)


def _samples(values: FloatArray, rng: np.random.Generator, total: int) -> Iterator[FloatArray]:
    """``total`` resamples, in batches of shape (some, n)."""
    for drawn in _draws(len(values), rng, total):
        yield values.take(drawn)


def _draws(n: int, rng: np.random.Generator, total: int) -> Iterator[NDArray[np.int64]]:
    """The indices of the values in each of ``total`` resamples, in batches of shape (some, n).

    The generator is copied and keeps its state, so the same values always have the same interval.
    """
    rng = copy.deepcopy(rng)
    batch = max(1, _DRAWS_IN_MEMORY // n)
    for begin in range(0, total, batch):
        yield rng.integers(0, n, size=(min(batch, total - begin), n))


def _bca(
    estimate: float,
    resampled: FloatArray,
    left_out: FloatArray,
    informative: int,
    confidence: float,
) -> Resampled:
    """Efron (1987): percentiles shifted by the bias z0 and the acceleration a."""
    # Sums of the same values in another order differ only in their last bits.
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
        return Resampled(estimate, None, None, informative)
    low, high = np.quantile(resampled, levels)
    return Resampled(estimate, float(low), float(high), informative)
