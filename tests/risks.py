"""Events whose probability is known in closed form, in standard normal space."""

from collections.abc import Callable

import numpy as np
from scipy import stats

DIMENSIONS = 18

Case = tuple[Callable[[np.ndarray, str], np.ndarray], float]


def half_space(p: float) -> Case:
    """Beyond a plane at distance Φ⁻¹(1 − p) from the origin, oblique to every axis."""
    distance = stats.norm.isf(p)
    normal = np.ones(DIMENSIONS) / np.sqrt(DIMENSIONS)
    return lambda z, _: (distance - z @ normal)[:, None], p


def union(p: float) -> Case:
    """Beyond either of two planes at right angles: 1 − (1 − p₁)(1 − p₂)."""
    one, two = 0.7 * p, 0.3 * p
    normal = np.zeros(DIMENSIONS)
    normal[1:3] = -0.6, 0.8

    def score(z: np.ndarray, _: str) -> np.ndarray:
        return np.minimum(stats.norm.isf(one) - z[:, 0], stats.norm.isf(two) - z @ normal)[:, None]

    return score, 1 - (1 - one) * (1 - two)
