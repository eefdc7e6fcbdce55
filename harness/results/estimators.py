"""Estimators: arrays of one value a pair in, a finding with its interval out.

Intervals are two-sided.  Means, ratios and spreads have the BCa bootstrap's (Efron 1987) over
pairs, shares the exact one (Clopper and Pearson 1934), quantiles that between two order statistics.
"""

import copy
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import special

from harness.core.vocabulary import ROUNDING, BoolArray, FloatArray
from harness.results.finding import Finding

CONFIDENCE = 0.95

RESAMPLES, FEWEST_RESAMPLES = 4_999, 1_999
"""Bootstrap resamples: the first number up to 4,000 values, the second from 10,000 values on."""

_DRAWS_IN_MEMORY, _DRAWS = 500_000, 20_000_000
"""Draws of a batch, and of all resamples of many values."""

_KEPT, _NARROWER = 10_000, 10
"""The most values whose resamples are kept: 20 MB, at high confidence 80.  They are fewer if tails
are over ten times smaller than at 95 %, which takes more resamples."""

_RESAMPLES_BEYOND = 20
"""At least this many resamples lie beyond each limit of an interval."""

_DIGITS = 9
"""Values that agree to this many decimals are equal, because sums have rounding errors."""

_FLIPPED = 16
"""The largest differences whose signs a sign-flip test enumerates."""

EQUAL = "the same in every pair, so it has no interval"
FEW = "too few informative pairs for an interval"
FEW_BEYOND = "too few values lie beyond it for an interval"
REPEATED = "all episodes are equal, so the share has no interval"


class Sampling(NamedTuple):
    """How intervals are made.

    Attributes:
        rng: the generator of resamples; None: there are no bootstrap intervals.
        confidence: two-sided confidence; 0: there are no intervals.
        repeated: whether all trials of a share repeat the same one; they are no sample then.
        tested: whether a mean or ratio has a p: of the interval that ends at 0.
    """

    rng: np.random.Generator | None
    confidence: float = CONFIDENCE
    repeated: bool = False
    tested: bool = False


def mean(values: FloatArray, sampling: Sampling) -> Finding:
    """The mean of the defined values.

    Args:
        values: shape (n,), NaN where undefined.
        sampling: see ``Sampling``.

    Returns:
        Undefined without a value.  There is no interval if all values are equal.
    """
    values = values[~np.isnan(values)]
    return _of_means(values[None], lambda means: means[0], values, sampling)


def coefficient_of_variation(values: FloatArray, sampling: Sampling) -> Finding:
    """Population standard deviation over the mean of the defined values; see ``mean``.

    Undefined for fewer than two values.
    """
    values = values[~np.isnan(values)]
    if len(values) < 2:
        return Finding(None, n=0)
    centre = np.mean(values)

    def of(means: FloatArray) -> FloatArray:
        variance = np.maximum(means[1] - means[0] ** 2, 0.0)
        return np.asarray(np.sqrt(variance) / (centre + means[0]))

    deviations = values - centre  # whose squares lose no digits
    return _of_means(np.array([deviations, deviations**2]), of, values, sampling)


def ratio(numerators: FloatArray, denominators: FloatArray, sampling: Sampling) -> Finding:
    """Σ numerators / Σ denominators over the pairs in which both are defined.

    Args:
        numerators: shape (n,), NaN where undefined.
        denominators: the same shape, ≥ 0.
        sampling: see ``Sampling``.

    Returns:
        Undefined if the denominators sum to 0.  There is no interval if they do so in a resample or
        without one pair, because too few pairs count then.
    """
    known = ~(np.isnan(numerators) | np.isnan(denominators))
    above, below = numerators[known], denominators[known]
    if not (total := float(np.sum(below))):
        return Finding(None, n=0)
    value, counting = float(np.sum(above)) / total, int(np.count_nonzero(below))
    if counting < 2:  # its residuals are 0, as if all were equal
        return Finding(value, n=counting, reason=FEW if sampling.rng else None)
    residuals = above - value * below
    both = np.array([above, below])
    return _of_means(both, lambda means: means[0] / means[1], residuals, sampling)


def share(marked: BoolArray, trials: BoolArray, sampling: Sampling) -> Finding:
    """The share of marked trials with its exact interval.

    Args:
        marked: shape (n,), bool.
        trials: which entries are trials, the same shape.
        sampling: see ``Sampling``.

    Returns:
        Undefined without a trial.
    """
    n, events = int(np.count_nonzero(trials)), int(np.count_nonzero(marked & trials))
    if n == 0:
        return Finding(None, n=0, events=0)
    if sampling.repeated or not sampling.confidence:
        reason = REPEATED if sampling.repeated else None
        return Finding(events / n, n=n, events=events, reason=reason)
    low, high = clopper_pearson(events, n, sampling.confidence)
    return Finding(events / n, low, high, n, events, reliable=True)


def quantile(values: FloatArray, level: float, confidence: float) -> Finding:
    """The smallest value that at least a share ``level`` of the defined values do not exceed.

    The interval is that between order statistics at the binomial's quantiles, which holds for every
    distribution (Hahn and Meeker 1991, section 5.2).  There is none if too few values lie beyond.
    """
    ordered = np.sort(values[~np.isnan(values)])
    n = len(ordered)
    if n == 0:
        return Finding(None)
    value = float(ordered[max(0, math.ceil(level * n - ROUNDING) - 1)])
    # P(B ≤ k) for k = 0 … n − 1, with B the number of values below the population's quantile.
    at_most, tail = special.bdtr(np.arange(n), n, level), (1 - confidence) / 2
    above, below = np.flatnonzero(at_most >= 1 - tail), np.flatnonzero(at_most <= tail)
    if not confidence or not len(above) or not len(below):
        return Finding(value, reason=FEW_BEYOND if confidence else None)
    return Finding(value, float(ordered[below[-1]]), float(ordered[above[0]]), reliable=True)


def clopper_pearson(events: float, trials: float, confidence: float) -> tuple[float, float]:
    """The exact two-sided interval of a share (Clopper and Pearson 1934), by beta quantiles."""
    tail, rest = (1 - confidence) / 2, trials - events
    low = special.betaincinv(events, rest + 1, tail) if events else 0.0
    high = special.betaincinv(events + 1, rest, 1 - tail) if rest else 1.0
    return float(low), float(high)


def zero_bound(high: float, confidence: float = CONFIDENCE) -> float:
    """The one-sided 95 % bound of a share at 0 events, from the two-sided upper limit ``high``.

    >>> round(zero_bound(clopper_pearson(0, 50, 0.95)[1]), 4)  # 1 − 0.05^(1/50)
    0.0582
    """
    return float(1 - (1 - high) ** (np.log(1 - CONFIDENCE) / np.log((1 - confidence) / 2)))


def difference(
    a: FloatArray, b: FloatArray, sampling: Sampling, over: FloatArray | None = None
) -> Finding:
    """The mean of a − b over the pairs in which both are defined, with a p that it is 0.

    With ``over`` it is Σ(a − b) / Σ over, of the pairs in which all are defined.  ``n`` is the
    number of pairs that differ.  p is the larger of two, that of the sign-flip test and that of the
    BCa interval that ends at 0, and below 1 − confidence only where the interval excludes 0.  If no
    resample lies beyond 0, the latter is below what the resamples resolve, and does not count.  The
    sign-flip test needs both, because a bootstrap's interval excludes 0 whenever few pairs differ
    and all of them in one direction; the interval, because few large differences against many
    small ones are no sign of a mean.
    """
    over = np.ones(len(a)) if over is None else over
    differences = np.where(np.abs(a - b) < ROUNDING, 0.0, a - b)
    found = ratio(differences, over, sampling._replace(tested=True))
    known, low, high = differences[~np.isnan(differences + over)], found.low, found.high
    if found.value is None:
        return replace(found, n=0, p=None)
    p, least = sign_flip_p(known), 1 - sampling.confidence
    p = p if found.p is None else max(p, found.p)
    if low is not None and high is not None:
        if low <= 0.0 <= high:
            p = max(p, least)
        if p >= least:
            low, high = min(low, 0.0), max(high, 0.0)
    return replace(found, low=low, high=high, n=int(np.count_nonzero(known)), p=p)


def share_difference(a: BoolArray, b: BoolArray, ran_a: BoolArray, ran_b: BoolArray) -> Finding:
    """The difference of two shares of marked pairs, with McNemar's exact p (1947).

    Given b + c discordant pairs, b is binomial with share ½.  ``n`` is the number of trials that
    ran in both; undefined without one.
    """
    ran = ran_a & ran_b
    only_a, only_b = (int(np.count_nonzero(ran & x & ~y)) for x, y in ((a, b), (b, a)))
    n, discordant = int(np.count_nonzero(ran)), only_a + only_b
    p = min(1.0, 2 * float(special.bdtr(min(only_a, only_b), discordant, 0.5)))
    return Finding((only_a - only_b) / n if n else None, n=n, events=discordant, p=p if n else None)


def sign_flip_p(differences: FloatArray) -> float:
    """Two-sided p of the sum of paired differences under random signs (Fisher 1935).

    The signs of the 16 largest differences are enumerated; the sum of the others is taken as normal
    with their sum of squares as its variance.  With at most 16 differences the test is exact: k
    differences of one sign have p = 2^(1 − k).

    Args:
        differences: shape (n,), finite.
    """
    sizes = np.sort(np.abs(differences[differences != 0]))[::-1]
    sums = np.zeros(1)
    for size in sizes[:_FLIPPED]:
        sums = np.concatenate([sums - size, sums + size])
    total = abs(float(np.sum(differences)))
    if len(sizes) <= _FLIPPED:
        beyond = np.mean(sums >= total * (1 - ROUNDING))
    else:
        # The continuity correction is half the step between two sums if all sizes are equal.
        gap = (sums + sizes[-1] - total) / np.sqrt(np.sum(sizes[_FLIPPED:] ** 2))
        beyond = np.mean(special.ndtr(gap))
    return min(1.0, 2 * float(beyond))


def informative(values: FloatArray) -> int:
    """The number of values other than the most common one (up to rounding); n if all differ.

    With a flow of people the most common value is usually that of pairs that met nobody.
    """
    _, counts = np.unique(np.round(values, _DIGITS), return_counts=True)
    most = int(counts.max(initial=0))
    return len(values) - (most if most > 1 else 0)


def _of_means(
    columns: FloatArray,
    of: Callable[[FloatArray], FloatArray],
    residuals: FloatArray,
    sampling: Sampling,
) -> Finding:
    """A function of means over pairs, with its BCa interval (Efron 1987).

    Args:
        columns: what has these means, shape (k, n).
        of: the estimate from means of shape (k,), or several from (k, some).
        residuals: the values by which pairs inform it, shape (n,).
        sampling: see ``Sampling``.
    """
    n, informing = len(residuals), informative(residuals)
    if n == 0:
        return Finding(None, n=0)
    means = np.mean(columns, axis=-1)
    value = float(of(means))
    if n > 1 and informing == 0:
        return Finding(value, n=0, reason=EQUAL)
    without = Finding(value, n=informing, reason=FEW)
    if sampling.rng is None or n < 2:
        return Finding(value, n=informing) if sampling.rng is None else without
    with np.errstate(divide="ignore", invalid="ignore"):
        left_out = of((n * means[:, None] - columns) / (n - 1))
        kept = _KEPT * min(1.0, _NARROWER * (1 - sampling.confidence) / (1 - CONFIDENCE))
        resamples = (_kept if n <= kept else _resamples)(n, sampling.rng, sampling.confidence)
        # Unlike those of BLAS, these sums do not depend on a number of threads.
        sums = (np.einsum("cn,rn->cr", columns, times) for times in resamples)
        resampled = np.concatenate([of(each / n) for each in sums])
    if not (np.isfinite(left_out).all() and np.isfinite(resampled).all()):
        return without
    # Sums of the same values in another order differ only in their last bits.
    same = ROUNDING * np.ptp(resampled)

    def normal(at: float) -> float:
        """The standard normal quantile of the share of resamples below a value."""
        share = np.mean(resampled < at - same) + np.mean(resampled <= at + same)
        return float(special.ndtri(share / 2))

    bias = normal(value)
    influence = np.mean(left_out) - left_out
    scale = np.sum(influence**2) ** 1.5
    acceleration = np.sum(influence**3) / (6 * scale) if scale > 0 else 0.0
    tail, p = (1 - sampling.confidence) / 2, None
    z = bias + special.ndtri(np.array([tail, 1 - tail]))
    levels = special.ndtr(bias + z / (1 - acceleration * z))
    if not np.isfinite(levels).all():
        return without
    if sampling.tested:
        # The level at which an end is 0; without a resample beyond 0 it is below what they resolve.
        w = normal(0.0) - bias
        if math.isfinite(w) and 1 + acceleration * w > 0:
            p = 2 * float(special.ndtr(-abs(w / (1 + acceleration * w) - bias)))
    low, high = np.quantile(resampled, levels)
    return Finding(value, float(low), float(high), informing, reliable=True, p=p)


def _resamples(n: int, rng: np.random.Generator, confidence: float) -> Iterator[np.ndarray]:
    """How many times each pair is in each resample, in batches of shape (some, n).

    The generator is copied and keeps its state, so the same values always have the same interval.
    """
    beyond = round(_RESAMPLES_BEYOND / ((1 - confidence) / 2))
    total = max(FEWEST_RESAMPLES, min(RESAMPLES, _DRAWS // n), beyond)
    rng, batch = copy.deepcopy(rng), max(1, _DRAWS_IN_MEMORY // n)
    for some in (min(batch, total - begin) for begin in range(0, total, batch)):
        drawn = rng.integers(0, n, size=(some, n)) + n * np.arange(some)[:, None]
        yield np.bincount(drawn.ravel(), minlength=some * n).reshape(some, n).astype(np.uint8)


@lru_cache(maxsize=2)
def _kept(n: int, rng: np.random.Generator, confidence: float) -> tuple[np.ndarray, ...]:
    """The resamples, which most numbers of a cell share."""
    return tuple(_resamples(n, rng, confidence))
