"""A mixture's parameters in; its penalised likelihood with the exact gradient out.

Source: Lee and Scott (2012), with the penalty of ``fit_mixture``.  All columns are standardised to
mean 0 and spread 1.
"""

from typing import NamedTuple

import numpy as np

from harness.core.freezing import frozen
from harness.core.vocabulary import FloatArray
from harness.model.mixture.boxes import moments
from harness.model.mixture.distribution import SMALLEST_MASS
from harness.model.mixture.normals import Normals

SCALE_FLOOR = 1e-4
"""No scale matrix has a smaller eigenvalue; otherwise repeated rows could make it singular."""

_LARGEST_EIGENVALUE = 1e8
"""A component beyond this limit diverges, and its moments are noise."""
_SMALLEST_COUNT = 1e-9
"""A component counts as having at least so many rows, so none has 0."""
_ABOVE_FLOOR = 1e-6 * SCALE_FLOOR
"""A scale matrix at its floor is raised by this, so that S − F I has a factor."""
_FEWEST_ROWS = 1.0
"""Components with fewer rows have the units of a component with this number of rows."""


class Evaluation(NamedTuple):
    """The likelihood at some parameters.

    Attributes:
        normals: the parameters.
        objective, log_likelihood: totals over the rows, with and without the penalty.
        counts: number of rows of each component, by responsibility, (K,).
        slopes: gradient of the objective in the logits of the weights (K,), the locations (K, d)
            and the scale matrices (K, d, d).  A symmetric dS changes the objective by
            Σ_ij g_ij dS_ij.
    """

    normals: Normals
    objective: float
    log_likelihood: float
    counts: FloatArray
    slopes: tuple[FloatArray, FloatArray, FloatArray]


class Likelihood:
    """The penalised likelihood of rows inside a box.

    Args:
        rows: standardised rows, (n, d).
        weights: weights of the rows, (n,).
        lower, upper: standardised bounds, (d,).
    """

    def __init__(
        self, rows: FloatArray, weights: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> None:
        self.weights, self.lower, self.upper = weights, lower, upper
        self.total = float(weights.sum())
        squares = _outer(rows, rows).reshape(len(rows), -1)
        features = np.concatenate((np.ones((len(rows), 1)), rows, squares), axis=1)
        self._features = np.ascontiguousarray(features.T)

    def at(self, normals: Normals) -> Evaluation | None:
        """The likelihood at parameters; None if it cannot be computed accurately.

        The gradient of log α is S⁻¹(E − m) in the location and S⁻¹(V + (E − m)(E − m)ᵀ − S)S⁻¹/2
        in the scale matrix, with the mean E and covariance V of the truncated component.
        """
        weights, locations, scales = normals
        if not all(np.isfinite(part).all() for part in normals):
            return None
        values = np.linalg.eigvalsh(scales)
        if values.min() <= 0.0 or values.max() >= _LARGEST_EIGENVALUE:
            return None
        masses, inner_means, inner_covariances = moments(locations, scales, self.lower, self.upper)
        if not (masses >= SMALLEST_MASS).all():
            return None
        # The log density of each component is a quadratic in the features, (K, F).
        dimension, precisions = self.lower.size, np.linalg.inv(scales)
        linear = np.einsum("kij,kj->ki", precisions, locations)
        constant = np.log(weights / masses) - 0.5 * (
            np.log(values).sum(axis=1)
            + (linear * locations).sum(axis=1)
            + dimension * np.log(2.0 * np.pi)
        )
        quadratic = -0.5 * precisions.reshape(len(weights), -1)
        terms = np.concatenate((constant[:, None], linear, quadratic), axis=1) @ self._features
        largest = terms.max(axis=0)
        np.exp(np.subtract(terms, largest, out=terms), out=terms)
        total = terms.sum(axis=0)
        log_likelihood = float(self.weights @ (np.log(total) + largest))
        objective = log_likelihood + float(np.log(masses).sum())
        if not np.isfinite(objective):
            return None
        # Sums of the features, weighted by responsibility, (K, F).
        terms *= self.weights / total
        sums = terms @ self._features.T
        counts = np.maximum(sums[:, 0], _SMALLEST_COUNT)
        means, products = np.split(sums[:, 1:], [dimension], axis=1)
        inner = inner_means - locations
        # The penalty Π α_k counts like one row less.
        n, cut = counts[:, None], counts[:, None] - 1.0
        first = means - n * locations - cut * inner
        # Σ r (x − m)(x − m)ᵀ over the rows, less what is expected of it.
        crossed = _outer(means, locations)
        second = products.reshape(scales.shape) - crossed - np.swapaxes(crossed, 1, 2)
        second += n[..., None] * (_outer(locations, locations) - scales)
        second -= cut[..., None] * (inner_covariances + _outer(inner, inner) - scales)
        slopes = (
            counts - weights * self.total,
            (precisions @ first[:, :, None])[:, :, 0],
            0.5 * precisions @ second @ precisions,
        )
        return Evaluation(normals, objective, log_likelihood, *frozen((counts, slopes)))


class Coordinates:
    """A vector z for logits of weights, locations and scale matrices; z = 0 at the reference.

    A quasi-Newton method needs well-scaled coordinates.  The units come from each component's
    Fisher information without bounds; a step along the gradient there is about a step of EM (Xu and
    Jordan 1996).  Let N_k be the number of rows of component k, F the floor, and S_k = F I + L_k
    L_kᵀ at the reference.  The vector gives the logits logit + z/√N_k, the locations m_k + L_k
    z/√N_k, and the factors L_k (I + Z/√N_k) with Z lower triangular.  Every z gives scale matrices
    above the floor.
    """

    def __init__(self, likelihood: Likelihood, reference: Evaluation) -> None:
        self._likelihood, self._reference = likelihood, reference
        weights, self._locations, scales = reference.normals
        count, dimension = self._locations.shape
        self._floor = SCALE_FLOOR * np.eye(dimension)
        values, vectors = np.linalg.eigh(scales - self._floor)
        values = np.maximum(values, _ABOVE_FLOOR)
        above = (vectors * values[:, None, :]) @ np.swapaxes(vectors, 1, 2)
        self._logits, self._factors = np.log(weights), np.linalg.cholesky(above)
        self._unit = 1.0 / np.sqrt(np.maximum(reference.counts, _FEWEST_ROWS))[:, None]
        self._low = np.tril_indices(dimension)
        # The information on a diagonal entry is twice that on an entry off the diagonal.
        self._half = np.where(self._low[0] == self._low[1], np.sqrt(0.5), 1.0)
        self._ends = count, count * (1 + dimension)
        self.size = self._ends[1] + count * self._half.size

    def normals(self, z: FloatArray) -> Normals:
        """The parameters at z."""
        logit, shift, _ = np.split(z, self._ends)
        logits = self._logits + self._unit[:, 0] * logit
        weights = np.exp(logits - logits.max())
        shifts = shift.reshape(*self._locations.shape, 1)
        away = (self._factors @ shifts)[:, :, 0]
        factors = self._factors_at(z)
        locations = self._locations + self._unit * away
        scales = self._floor + factors @ np.swapaxes(factors, 1, 2)
        return Normals(*frozen((weights / weights.sum(), locations, scales)))

    def below(self, z: FloatArray) -> tuple[float, FloatArray]:
        """Minus the objective and its gradient at z; infinite where it cannot be computed."""
        here = self._likelihood.at(self.normals(z))
        if here is None:
            return np.inf, np.zeros_like(z)
        return -here.objective, -self._gradient(z, here)

    def gradient(self) -> tuple[FloatArray, float]:
        """Gradient of the objective at the reference, and its largest component per unit of weight.

        A scale matrix at its floor has no slope in z.  The slope with respect to the logarithm of
        its eigenvalues, in the same units, is used in addition.  The number is ≥ 0, and 0 at a
        maximum.
        """
        values, vectors = np.linalg.eigh(self._reference.normals.scales)
        in_scales = self._reference.slopes[2]
        pull = values * np.einsum("kij,kil,klj->kj", vectors, in_scales, vectors)
        gradient = self._gradient(np.zeros(self.size), self._reference)
        largest = max(np.abs(gradient).max(), (self._unit * pull).max())
        return gradient, float(largest) / self._likelihood.total

    def _gradient(self, z: FloatArray, at: Evaluation) -> FloatArray:
        """Gradient of the objective in z; ``at`` is the evaluation there."""
        in_logits, in_locations, in_scales = at.slopes
        in_factors = 2.0 * in_scales @ self._factors_at(z)
        back = np.swapaxes(self._factors, 1, 2)
        in_shifts = (back @ in_locations[:, :, None])[:, :, 0]
        in_turns = (back @ in_factors)[:, *self._low] * self._half
        parts = (in_logits[:, None], in_shifts, in_turns)
        return np.concatenate([(self._unit * part).ravel() for part in parts])

    def _factors_at(self, z: FloatArray) -> FloatArray:
        """Factors (K, d, d) of the scale matrices minus the floor."""
        turned = np.zeros(self._factors.shape)
        turned[:, *self._low] = z[self._ends[1] :].reshape(len(turned), -1) * self._half
        return np.asarray(self._factors + self._factors @ (self._unit[:, :, None] * turned))


def _outer(first: FloatArray, second: FloatArray) -> FloatArray:
    return first[:, :, None] * second[:, None, :]
