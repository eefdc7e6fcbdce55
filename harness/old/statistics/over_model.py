"""The interval of a number over pairs and over refits of the interaction model together.

The pairs are spread over R refits of the model to resampled vehicles.  A number differs between
refits by B, the variance of the fit, and by the variance R C of a refit's pairs, where C is the
variance of the number over all pairs (one-way random effects).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from harness.core.encounter import FloatArray
from harness.old.statistics.entries import Finding
from harness.old.statistics.intervals import CONFIDENCE, Interval

_STEPS = 2_000
_FARTHEST = 30.0
"""The posterior of √B is computed on so many values, up to so many standard deviations."""

HALF = 0.5


@dataclass(frozen=True, slots=True)
class OverModel(Interval):
    """A number with the interval that includes the model, and the model's share of its variance.

    ``share`` = B(1 + 1/R) / (B(1 + 1/R) + C), from the analysis of variance, with its two-sided
    interval.  It is None if the number does not vary.  ``refits`` is the number of refits in which
    the number is defined.
    """

    share: float | None
    share_low: float | None
    share_high: float | None
    refits: int

    @property
    def mostly_model(self) -> bool:
        """Whether more than half of the variance is estimated to come from the model."""
        return self.share is not None and self.share > HALF

    @property
    def surely_model(self) -> bool:
        """Whether the share's whole interval is above one half."""
        return self.share_low is not None and self.share_low > HALF


def over_model(
    usual: Finding,
    by_refit: Sequence[float | None],
    effective_vehicles: float,
    confidence: float = CONFIDENCE,
) -> OverModel:
    """The interval of a number over pairs and refits together.

    The error of the number is the sum of two independent errors.  The first is that of the pairs;
    the usual interval has its limits l and u.  The second is that of the model.  Its variance is
    B(1 + 1/R) as in Rubin's rules (1987): the model itself is one draw of the fit, and R refits
    are averaged.  B is uncertain because R and the vehicles are few.  So the second error is a
    mixture of Student's t with V − 1 degrees of freedom, V effective vehicles, over the posterior
    of B with a uniform prior of √B (Gelman 2006); q is its quantile.  The limits are those of a sum
    (Zou and Donner 2008): θ − √((θ − l)² + q²) and θ + √((u − θ)² + q²).

    Args:
        usual: the number over all pairs, with the interval over pairs.
        by_refit: the number over the pairs of each refit; None where it is undefined.
        effective_vehicles: Kish's effective number of vehicles behind the model.
        confidence: two-sided confidence of both intervals.

    Returns:
        *Undefined* if the number or its usual interval is, or if it is defined in fewer than three
        refits.
    """
    values = np.array([value for value in by_refit if value is not None], dtype=float)
    theta, refits = usual.number, len(values)
    if theta is None or usual.low is None or usual.high is None or refits < 3:
        return OverModel(theta, None, None, None, None, None, refits)
    pairs = _pairs_variance(usual, confidence)
    within, total = refits * pairs, float(np.var(values, ddof=1))
    if total == 0.0:
        return OverModel(theta, usual.low, usual.high, None, None, None, refits)
    degrees, tail = refits - 1, (1 - confidence) / 2
    # (R − 1) total / (B + within) has a χ² distribution with R − 1 degrees of freedom.
    quantiles = special.chdtri(degrees, np.array([tail, 1 - tail])) / degrees
    share, least, most = (
        _share(between - within, refits, pairs) for between in (total, *(total / quantiles))
    )
    reach = _model_quantile(total, within, refits, effective_vehicles, 1 - tail)
    low = theta - float(np.hypot(theta - usual.low, reach))
    high = theta + float(np.hypot(usual.high - theta, reach))
    if usual.events is not None:
        low, high = max(0.0, low), min(1.0, high)
    return OverModel(theta, low, high, share, least, most, refits)


def _share(variance: float, refits: int, pairs: float) -> float | None:
    model = max(0.0, variance) * (1 + 1 / refits)
    return model / (model + pairs) if model + pairs else None


def _pairs_variance(usual: Finding, confidence: float) -> float:
    """C: the binomial variance of a share; else from the usual interval's half-width."""
    if usual.events is not None and usual.n:
        share = usual.events / usual.n
        return share * (1 - share) / usual.n
    z = special.ndtri((1 + confidence) / 2)
    return float(((usual.half_width or 0.0) / z) ** 2)


def _model_quantile(
    total: float, within: float, refits: int, effective_vehicles: float, level: float
) -> float:
    """The quantile of the model's error, over the posterior of B.

    The likelihood of B is that of the χ² of ``total``: (B + within)^(−(R − 1)/2) exp(−(R − 1)
    total / (2 (B + within))).
    """
    from scipy import optimize  # a tenth of a second, which only runs over refits need

    farthest = _FARTHEST * np.sqrt(total)
    # Half steps, so that B = 0 has no weight of its own.
    roots: FloatArray = (np.arange(_STEPS) + 0.5) * (farthest / _STEPS)
    spread = roots**2 + within
    half = (refits - 1) / 2
    logs = -half * (np.log(spread) + total / spread)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    errors = roots * np.sqrt(1 + 1 / refits)
    degrees = max(1.0, effective_vehicles - 1)

    def excess(reach: float) -> float:
        return float(weights @ special.stdtr(degrees, reach / errors)) - level

    most = farthest
    while excess(most) < 0:
        most *= 2
    return float(optimize.brentq(excess, 0.0, most))
