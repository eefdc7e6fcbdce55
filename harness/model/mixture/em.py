"""Takes a mixture's parameters and returns its penalised likelihood, gradient and next EM step.

Source: Lee and Scott (2012), with a larger step and the penalty of `fit_mixture`. All columns are
standardised to mean 0 and spread 1.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.model.mixture.truncation import moments

Array = NDArray[np.float64]

# Rows handled at once by the expectation step; its temporary arrays then stay in the cache.
_CHUNK = 4096
# A component beyond these limits diverges, and its moments are noise.
_SMALLEST_MASS = 1e-8
_LARGEST_EIGENVALUE = 1e8
_SMALLEST_COUNT = 1e-9
_TINY = 1e-300


@dataclass(frozen=True)
class Parameters:
    """Weights (K,), locations (K, d) and scale matrices (K, d, d)."""

    weights: Array
    locations: Array
    scales: Array


@dataclass(frozen=True)
class Evaluation:
    """The likelihood at some parameters, and sums that the next step needs.

    Attributes:
        objective, log_likelihood: totals over the rows, with and without the penalty.
        masses, inner_means, inner_covariances: moments of the truncated components.
        counts, means, covariances: moments of the rows, weighted by responsibility.
    """

    parameters: Parameters
    objective: float
    log_likelihood: float
    masses: Array
    inner_means: Array
    inner_covariances: Array
    counts: Array
    means: Array
    covariances: Array


class Problem:
    """Rows, bounds and prior of one fit.

    Args:
        rows: standardised rows, (n, d).
        weights: weights of the rows, (n,).
        lower, upper: standardised bounds, (d,).
        mass_penalty: λ of the penalty Π α_k^λ.
        scale_floor: smallest allowed eigenvalue of a scale matrix.
    """

    def __init__(
        self,
        rows: Array,
        weights: Array,
        lower: Array,
        upper: Array,
        mass_penalty: float,
        scale_floor: float,
    ) -> None:
        self.weights, self.lower, self.upper = weights, lower, upper
        self.mass_penalty, self.scale_floor = mass_penalty, scale_floor
        self.total = float(weights.sum())
        dimension = rows.shape[1]
        self._pairs = np.triu_indices(dimension)
        squares = rows[:, self._pairs[0]] * rows[:, self._pairs[1]]
        features = np.concatenate((np.ones((rows.shape[0], 1)), rows, squares), axis=1)
        self._features = np.ascontiguousarray(features.T)
        # An off-diagonal product occurs twice in the quadratic form.
        self._doubled = np.where(self._pairs[0] == self._pairs[1], 1.0, 2.0)

    def evaluate(self, parameters: Parameters) -> Evaluation | None:
        """The likelihood at parameters; None if it cannot be computed accurately."""
        if not _feasible(parameters):
            return None
        masses, inner_means, inner_covariances = moments(
            parameters.locations, parameters.scales, self.lower, self.upper
        )
        if not (masses > _SMALLEST_MASS).all():
            return None
        log_likelihood, statistics = self._expectation(self._coefficients(parameters, masses))
        objective = log_likelihood + self.mass_penalty * float(np.log(masses).sum())
        if not np.isfinite(objective):
            return None
        dimension = self.lower.size
        counts = np.maximum(statistics[:, 0], _SMALLEST_COUNT)
        means = statistics[:, 1 : dimension + 1] / counts[:, None]
        second = np.empty((counts.size, dimension, dimension))
        second[:, self._pairs[0], self._pairs[1]] = statistics[:, dimension + 1 :]
        second[:, self._pairs[1], self._pairs[0]] = statistics[:, dimension + 1 :]
        covariances = second / counts[:, None, None] - means[:, :, None] * means[:, None, :]
        return Evaluation(
            parameters,
            objective,
            log_likelihood,
            masses,
            inner_means,
            inner_covariances,
            counts,
            means,
            covariances,
        )

    def _coefficients(self, parameters: Parameters, masses: Array) -> Array:
        """Log density of each component as a quadratic in the features, (K, F)."""
        precisions = np.linalg.inv(parameters.scales)
        linear = np.einsum("kij,kj->ki", precisions, parameters.locations)
        constant = np.log(parameters.weights / masses) - 0.5 * (
            np.linalg.slogdet(parameters.scales)[1]
            + np.einsum("ki,ki->k", linear, parameters.locations)
            + self.lower.size * np.log(2.0 * np.pi)
        )
        quadratic = -0.5 * self._doubled * precisions[:, self._pairs[0], self._pairs[1]]
        return np.concatenate((constant[:, None], linear, quadratic), axis=1)

    def _expectation(self, coefficients: Array) -> tuple[float, Array]:
        """The log-likelihood, and the features' sums weighted by responsibility, (K, F)."""
        statistics = np.zeros_like(coefficients)
        total = 0.0
        for at in range(0, self.weights.size, _CHUNK):
            features = self._features[:, at : at + _CHUNK]
            weights = self.weights[at : at + _CHUNK]
            terms = coefficients @ features
            largest = terms.max(axis=0)
            terms -= largest
            np.exp(terms, out=terms)
            sums = terms.sum(axis=0)
            total += float(weights @ (np.log(sums) + largest))
            terms *= weights / sums
            statistics += terms @ features.T
        return total, statistics

    def step(self, at: Evaluation) -> Parameters:
        """The parameters of the next EM step.

        m' = m + (ȳ − E), S' = C + (S − V). ȳ and C are the rows' moments. E and V are moments of a
        mixture of the truncated component, with share c = 1 − λ/N_k, and the untruncated component,
        with share 1 − c. Both moments are equal at the maximum. The step is larger than the exact
        step of EM, so in rare cases the objective may fall.
        """
        share = np.maximum(1.0 - self.mass_penalty / at.counts, 0.0)[:, None]
        m, scales = at.parameters.locations, at.parameters.scales
        away = share * (at.inner_means - m)
        spread = scales + share[:, :, None] * (
            at.inner_covariances - scales + _outer(at.inner_means - m)
        )
        target_scales = at.covariances + scales - (spread - _outer(away))
        weights = at.counts / at.counts.sum()
        return Parameters(weights, m + (at.means - m - away), self._lifted(target_scales))

    def gradient(self, at: Evaluation) -> tuple[Array, Array, Array]:
        """Gradient of the objective in the logits of the weights (K,), locations (K, d), scales.

        The gradient g in the scales (K, d, d) is symmetric; a symmetric dS changes the objective by
        Σ_ij g_ij dS_ij. The gradient of log α is exact: S⁻¹(E − m) in the location and
        S⁻¹(V + (E − m)(E − m)ᵀ − S)S⁻¹/2 in the scale matrix.
        """
        m, scales = at.parameters.locations, at.parameters.scales
        counts, cut = at.counts, at.counts - self.mass_penalty
        precisions = np.linalg.inv(scales)
        away, inner = at.means - m, at.inner_means - m
        first = counts[:, None] * away - cut[:, None] * inner
        second = counts[:, None, None] * (at.covariances + _outer(away) - scales)
        second -= cut[:, None, None] * (at.inner_covariances + _outer(inner) - scales)
        return (
            counts - at.parameters.weights * self.total,
            (precisions @ first[:, :, None])[:, :, 0],
            0.5 * precisions @ second @ precisions,
        )

    def allowed(self, parameters: Parameters) -> Parameters:
        """The parameters with the eigenvalues of scale matrices raised to the floor."""
        return Parameters(parameters.weights, parameters.locations, self._lifted(parameters.scales))

    def _lifted(self, scales: Array) -> Array:
        """The nearest matrices with no eigenvalue below the floor."""
        scales = 0.5 * (scales + np.swapaxes(scales, 1, 2))
        values, vectors = np.linalg.eigh(scales)
        low = values[:, 0] < max(self.scale_floor, _TINY)
        if not low.any():
            return scales
        values = np.maximum(values, max(self.scale_floor, _TINY))
        lifted = (vectors * values[:, None, :]) @ np.swapaxes(vectors, 1, 2)
        return np.where(low[:, None, None], lifted, scales)


def _outer(vectors: Array) -> Array:
    return vectors[:, :, None] * vectors[:, None, :]


def _feasible(parameters: Parameters) -> bool:
    """Whether parameters are finite and scales positive definite, within numerical limits."""
    parts = (parameters.weights, parameters.locations, parameters.scales)
    if not all(np.isfinite(part).all() for part in parts):
        return False
    values = np.linalg.eigvalsh(parameters.scales)
    return bool((values > 0.0).all() and (values < _LARGEST_EIGENVALUE).all())
