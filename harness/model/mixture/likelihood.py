"""Takes a mixture's parameters and returns its penalised likelihood with the exact gradient.

Source: Lee and Scott (2012), with the penalty of `fit_mixture`. All columns are standardised to
mean 0 and spread 1.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.mixture.normals import Normals
from harness.model.mixture.truncation import moments

Array = NDArray[np.float64]

# Rows handled at once by the expectation step; its temporary arrays then stay in the cache.
_CHUNK = 4096
# A component beyond these limits diverges, and its moments are noise.
_SMALLEST_MASS = 1e-8
_LARGEST_EIGENVALUE = 1e8
_SMALLEST_COUNT = 1e-9
# A scale matrix at its floor is raised by this share of the floor, so that S − F I has a factor.
_ABOVE_FLOOR = 1e-6
_TINY = 1e-12
# Components with fewer rows have the units of a component with this number of rows.
_FEWEST_ROWS = 1.0


class Evaluation(NamedTuple):
    """The likelihood at some parameters.

    Attributes:
        normals: the parameters.
        objective, log_likelihood: totals over the rows, with and without the penalty.
        counts: number of rows of each component, by responsibility, (K,).
        in_logits, in_locations, in_scales: gradient of the objective in the logits of the weights
            (K,), the locations (K, d) and the scale matrices (K, d, d). A symmetric dS changes the
            objective by Σ_ij g_ij dS_ij.
    """

    normals: Normals
    objective: float
    log_likelihood: float
    counts: Array
    in_logits: Array
    in_locations: Array
    in_scales: Array


class Likelihood:
    """The penalised likelihood of rows inside a box.

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
        self._pairs = np.triu_indices(rows.shape[1])
        squares = rows[:, self._pairs[0]] * rows[:, self._pairs[1]]
        features = np.concatenate((np.ones((rows.shape[0], 1)), rows, squares), axis=1)
        self._features = np.ascontiguousarray(features.T)
        # An off-diagonal product occurs twice in the quadratic form.
        self._doubled = np.where(self._pairs[0] == self._pairs[1], 1.0, 2.0)

    def at(self, normals: Normals) -> Evaluation | None:
        """The likelihood at parameters; None if it cannot be computed accurately."""
        if not all(np.isfinite(part).all() for part in normals):
            return None
        values = np.linalg.eigvalsh(normals.scales)
        if values.min() <= 0.0 or values.max() >= _LARGEST_EIGENVALUE:
            return None
        masses, *inner = moments(normals.locations, normals.scales, self.lower, self.upper)
        if not (masses > _SMALLEST_MASS).all():
            return None
        precisions: Array = np.linalg.inv(normals.scales).astype(np.float64)
        log_likelihood, sums = self._expectation(self._coefficients(normals, precisions, masses))
        objective = log_likelihood + self.mass_penalty * float(np.log(masses).sum())
        if not np.isfinite(objective):
            return None
        counts = np.maximum(sums[:, 0], _SMALLEST_COUNT)
        gradient = self._gradient(normals, precisions, counts, sums, *inner)
        return Evaluation(normals, objective, log_likelihood, counts, *gradient)

    def _coefficients(self, normals: Normals, precisions: Array, masses: Array) -> Array:
        """Log density of each component as a quadratic in the features, (K, F)."""
        linear = np.einsum("kij,kj->ki", precisions, normals.locations)
        constant = np.log(normals.weights / masses) - 0.5 * (
            np.linalg.slogdet(normals.scales)[1]
            + np.einsum("ki,ki->k", linear, normals.locations)
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

    def _gradient(
        self,
        normals: Normals,
        precisions: Array,
        counts: Array,
        sums: Array,
        inner_means: Array,
        inner_covariances: Array,
    ) -> tuple[Array, Array, Array]:
        """The gradient, see `Evaluation`.

        The gradient of log α is exact: S⁻¹(E − m) in the location and
        S⁻¹(V + (E − m)(E − m)ᵀ − S)S⁻¹/2 in the scale matrix, with the mean E and covariance V of
        the truncated component.
        """
        m, scales, dimension = normals.locations, normals.scales, self.lower.size
        cut = counts - self.mass_penalty
        means = sums[:, 1 : dimension + 1] / counts[:, None]
        products = np.empty(scales.shape)
        products[:, self._pairs[0], self._pairs[1]] = sums[:, dimension + 1 :]
        products[:, self._pairs[1], self._pairs[0]] = sums[:, dimension + 1 :]
        inner = inner_means - m
        first = counts[:, None] * (means - m) - cut[:, None] * inner
        # Σ r (x − m)(x − m)ᵀ over the rows.
        second = products - counts[:, None, None] * (
            _outer(means, m) + _outer(m, means) - _outer(m, m)
        )
        second -= counts[:, None, None] * scales
        second -= cut[:, None, None] * (inner_covariances + _outer(inner, inner) - scales)
        return (
            counts - normals.weights * self.total,
            (precisions @ first[:, :, None])[:, :, 0],
            0.5 * precisions @ second @ precisions,
        )


class Coordinates:
    """A vector z for logits of weights, locations and scale matrices; z = 0 at the reference.

    A quasi-Newton method needs well-scaled coordinates. The units come from each component's Fisher
    information without bounds; a step along the gradient there is about a step of EM (Xu and Jordan
    1996). Let N_k be the number of rows of component k, F the floor, and S_k = F I + L_k L_kᵀ at
    the reference. The vector gives the logits logit + z/√N_k, the locations m_k + L_k z/√N_k, and
    the factors L_k (I + Z/√N_k) with Z lower triangular. Every z gives scale matrices above the
    floor.
    """

    def __init__(self, likelihood: Likelihood, reference: Evaluation) -> None:
        weights, self._locations, scales = reference.normals
        self._shape = self._locations.shape
        self._floor = likelihood.scale_floor * np.eye(self._shape[1])
        values, vectors = np.linalg.eigh(scales - self._floor)
        values = np.maximum(values, _ABOVE_FLOOR * likelihood.scale_floor + _TINY)
        above = (vectors * values[:, None, :]) @ np.swapaxes(vectors, 1, 2)
        self._logits, self._factors = np.log(weights), np.linalg.cholesky(above)
        self._unit = 1.0 / np.sqrt(np.maximum(reference.counts, _FEWEST_ROWS))
        self._low = np.tril_indices(self._shape[1])
        # The information on a diagonal entry is twice that on an entry off the diagonal.
        self._half = np.where(self._low[0] == self._low[1], np.sqrt(0.5), 1.0)

    @property
    def size(self) -> int:
        """Length of the vector: K (1 + d + d (d + 1)/2)."""
        count, dimension = self._shape
        return int(count * (1 + dimension + self._low[0].size))

    def normals(self, z: Array) -> Normals:
        """The parameters at z."""
        count, dimension = self._shape
        logits = self._logits + self._unit * z[:count]
        weights = np.exp(logits - logits.max())
        shifts = z[count : count * (1 + dimension)].reshape(*self._shape, 1)
        away = (self._factors @ shifts)[:, :, 0]
        factors = self._factors_at(z)
        return Normals(
            weights / weights.sum(),
            self._locations + self._unit[:, None] * away,
            self._floor + factors @ np.swapaxes(factors, 1, 2),
        )

    def gradient(self, z: Array, at: Evaluation) -> Array:
        """Gradient of the objective in z; `at` is the evaluation there."""
        in_factors = 2.0 * at.in_scales @ self._factors_at(z)
        back = np.swapaxes(self._factors, 1, 2)
        in_shifts = (back @ at.in_locations[:, :, None])[:, :, 0]
        in_turns = (back @ in_factors)[:, *self._low] * self._half
        parts = (at.in_logits[:, None], in_shifts, in_turns)
        return np.concatenate([(self._unit[:, None] * part).ravel() for part in parts])

    def gradient_norm(self, reference: Evaluation) -> float:
        """Largest component of the gradient at the reference.

        A scale matrix at its floor has no slope in z. The slope with respect to the logarithm of
        its eigenvalues, in the same units, is used in addition. The norm is ≥ 0, and 0 at a
        maximum.
        """
        values, vectors = np.linalg.eigh(reference.normals.scales)
        pull = values * np.einsum("kij,kil,klj->kj", vectors, reference.in_scales, vectors)
        along = np.abs(self.gradient(np.zeros(self.size), reference)).max()
        return float(max(along, (self._unit[:, None] * pull).max()))

    def _factors_at(self, z: Array) -> Array:
        """Factors (K, d, d) of the scale matrices minus the floor."""
        count, dimension = self._shape
        turned = np.zeros(self._factors.shape)
        turned[:, *self._low] = z[count * (1 + dimension) :].reshape(count, -1) * self._half
        result: Array = self._factors + self._factors @ (self._unit[:, None, None] * turned)
        return result


def _outer(first: Array, second: Array) -> Array:
    return first[:, :, None] * second[:, None, :]
