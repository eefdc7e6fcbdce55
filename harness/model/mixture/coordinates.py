"""Takes a mixture's parameters and returns them as an unconstrained vector, with the gradient.

A quasi-Newton method needs well-scaled coordinates. The origin is a reference point, and the units
come from each component's Fisher information without bounds. A step along the gradient there is
about a step of EM (Xu and Jordan 1996).
"""

import numpy as np
from numpy.typing import NDArray

from harness.model.mixture.em import Evaluation, Parameters, Problem

Array = NDArray[np.float64]

# A scale matrix at its floor is raised by this share of the floor, so that S − F I has a factor.
_ABOVE_FLOOR = 1e-6
_TINY = 1e-12
# Components with fewer rows have the units of a component with this number of rows.
_FEWEST_ROWS = 1.0


class Coordinates:
    """A vector z for logits of weights, locations and scale matrices; z = 0 at the reference.

    Let N_k be the number of rows of component k, F the floor, and S_k = F I + L_k L_kᵀ at the
    reference. The vector gives the logits logit + z/√N_k, the locations m_k + L_k z/√N_k, and the
    factors L_k (I + Z/√N_k) with Z lower triangular. Every z gives scale matrices above the floor.
    """

    def __init__(self, problem: Problem, at: Evaluation) -> None:
        self._problem = problem
        weights, locations, scales = (
            at.parameters.weights,
            at.parameters.locations,
            at.parameters.scales,
        )
        self._shape = locations.shape
        dimension = locations.shape[1]
        self._floor = problem.scale_floor * np.eye(dimension)
        values, vectors = np.linalg.eigh(scales - self._floor)
        values = np.maximum(values, _ABOVE_FLOOR * problem.scale_floor + _TINY)
        above = (vectors * values[:, None, :]) @ np.swapaxes(vectors, 1, 2)
        self._logits, self._locations = np.log(weights), locations
        self._factors = np.linalg.cholesky(above)
        self._unit = 1.0 / np.sqrt(np.maximum(at.counts, _FEWEST_ROWS))
        self._low = np.tril_indices(dimension)
        # The information on a diagonal entry is twice that on an entry off the diagonal.
        self._half = np.where(self._low[0] == self._low[1], np.sqrt(0.5), 1.0)

    @property
    def size(self) -> int:
        """Length of the vector: K (1 + d + d (d + 1)/2)."""
        count, dimension = self._shape
        return int(count * (1 + dimension + self._low[0].size))

    def parameters(self, z: Array) -> Parameters:
        """The parameters at z."""
        logits, shifts, _ = self._parts(z)
        logits = self._logits + self._unit * logits
        weights = np.exp(logits - logits.max())
        away = (self._factors @ shifts[:, :, None])[:, :, 0]
        factors = self._factors_at(z)
        return Parameters(
            weights / weights.sum(),
            self._locations + self._unit[:, None] * away,
            self._floor + factors @ np.swapaxes(factors, 1, 2),
        )

    def gradient(self, z: Array, at: Evaluation) -> Array:
        """Gradient of the objective in z; `at` is the evaluation there."""
        in_logits, in_locations, in_scales = self._problem.gradient(at)
        in_factors = 2.0 * in_scales @ self._factors_at(z)
        back = np.swapaxes(self._factors, 1, 2)
        in_shifts = (back @ in_locations[:, :, None])[:, :, 0]
        in_turns = (back @ in_factors)[:, *self._low] * self._half
        parts = (in_logits[:, None], in_shifts, in_turns)
        return np.concatenate([(self._unit[:, None] * part).ravel() for part in parts])

    def gradient_norm(self, at: Evaluation) -> float:
        """Largest component of the gradient at the reference; `at` is the evaluation there.

        A scale matrix at its floor has no slope in z. The slope with respect to the logarithm of
        its eigenvalues, in the same units, is used in addition. The norm is ≥ 0, and 0 at a
        maximum.
        """
        values, vectors = np.linalg.eigh(at.parameters.scales)
        _, _, in_scales = self._problem.gradient(at)
        pull = values * np.einsum("kij,kil,klj->kj", vectors, in_scales, vectors)
        along = np.abs(self.gradient(np.zeros(self.size), at)).max()
        return float(max(along, (self._unit[:, None] * pull).max()))

    def _parts(self, z: Array) -> tuple[Array, Array, Array]:
        count, dimension = self._shape
        logits, shifts, turns = np.split(z, [count, count * (1 + dimension)])
        return logits, shifts.reshape(self._shape), turns.reshape(count, -1)

    def _factors_at(self, z: Array) -> Array:
        """Factors (K, d, d) of the scale matrices minus the floor."""
        turned = np.zeros(self._factors.shape)
        turned[:, *self._low] = self._parts(z)[2] * self._half
        result: Array = self._factors + self._factors @ (self._unit[:, None, None] * turned)
        return result
