"""The probability of a crash from the tail of a measure: peaks over threshold.

The measure (TTC, PET) is 0 at a crash.  Its k smallest values y below the threshold u have excesses
u − y, to which a generalised Pareto distribution is fitted.  The prediction is P(excess > u) k/n.

With θ = ξ/σ the log-likelihood of k excesses is −k ln(ξ/θ) − (1 + 1/ξ) Σ ln(1 + θ y) (Grimshaw
1993).  For a fixed q = P(excess > u) = (1 + θ u)^(−1/ξ) the shape is ξ = −ln(1 + θ u)/ln q, so the
profile of q is a maximum over θ alone.  Both are taken on a grid of θ.
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, genpareto

from harness.core.encounter import FloatArray

SHARE = 0.05
"""Of the values: the most severe ones are the excesses."""

EXCESSES = 50
"""At least so many are asked for."""

FEWEST_VALUES, FEWEST_EXCESSES = 100, 30
"""With fewer there is no fit; ties at the threshold may leave fewer excesses than ``EXCESSES``."""

_CONFIDENCE = 0.95
_SMALLEST_SHAPE = -1.0  # The likelihood has no maximum below it.
_STEP = 0.02
# ln(1 + θ max y); never 0, where ξ/θ would be 0/0.
_GRID = np.arange(-25.0, 12.0, _STEP) + _STEP / 2
_LOG_Q = -np.geomspace(1e-3, 60.0, 400)[::-1]
_RATES = np.linspace(-5, 5, 41)  # ln(rate of excesses), in standard errors.
_BLOCK = 200


class Tail(NamedTuple):
    """What a fitted tail predicts.

    ``probability`` of a crash in an episode, 0 if the fitted tail ends before the crash; ``low``
    and ``high`` its 95 % profile likelihood interval; ``shape`` ξ and ``scale`` σ.
    """

    probability: float
    low: float
    high: float
    shape: float
    scale: float
    threshold: float
    excesses: int


def fit_tail(values: FloatArray, episodes: int) -> Tail | None:
    """Predict the probability of a crash (value ≤ 0) from the values of episodes without one.

    Args:
        values: the measure in the episodes without a crash in which it is defined, shape (n,).
        episodes: number of all episodes.

    Returns:
        None if there are fewer than ``FEWEST_VALUES`` values, or fewer than ``FEWEST_EXCESSES``
        below the threshold.
    """
    if len(values) < FEWEST_VALUES:
        return None
    ordered = np.sort(values)
    threshold = float(ordered[max(EXCESSES, round(SHARE * len(values)))])
    excess = threshold - ordered[ordered < threshold]
    if len(excess) < FEWEST_EXCESSES:
        return None
    theta = np.expm1(_GRID) / excess.max()
    sums = _sums(theta, excess)
    free = np.maximum(sums / len(excess), _SMALLEST_SHAPE)
    likelihood = _log_likelihood(theta, free, sums, len(excess))
    best = int(likelihood.argmax())
    shape, scale = float(free[best]), float(free[best] / theta[best])
    rate = len(excess) / episodes
    within = float(genpareto.sf(threshold, shape, scale=scale))
    ends = likelihood[theta * threshold <= -1]
    at_zero = float(ends.max()) if len(ends) else -np.inf
    profile = _profile(theta, sums, len(excess), threshold)
    low, high = _interval(profile, float(likelihood[best]), at_zero, len(excess), rate)
    return Tail(within * rate, low, high, shape, scale, threshold, len(excess))


def _sums(theta: FloatArray, excess: FloatArray) -> FloatArray:
    """Σ ln(1 + θ y) for each θ."""
    parts = np.array_split(theta, -(-len(theta) // _BLOCK))
    sums: FloatArray = np.concatenate(
        [np.log1p(part[:, None] * excess).sum(axis=1) for part in parts]
    )
    return sums


def _log_likelihood(
    theta: FloatArray, shape: FloatArray, sums: FloatArray, count: int
) -> FloatArray:
    likelihood: FloatArray = -count * np.log(shape / theta) - (1 + 1 / shape) * sums
    return likelihood


def _profile(theta: FloatArray, sums: FloatArray, count: int, threshold: float) -> FloatArray:
    """The log-likelihood of each ``_LOG_Q``, at the best θ."""
    inside = theta * threshold > -1
    theta, sums = theta[inside], sums[inside]
    shape = -np.log1p(theta * threshold) / _LOG_Q[:, None]
    allowed = shape >= _SMALLEST_SHAPE
    likelihood = np.where(allowed, _log_likelihood(theta, shape, sums, count), -np.inf)
    best: FloatArray = likelihood.max(axis=1)
    return best


def _interval(
    profile: FloatArray, best: float, at_zero: float, count: int, rate: float
) -> tuple[float, float]:
    """The limits of q times the rate, whose own (Poisson) likelihood is profiled too."""
    allowed = float(chi2.ppf(_CONFIDENCE, 1)) / 2
    rates = _RATES / np.sqrt(count)
    cost = count * (np.expm1(rates) - rates)
    log_p = np.linspace(_LOG_Q[0], rates[-1], 2_000)
    together = np.max(
        [
            np.interp(log_p - of, _LOG_Q, profile, right=-np.inf) - lost
            for of, lost in zip(rates, cost, strict=True)
        ],
        axis=0,
    )
    (held,) = np.nonzero(together >= best - allowed)
    to_zero = at_zero >= best - allowed
    if not len(held):
        return 0.0, 0.0
    low, high = rate * np.exp(log_p[held[[0, -1]]])
    return (0.0 if to_zero or held[0] == 0 else float(low)), float(high)
