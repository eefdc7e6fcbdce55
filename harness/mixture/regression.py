"""Each component's regression of the target and the integrated variables on the given ones.

Everything that does not depend on the values of the given variables is worked out once. What is
left for a batch of n points is a handful of array operations of shape (rows, n) whose result for
one point cannot depend on the other points of the batch: sums over the (at most three) given
variables are written out, and no matrix product runs along the batch.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class State(NamedTuple):
    """The components at n given points, as (K, 1, n), or at one point, flat, as (K,).

    Attributes:
        log_weights: log of weight times density of the given values over the component's mass,
            less the largest over the components.
        means: of the target.
        rest_means: of the integrated variables, one array each.
    """

    log_weights: Array
    means: Array
    rest_means: tuple[Array, ...]

    def many(self) -> "State":
        """The flat components of one point as those of a batch of one."""
        return State(
            self.log_weights.reshape(-1, 1, 1),
            self.means.reshape(-1, 1, 1),
            tuple(part.reshape(-1, 1, 1) for part in self.rest_means),
        )

    def take(self, chosen: NDArray[np.intp]) -> "State":
        """Some of the points; the arrays keep their order in memory, which sums depend on."""
        return State(
            self.log_weights.take(chosen, axis=-1),
            self.means.take(chosen, axis=-1),
            tuple(part.take(chosen, axis=-1) for part in self.rest_means),
        )


class Regression:
    """Conditional distribution of each untruncated component, as in the paper's (a1) and (a2).

    Args:
        weights, masses: (K,); locations: (K, d); scale_matrices: (K, d, d).
        target: the variable wanted; given: those known; rest: those integrated out.
    """

    def __init__(
        self,
        weights: Array,
        masses: Array,
        locations: Array,
        scale_matrices: Array,
        target: int,
        given: Sequence[int],
        rest: Sequence[int],
    ) -> None:
        count, known = weights.size, len(given)
        order = [*given, target, *rest]
        factors = np.linalg.cholesky(scale_matrices[:, order][:, :, order])
        centre = locations[:, order]
        known_factor = factors[:, :known, :known]
        # The inverse is triangular too, but for rounding.
        whitening = np.tril(np.linalg.inv(known_factor))
        # With L the factor of the given block, S21 S11^-1 = L21 L11^-1.
        slopes = factors[:, known:, :known] @ whitening
        rows = np.concatenate((whitening * np.sqrt(0.5), slopes), axis=1)
        offset = np.concatenate((np.zeros((count, known)), centre[:, known:]), axis=1)
        offset = offset - np.einsum("krg,kg->kr", rows, centre[:, :known])
        # Row-major by row, then component: (rows * K, 1) per given variable.
        self._coefficients = [
            np.ascontiguousarray(rows[:, :, j].T).reshape(-1, 1) for j in range(known)
        ]
        self._offset = np.ascontiguousarray(offset.T).reshape(-1, 1)
        diagonal = np.diagonal(known_factor, axis1=1, axis2=2)
        constant = np.log(weights) - np.log(masses) - 0.5 * known * np.log(2.0 * np.pi)
        self._constant = (constant - np.sum(np.log(diagonal), axis=1)).reshape(-1, 1, 1)
        self._flat_coefficients = [c.reshape(-1) for c in self._coefficients]
        self._flat_offset = self._offset.reshape(-1)
        self._flat_constant = self._constant.reshape(-1)
        self.count, self.known = count, known
        # Further from 0 than any component's rest by its spread, (r,).
        rest_spread = np.sqrt(np.diagonal(scale_matrices, axis1=1, axis2=2)[:, rest])
        self.rest_reach = (np.abs(locations[:, rest]) + rest_spread).max(axis=0)
        # Given everything known, the target's spread and the rest's slope on it and covariance.
        self.spread = np.ascontiguousarray(factors[:, known, known])
        self.rest_slopes = factors[:, known + 1 :, known] / self.spread[:, None]
        tail = factors[:, known + 1 :, known + 1 :]
        self.rest_covariances = tail @ np.swapaxes(tail, 1, 2)

    def at(self, y: Array) -> State:
        """The components at given points y (n, g)."""
        count = y.shape[0]
        rows = np.repeat(self._offset, count, axis=1)
        term = np.empty_like(rows)
        for j, (coefficient, values) in enumerate(zip(self._coefficients, y.T, strict=True)):
            # The whitening is triangular: earlier rows do not depend on later given variables.
            first = j * self.count
            rows[first:] += np.multiply(coefficient[first:], values, out=term[first:])
        parts = rows.reshape(-1, self.count, 1, count)
        log_weights = np.repeat(self._constant, count, axis=2)
        for z in parts[: self.known]:
            log_weights -= np.multiply(z, z, out=z)
        return self._state(log_weights, parts)

    def at_one(self, y: list[float]) -> State:
        """The components at one point (g,), flat; the same arithmetic with less overhead."""
        rows = self._flat_offset
        for coefficient, value in zip(self._flat_coefficients, y, strict=True):
            rows = rows + coefficient * value
        parts = rows.reshape(-1, self.count)
        log_weights = self._flat_constant
        for z in parts[: self.known]:
            log_weights = log_weights - z * z
        return self._state(log_weights, parts)

    def _state(self, log_weights: Array, parts: Array) -> State:
        heaviest = np.maximum.reduce(log_weights, axis=0)
        rest = tuple(parts[self.known + 1 :])
        return State(log_weights - heaviest, parts[self.known], rest)
