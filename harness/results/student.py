"""Estimators of simulations, which have many passages a pair.

Means and ratios have Student's t interval over pairs, and shares of passages that of Korn and
Graubard (1998).
"""

import math
from dataclasses import replace

import numpy as np
from scipy import special

from harness.core.vocabulary import FloatArray
from harness.results.estimators import EQUAL, Sampling, clopper_pearson, informative
from harness.results.finding import Finding

RELIABLE_PAIRS = 5
"""Pairs from which on intervals are reliable; theirs are skewed, and t is for normal ones."""

ONE = "one pair has no interval"
ALONE = "of one pair, as if its passages were independent"
NO_EVENT = "no event in either arm, so the difference has no interval"


def mean_of_arms(values: FloatArray, sampling: Sampling, least: float = 0.0) -> Finding:
    """The mean of an arm's values, none below ``least``, or of the arms' differences."""
    if values.ndim == 1:
        return replace(t_mean(values, sampling.confidence, least), p=None)
    return t_mean(np.subtract(*values), sampling.confidence)


def share_of_arms(events: FloatArray, trials: FloatArray, sampling: Sampling) -> Finding:
    """An arm's share of events among trials, or the difference of the arms' shares."""
    if events.ndim == 1:
        return clustered_share(events, trials, sampling.confidence)
    av, human = zip(events, trials, strict=True)
    return t_ratio_difference(av, human, sampling.confidence)


def t_mean(values: FloatArray, confidence: float, least: float = -math.inf) -> Finding:
    """The mean of the defined values with Student's t interval, and the p of a mean of 0.

    Args:
        values: one value a pair, NaN where undefined.
        confidence: two-sided confidence of the interval; 0: there is none.
        least: the least possible value, at which the interval is cut; of 0 there is no p.

    Returns:
        Undefined without a value.  Equal values do not show their spread, so they have no interval.

    >>> t_mean(np.array([1.0, 2.0, 3.0]), 0.95)
    Finding(value=2.0, low=-0.484137711..., high=4.484137711..., n=3, ..., p=0.0741799...)
    """
    values = values[~np.isnan(values)]
    return _t(float(np.mean(values)), values, confidence, least) if len(values) else Finding(None)


def t_ratio_difference(
    a: tuple[FloatArray, FloatArray], b: tuple[FloatArray, FloatArray], confidence: float
) -> Finding:
    """The difference of two ratios of sums, Σ/Σ, with the t interval of the pairs' parts in it.

    Undefined if a divisor is 0.  It has no interval if both are 0, because an event may still
    occur.
    """
    known = ~np.isnan([*a, *b]).any(axis=0)
    first, own = _contributions(a[0][known], a[1][known])
    second, others = _contributions(b[0][known], b[1][known])
    if first is None or second is None:
        return Finding(None)
    if not (first or second):
        return Finding(0.0, n=len(own), reason=NO_EVENT if confidence else None)
    return _t(first - second, own - others, confidence)


def clustered_share(events: FloatArray, trials: FloatArray, confidence: float) -> Finding:
    """The share of events among trials that come in pairs, within which they may be correlated.

    The interval is Korn and Graubard's (1998): the exact one of the effective number of trials.
    That is their number over the design effect, and times (t_trials / t_pairs)², with Student's
    quantiles.  The design effect is the variance between pairs over the binomial variance, at
    least 1.  If 1 to 4 pairs have an event, or a trial without one, they tell too little of it, and
    the interval is unreliable.  Without an event the trials count as independent.

    Args:
        events, trials: numbers of each pair, NaN where undefined.
        confidence: two-sided confidence of the interval; 0: there is none.

    Returns:
        Undefined without a trial.  One pair has an interval only if nothing happened, as if its
        trials were independent.
    """
    known = ~np.isnan(events + trials)
    events, trials = events[known], trials[known]
    pairs, happened, n = len(trials), int(np.sum(events)), int(np.sum(trials))
    if n == 0:
        return Finding(None, n=0, events=0)
    value = happened / n
    if not confidence or (pairs == 1 and happened):
        return Finding(value, n=n, events=happened, reason=ONE if confidence else None)
    if pairs == 1:
        return Finding(0.0, *clopper_pearson(0, n, confidence), n, 0, reliable=False, reason=ALONE)
    between = pairs / (pairs - 1) * float(np.sum((events - value * trials) ** 2))
    within, tail = n * value * (1 - value), (1 + confidence) / 2
    effect = max(1.0, between / within) if within else 1.0
    worth = float(special.stdtrit(n - 1, tail) / special.stdtrit(pairs - 1, tail)) ** 2
    effective = n / effect * min(1.0, worth)
    low, high = clopper_pearson(value * effective, effective, confidence)
    telling = min(np.count_nonzero(each) for each in (events, trials - events) if each.any())
    found = Finding(value, low, high, int(telling), happened, reliable=True)
    return replace(found.reliable_above(RELIABLE_PAIRS, "pairs with and without it"), n=n)


def _contributions(above: FloatArray, below: FloatArray) -> tuple[float | None, FloatArray]:
    """Σ above / Σ below, and what each pair adds to it, linearised: their mean is 0."""
    if not (total := float(np.sum(below))):
        return None, above
    value = float(np.sum(above)) / total
    return value, (above - value * below) * len(below) / total


def _t(value: float, parts: FloatArray, confidence: float, least: float = -math.inf) -> Finding:
    """An estimate with the t interval that the spread of each pair's part in it gives."""
    n = len(parts)
    if not confidence or n == 1 or informative(parts) == 0:
        return Finding(value, n=n, reason=(ONE if n == 1 else EQUAL) if confidence else None)
    error = float(np.std(parts, ddof=1)) / math.sqrt(n)
    reach = float(special.stdtrit(n - 1, (1 + confidence) / 2)) * error
    p = 2 * float(special.stdtr(n - 1, -abs(value) / error)) if least < 0 else None
    low = max(value - reach, min(value, least))
    found = Finding(value, low, value + reach, n, reliable=True, p=p)
    return found.reliable_above(RELIABLE_PAIRS, "pairs")
