"""Takes the parameters of a truncated mixture and returns its components given some variables."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Components:
    """K normal distributions of d variables, each truncated to the same box; arrays read-only.

    Attributes:
        weights: π_k of the truncated components, (K,).
        locations, scale_matrices: before truncation, (K, d) and (K, d, d).
        lower, upper: bounds of the box, (d,).
        masses: α_k, the probability that the untruncated component lies in the box, (K,).
    """

    weights: Array
    locations: Array
    scale_matrices: Array
    lower: Array
    upper: Array
    masses: Array


class Given(NamedTuple):
    """The components at n given points.

    Attributes:
        log_weights: log of π_k N_k(y)/α_k minus its maximum over the components, (K, n).
        means: means of the target and of the integrated variables, (K, 1 + r, n).
    """

    log_weights: Array
    means: Array


class Regression:
    """Each untruncated component's distribution given some variables: the paper's (a1) and (a2).

    Args:
        components: components of the joint distribution.
        target: index of the target variable.
        given: indices of the g known variables, in the order of y's columns.
        rest: indices of the r other variables.

    Attributes:
        matrix, offset: (K (g + 1 + r), g) and (K (g + 1 + r),).  ``matrix @ y + offset`` has
            g + 1 + r numbers for each component.  The sum of squares of the first g is minus the
            exponent of N_k(y).  The others are the means of the target and of the rest.
        log_constant: log of the factor before that exponential, (K,), up to a common constant.
        covariances: covariances of the target and the rest given y, (K, 1 + r, 1 + r).
        spread: standard deviation of the target given y, (K,).
        rest_slopes: slopes of the rest on the target given y, (K, r).
        rest_covariances: covariances of the rest given y and the target, (K, r, r).
    """

    def __init__(
        self, components: Components, target: int, given: Sequence[int], rest: Sequence[int]
    ) -> None:
        known = len(given)
        order = [*given, target, *rest]
        ordered = components.scale_matrices[:, order][:, :, order]
        factors = np.asarray(np.linalg.cholesky(ordered), dtype=np.float64)
        centre = components.locations[:, order]
        # The inverse is triangular except for rounding.
        whitening = np.tril(np.linalg.inv(factors[:, :known, :known]))
        # With L the factor of the given block, S21 S11^-1 = L21 L11^-1.
        slopes = factors[:, known:, :known] @ whitening
        rows = np.concatenate((whitening * np.sqrt(0.5), slopes), axis=1)
        offset = np.concatenate((np.zeros_like(centre[:, :known]), centre[:, known:]), axis=1)
        offset = offset - np.einsum("krg,kg->kr", rows, centre[:, :known])
        self.known, self._shape = known, rows.shape[:2]
        self.matrix, self.offset = rows.reshape(offset.size, known), offset.ravel()
        diagonal = np.diagonal(factors[:, :known, :known], axis1=1, axis2=2)
        self.log_constant = np.log(components.weights / components.masses)
        self.log_constant -= np.log(diagonal).sum(axis=1)
        tail = factors[:, known:, known:]
        last = tail[:, 1:, 1:]
        covariances: Array = tail @ np.swapaxes(tail, 1, 2)
        rest_covariances: Array = last @ np.swapaxes(last, 1, 2)
        self.covariances = covariances
        self.spread = np.ascontiguousarray(tail[:, 0, 0])
        self.rest_slopes = tail[:, 1:, 0] / self.spread[:, None]
        self.rest_covariances = rest_covariances

    def at(self, y: Array) -> Given:
        """The components given y (n, g)."""
        # The last bits of a matrix product may depend on the number of threads; einsum's do not.
        rows = np.einsum("rg,ng->rn", self.matrix, y) + self.offset[:, None]
        parts = rows.reshape(*self._shape, -1)
        log_weights = self.log_constant[:, None] - (parts[:, : self.known] ** 2).sum(axis=1)
        return Given(log_weights - log_weights.max(axis=0), parts[:, self.known :])
