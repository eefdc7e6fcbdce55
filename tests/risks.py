"""Events whose probability is known in closed form, in standard normal space."""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import stats

from harness.old.studies.risk.estimation import Estimation, estimate_probability
from harness.old.studies.risk.layout import Layout
from harness.old.studies.risk.outcomes import Evaluate, Outcomes

DIMENSIONS = 18

CROWD = Layout(fixed=1, marks=2, rate_per_s=0.5, window_s=8.0)

Case = tuple[Evaluate, float]

LAYOUT = Layout(DIMENSIONS)


def scored(score: Callable[[np.ndarray], np.ndarray]) -> Evaluate:
    """Episodes that are nothing but their score, shape (n,)."""

    def evaluate(z: np.ndarray, *_options: object) -> Outcomes:
        return outcomes(score(z)[:, None])

    return evaluate


def outcomes(score: np.ndarray) -> Outcomes:
    """Outcomes of episodes without a crowd, whose numbers do not matter."""
    count = len(score)
    never, nobody = np.full(count, np.nan), np.full(count, -1)
    return Outcomes(score, np.arange(count), never, never, nobody, np.full((count, 1), np.inf))


def estimated(
    evaluate: Evaluate, seed: object, *options: float, layout: Layout = LAYOUT, **more: Any
) -> Estimation:
    """The estimate with draws of that seed."""
    return estimate_probability(evaluate, layout, np.random.default_rng(seed), *options, **more)


def half_space(p: float) -> Case:
    """Beyond a plane at distance Φ⁻¹(1 − p) from the origin, oblique to every axis."""
    distance = stats.norm.isf(p)
    normal = np.ones(DIMENSIONS) / np.sqrt(DIMENSIONS)
    return scored(lambda z: distance - z @ normal), p


def union(p: float) -> Case:
    """Beyond either of two planes at right angles: 1 − (1 − p₁)(1 − p₂)."""
    one, two = 0.7 * p, 0.3 * p
    normal = np.zeros(DIMENSIONS)
    normal[1:3] = -0.6, 0.8

    def score(z: np.ndarray) -> np.ndarray:
        return np.minimum(stats.norm.isf(one) - z[:, 0], stats.norm.isf(two) - z @ normal)

    return scored(score), 1 - (1 - one) * (1 - two)


def fault(share: float) -> Case:
    """A half-space of 1e-5, and a fault to which no score leads: in a share of all states 0.2 more.

    The half-space lies in the first coordinate, the fault in the last two: they are independent.
    """
    half, hit = 1e-5, 0.2

    def score(z: np.ndarray) -> np.ndarray:
        dead = (z[:, -1] < stats.norm.ppf(share)) & (z[:, -2] < stats.norm.ppf(hit))
        return np.where(dead, -1.0, stats.norm.isf(half) - z[:, 0])

    return scored(score), 1 - (1 - half) * (1 - share * hit)


def crowd(p: float) -> Case:
    """Hit are the slow who come within h of the ego's passage: 4 s + z/10, 1 s more for each early.

    Early is who comes before 3 s, slow whose mark is above c.  Those who come near the passage are
    Poisson, and independent of the early ones: p = E[1 − exp(−λ P(slow) length)], where the length
    is that of [T − h, T + h] within the window.
    """
    half_s = 0.1
    slow = p / CROWD.rate_per_s / (2 * half_s)
    limit = stats.norm.isf(slow)

    def truth() -> float:
        early = np.arange(12)
        z, weight = np.polynomial.hermite_e.hermegauss(200)
        passed_s = 4.0 + z[:, None] / 10 + early
        length_s = np.clip(CROWD.window_s - passed_s + half_s, 0.0, 2 * half_s)
        hit = 1 - np.exp(-CROWD.rate_per_s * slow * length_s)
        return float(weight / weight.sum() @ hit @ stats.poisson.pmf(early, 1.5))

    def evaluate(
        z: np.ndarray,
        _what: str,
        numbers: np.ndarray | None = None,
        asked: np.ndarray | None = None,
    ) -> Outcomes:
        arrivals_s, mark = CROWD.arrivals_s(z), CROWD.people(z)[:, :, 1]
        passed_s = 4.0 + z[:, 0] / 10 + (arrivals_s < 3.0).sum(axis=1)
        away_s = np.maximum(np.abs(arrivals_s - passed_s[:, None]) - half_s, 0.0)
        away = away_s + np.maximum(limit - mark, 0.0)
        away = np.where(np.isnan(away), np.inf, away)
        # Whoever of the hit comes first is the culprit.
        first = np.where(away <= 0, arrivals_s, np.inf).argmin(axis=1)
        rows = np.arange(len(z))
        own = np.full(len(z), np.inf)
        if asked is not None:
            own = np.where(asked < 0, np.inf, away[rows, asked])
        score = away.min(axis=1)
        return Outcomes(
            score[:, None],
            rows if numbers is None else numbers,
            passed_s,
            np.full(len(z), 1.0),
            np.where(score <= 0, first, -1),
            own[:, None],
        )

    return evaluate, truth()
