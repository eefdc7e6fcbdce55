"""Takes weights, locations and scale matrices and returns a truncated Gaussian mixture."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular

from harness.core.errors import InputError
from harness.model.mixture import truncation
from harness.model.mixture.conditional import Components, Conditional

Array = NDArray[np.float64]

_MOST_VARIABLES = 4
_WHERE = "mixture"


class TruncatedGaussianMixture(Components):
    """Density Σ π_k N(x; m_k, S_k) / α_k inside a box, 0 outside.

    α_k is the mass of the untruncated component k inside the box, so π_k is the weight of the
    truncated component. Locations m_k and scale matrices S_k are those before truncation: m_k is
    not the mean of the truncated component, and may lie outside the box. With infinite bounds this
    is an ordinary Gaussian mixture. The object is immutable; its arrays are read-only.

    Args:
        weights: (K,), > 0, with a sum of 1 within 1e-6; they are divided by their sum.
        locations: (K, d), d from 1 to 4.
        scale_matrices: (K, d, d), symmetric positive definite.
        lower, upper: (d,), lower < upper, may be infinite.

    Attributes:
        weights, locations, scale_matrices, lower, upper: copies of the arguments.
        masses: α_k, (K,) in (0, 1].

    Raises:
        InputError: an argument is invalid, or a component has no mass inside the box.
    """

    _factors: Array

    def __init__(
        self,
        weights: ArrayLike,
        locations: ArrayLike,
        scale_matrices: ArrayLike,
        lower: ArrayLike,
        upper: ArrayLike,
    ) -> None:
        parts = {
            "weights": _array("weights", weights, 1),
            "locations": _array("locations", locations, 2),
            "scale_matrices": _array("scale_matrices", scale_matrices, 3),
            "lower": _array("lower", lower, 1),
            "upper": _array("upper", upper, 1),
        }
        _check_shapes(parts)
        _check_values(parts)
        parts["weights"] /= parts["weights"].sum()
        scales = parts["scale_matrices"]
        parts["scale_matrices"] = 0.5 * (scales + np.swapaxes(scales, 1, 2))
        factors = _factors(parts["scale_matrices"])
        parts["masses"] = truncation.masses(
            parts["locations"], parts["scale_matrices"], parts["lower"], parts["upper"]
        )
        for k in np.flatnonzero(~(parts["masses"] > 0.0)):
            raise InputError(
                _WHERE, f"component {k} has no mass inside the box", "locations nearer to the box"
            )
        for array in (*parts.values(), factors):
            array.setflags(write=False)
        super().__init__(**parts)
        object.__setattr__(self, "_factors", factors)

    def logpdf(self, x: ArrayLike) -> Array:
        """Log density at x (n, d), (n,); −inf outside the box."""
        points = np.asarray(x, dtype=np.float64)
        dimension = self.lower.size
        if points.ndim != 2 or points.shape[1] != dimension:
            raise InputError(_WHERE, f"points of shape {points.shape}", f"(n, {dimension})")
        terms = np.empty((self.weights.size, points.shape[0]))
        constant = np.log(self.weights / self.masses) - 0.5 * dimension * np.log(2.0 * np.pi)
        for k, factor in enumerate(self._factors):
            z = solve_triangular(factor, (points - self.locations[k]).T, lower=True)
            terms[k] = constant[k] - np.log(np.diag(factor)).sum() - 0.5 * (z * z).sum(axis=0)
        largest = terms.max(axis=0)
        logs = largest + np.log(np.exp(terms - largest).sum(axis=0))
        inside = ((points >= self.lower) & (points <= self.upper)).all(axis=1)
        result: Array = np.where(inside, logs, -np.inf)
        return result

    def sample(self, n: int, rng: np.random.Generator) -> Array:
        """n independent draws, (n, d), all inside the box.

        The components are drawn first. If a component has a large mass, normal vectors are drawn
        until enough are inside the box. If its mass is small, its variables are drawn one by one
        from their conditional distributions.
        """
        counts = rng.multinomial(n, self.weights)
        parts = [self._component(k, int(count), rng) for k, count in enumerate(counts)]
        rows = np.concatenate(parts)
        shuffled: Array = rows[rng.permutation(n)]
        return shuffled

    def _component(self, k: int, count: int, rng: np.random.Generator) -> Array:
        """Draws (count, d) from truncated component k."""
        if self.masses[k] < 1e-3:
            return self._one_by_one(k, count, rng)
        dimension = self.lower.size
        accepted = [np.empty((0, dimension))]
        missing = count
        while missing > 0:
            tries = int(missing / self.masses[k] * 1.1) + 16
            z = rng.standard_normal((min(tries, 1_000_000), dimension))
            rows = self.locations[k] + z @ self._factors[k].T
            rows = rows[((rows >= self.lower) & (rows <= self.upper)).all(axis=1)][:missing]
            accepted.append(rows)
            missing -= rows.shape[0]
        return np.concatenate(accepted)

    def _one_by_one(self, k: int, count: int, rng: np.random.Generator) -> Array:
        """Draws (count, d) from component k by the chain of its conditional distributions."""
        component = TruncatedGaussianMixture(
            [1.0], self.locations[[k]], self.scale_matrices[[k]], self.lower, self.upper
        )
        rows = np.empty((count, self.lower.size))
        for i in range(self.lower.size):
            rows[:, i] = component.conditional(i, range(i)).sample(rows[:, :i], rng)
        return rows

    def mean(self) -> Array:
        """Mean of the truncated mixture, (d,)."""
        result: Array = self.weights @ self._moments[0]
        return result

    def covariance(self) -> Array:
        """Covariance of the truncated mixture, (d, d)."""
        means, covariances = self._moments
        away = means - self.mean()
        spread = covariances + away[:, :, None] * away[:, None, :]
        result: Array = np.einsum("k,kij->ij", self.weights, spread)
        return result

    @cached_property
    def _moments(self) -> tuple[Array, Array]:
        """Means (K, d) and covariances (K, d, d) of the truncated components."""
        return truncation.moments(self.locations, self.scale_matrices, self.lower, self.upper)[1:]

    def conditional(self, target: int, given: Sequence[int]) -> Conditional:
        """Distribution of variable ``target`` given the variables ``given``; see `Conditional`."""
        return Conditional(self, target, given)


def _array(name: str, values: ArrayLike, dimensions: int) -> Array:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{_WHERE}: {name}", "not an array of numbers") from None
    if array.ndim != dimensions:
        raise InputError(
            f"{_WHERE}: {name}", f"{array.ndim} dimensions", f"{dimensions} dimensions"
        )
    return array


def _check_shapes(parts: dict[str, Array]) -> None:
    count, dimension = parts["locations"].shape
    if not 1 <= dimension <= _MOST_VARIABLES:
        raise InputError(
            f"{_WHERE}: locations", f"{dimension} variables", f"1 to {_MOST_VARIABLES}"
        )
    expected_shapes = {
        "weights": (count,),
        "scale_matrices": (count, dimension, dimension),
        "lower": (dimension,),
        "upper": (dimension,),
    }
    for name, shape in expected_shapes.items():
        actual = parts[name].shape
        if actual != shape or count == 0:
            raise InputError(f"{_WHERE}: {name}", f"shape {actual}", f"shape {shape}, K ≥ 1")


def _check_values(parts: dict[str, Array]) -> None:
    for name in ("weights", "locations", "scale_matrices"):
        if not np.isfinite(parts[name]).all():
            raise InputError(f"{_WHERE}: {name}", "values that are not finite", "finite numbers")
    weights, scales = parts["weights"], parts["scale_matrices"]
    if not (weights > 0.0).all() or abs(weights.sum() - 1.0) > 1e-6:
        raise InputError(
            f"{_WHERE}: weights",
            f"smallest {weights.min():.6g}, sum {weights.sum():.9g}",
            "positive numbers that sum to 1 within 1e-6",
        )
    for k, matrix in enumerate(scales):
        if np.abs(matrix - matrix.T).max() > 1e-8 * np.abs(matrix).max():
            raise InputError(f"{_WHERE}: scale_matrices", f"number {k} is not symmetric")
    for i in np.flatnonzero(~(parts["lower"] < parts["upper"])):
        raise InputError(
            f"{_WHERE}: lower",
            f"variable {i} has bounds {parts['lower'][i]:g} and {parts['upper'][i]:g}",
            "lower < upper",
        )


def _factors(scale_matrices: Array) -> Array:
    """Lower Cholesky factors (K, d, d)."""
    factors = np.empty_like(scale_matrices)
    for k, matrix in enumerate(scale_matrices):
        try:
            factors[k] = np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            raise InputError(
                f"{_WHERE}: scale_matrices", f"number {k} is not positive definite"
            ) from None
    return factors
