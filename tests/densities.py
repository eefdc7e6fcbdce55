"""Mixtures in a box: the density the long way round, and one whose parameters are known.

The joint density of (1/R, v, v_p, 1/T_adv) is Σ π_k N(x; m_k, S_k) / α_k inside the box, with α_k
the mass of component k inside it.  Only the parameters are taken from the harness; α_k comes from
scipy's multivariate normal, everything else from sums over fine grids.
"""

from functools import cached_property
from typing import Any

import numpy as np
from scipy import integrate, stats

from harness.model.mixture.distribution import TruncatedGaussianMixture

R, V, VP, W = range(4)
_normal: Any = stats.multivariate_normal


class Joint:
    """The truncated mixture, the long way round."""

    def __init__(self, mixture: TruncatedGaussianMixture) -> None:
        self.lower, self.upper, self._weights = mixture.lower, mixture.upper, mixture.weights
        self._locations, self._scales = mixture.locations, mixture.scale_matrices

    @cached_property
    def masses(self) -> np.ndarray:
        return np.array(
            [
                _normal(mean, covariance, maxpts=200_000, abseps=1e-7, releps=1e-6, seed=1).cdf(
                    self.upper, lower_limit=self.lower
                )
                for mean, covariance in zip(self._locations, self._scales, strict=True)
            ]
        )

    def density(self, *variables: object) -> np.ndarray:
        """At points given as four arrays that broadcast; no check of the box."""
        # Left unbroadcast as long as possible: most terms then vary along one axis only.
        x = [np.asarray(variable, dtype=float) for variable in variables]
        total = np.zeros(np.broadcast_shapes(*(values.shape for values in x)))
        for weight, mass, mean, covariance in zip(
            self._weights, self.masses, self._locations, self._scales, strict=True
        ):
            inverse = np.linalg.inv(covariance)
            centred = [value - m for value, m in zip(x, mean, strict=True)]
            square = sum(
                (1 + (i < j)) * inverse[i, j] * centred[i] * centred[j]
                for i in range(4)
                for j in range(i, 4)
            )
            norm = (2 * np.pi) ** 2 * np.sqrt(np.linalg.det(covariance))
            total += weight / mass / norm * np.exp(-0.5 * square)
        return total

    def grid(self, variable: int, points: int) -> np.ndarray:
        return np.linspace(self.lower[variable], self.upper[variable], points)

    def driver_mode(self, inverse_range: float, pace: float, w: float | None) -> float:
        """The most likely v to 0.5 mm/s: a grid of 2.5 cm/s, then a fine one about its best.

        1/T_adv is given, or (None) integrated over its bounds by Simpson's rule.
        """

        def along(speeds: np.ndarray) -> np.ndarray:
            if w is not None:
                return self.density(inverse_range, speeds, pace, w)
            inverse = self.grid(W, 201)
            surface = self.density(inverse_range, speeds[:, None], pace, inverse[None, :])
            return integrate.simpson(surface, x=inverse, axis=1)

        coarse = self.grid(V, 309)
        near = coarse[along(coarse).argmax()] + np.arange(-0.03, 0.0301, 0.0005)
        fine = near[(near >= self.lower[V]) & (near <= self.upper[V])]
        return float(fine[along(fine).argmax()])

    def walking_speed_cdf(self, range_m: float, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """F(v_p | 1/R, v) on a grid, 1/T_adv integrated over its bounds by Simpson's rule."""
        paces, inverse = self.grid(VP, 801), self.grid(W, 801)
        surface = self.density(1 / range_m, speed, paces[:, None], inverse[None, :])
        along = integrate.simpson(surface, x=inverse, axis=1)
        area = integrate.cumulative_simpson(along, x=paces, initial=0.0)
        return paces, area / area[-1]


def truth():
    """Three components in four variables, more than a third of two of them outside the box."""
    locations = [[0.1, 1.5, 1.0, 0.1], [0.8, 4.5, 0.4, 0.9], [0.5, 0.0, 1.6, -0.1]]
    rhos = [0.4, -0.3, 0.2]
    spreads = np.array([[0.2, 1.0, 0.3, 0.2], [0.3, 1.5, 0.4, 0.5], [0.15, 1.0, 0.3, 0.4]])
    scales = [
        (r + (1 - r) * np.eye(4)) * np.outer(s, s) for r, s in zip(rhos, spreads, strict=True)
    ]
    return TruncatedGaussianMixture(
        [0.4, 0.35, 0.25], locations, scales, [0.0, 0.0, 0.2, 0.0], [1.0, 6.0, 2.5, 2.0]
    )
