"""Events whose probability is known in closed form, in standard normal space."""

from collections.abc import Callable

import numpy as np
from scipy import stats

from harness.risk.layout import Layout
from harness.risk.outcomes import Evaluate, Outcomes

DIMENSIONS = 18

Case = tuple[Evaluate, float]

LAYOUT = Layout(DIMENSIONS)


def scored(score: Callable[[np.ndarray], np.ndarray]) -> Evaluate:
    """Episodes that are nothing but their score, shape (n,)."""

    def evaluate(
        z: np.ndarray,
        what: str,  # noqa: ARG001
        numbers: np.ndarray | None = None,
    ) -> Outcomes:
        of = np.arange(len(z)) if numbers is None else numbers
        return Outcomes(score(z)[:, None], np.full(len(z), np.nan), of)

    return evaluate


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
