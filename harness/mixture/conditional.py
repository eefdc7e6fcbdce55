"""One variable of a truncated mixture, given some of the others."""

from collections.abc import Callable, Sequence
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.errors import InputError
from harness.mixture.drawing import UNIFORMS
from harness.mixture.regression import Regression
from harness.mixture.slices import Slices

if TYPE_CHECKING:
    from harness.mixture.distribution import TruncatedGaussianMixture

Array = NDArray[np.float64]

# Points handled at once; small enough for the temporary arrays to stay in the cache.
_CHUNK = 512
_MODES = 256
_DRAWS = 1024


class Conditional:
    """Distribution of variable ``target`` given the values of variables ``given``.

    With y the given values, component k has weight π_k N_k(y)/α_k, the target is normal with the
    paper's (a1) and (a2) inside its bounds, and every remaining variable is integrated out over
    its bounds: the density is multiplied by the probability that it lies inside them.

    The methods take y of shape (n, len(given)), columns in the order of ``given``, and one value
    per point (n,); a single row of y, or a single value, is used for all. Each point's result is
    the same to the last bit whatever else is in the batch. y outside its bounds is not refused:
    the formula is simply evaluated there.

    Nothing or one variable integrated out is in closed form; with two or three the density is
    tabulated once per distinct y, which takes tens of milliseconds.

    Args:
        mixture: the joint distribution.
        target: index of the wanted variable.
        given: indices of the known variables, in the order of y's columns; may be empty.

    Raises:
        InputError: indices that are repeated or out of range.
    """

    def __init__(
        self, mixture: "TruncatedGaussianMixture", target: int, given: Sequence[int]
    ) -> None:
        dimension = mixture.lower.size
        chosen = [target, *given]
        if any(not 0 <= i < dimension for i in chosen) or len(set(chosen)) < len(chosen):
            raise InputError(
                "conditional",
                f"target {target} and given {list(given)}",
                f"distinct indices from 0 to {dimension - 1}",
            )
        rest = [i for i in range(dimension) if i not in chosen]
        self._variables = dimension
        self.target, self.given = target, tuple(given)
        self.lower, self.upper = float(mixture.lower[target]), float(mixture.upper[target])
        regression = Regression(
            mixture.weights,
            mixture.masses,
            mixture.locations,
            mixture.scale_matrices,
            target,
            given,
            rest,
        )
        bounds = self.lower, self.upper
        self._slices = Slices(regression, *bounds, mixture.lower[rest], mixture.upper[rest])

    def logpdf(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Log density at x (n,) given y (n, g), (n,); −inf outside the bounds."""
        values, points = self._aligned(x, y)
        return self._chunked(self._slices.logpdf, values, points)

    def pdf(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Density at x (n,) given y (n, g), (n,), ≥ 0; 0 outside the bounds."""
        density: Array = np.exp(self.logpdf(x, y))
        return density

    def cdf(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Distribution function at x (n,) given y (n, g), (n,) in [0, 1]."""
        values, points = self._aligned(x, y)
        return self._chunked(self._slices.cdf, values, points)

    def ppf(self, u: ArrayLike, y: ArrayLike) -> Array:
        """Inverse of `cdf`: x (n,) inside the bounds with cdf(x, y) = u to 1e-9.

        u = 0 and u = 1 give the bounds themselves.

        Raises:
            InputError: u outside [0, 1] or nan.
        """
        values, points = self._aligned(u, y)
        if not (values.min(initial=0.0) >= 0.0 and values.max(initial=1.0) <= 1.0):
            wrong = values[~((values >= 0.0) & (values <= 1.0))]
            raise InputError("ppf", f"probability {wrong[0]}", "0 to 1")
        if values.size == 1:
            return np.array([self._slices.ppf_one(float(values[0]), points)])
        return self._chunked(self._slices.ppf, values, points)

    def mode(self, y: ArrayLike) -> Array:
        """Position (n,) of the highest density given y (n, g); it may lie on a bound."""
        points = self._points(y)
        if points.shape[0] == 1:
            return np.array([self._slices.mode_one(points)])
        parts = [
            self._slices.mode(points[at : at + _MODES]) for at in range(0, len(points), _MODES)
        ]
        return np.concatenate(parts) if parts else np.empty(0)

    def sample(self, y: ArrayLike, rng: np.random.Generator) -> Array:
        """One draw (n,) per row of y (n, g), from a fixed number of uniforms per row."""
        points = self._points(y)
        if len(self.given) + 1 < self._variables:
            return self._chunked(self._slices.ppf, rng.random((points.shape[0],)), points)
        result = np.empty(points.shape[0])
        for at in range(0, result.size, _DRAWS):
            part = points[at : at + _DRAWS]
            result[at : at + _DRAWS] = self._slices.drawn(
                part, rng.random((part.shape[0], UNIFORMS)).T
            )
        return result

    def _points(self, y: ArrayLike) -> Array:
        points = np.asarray(y, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != len(self.given):
            raise InputError("conditional", f"y of shape {points.shape}", f"(n, {len(self.given)})")
        if not isfinite(np.add.reduce(points, axis=None)) and not np.isfinite(points).all():
            raise InputError("conditional", "y has values that are not finite", "finite numbers")
        return points

    def _aligned(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """x (n,) and y (n, g), a single row or value of either repeated to fit the other."""
        values = np.asarray(x, dtype=np.float64)
        points = self._points(y)
        if values.ndim == 0:
            values = values[None]
        if values.ndim != 1 or (
            values.size != points.shape[0] and values.size != 1 and points.shape[0] != 1
        ):
            raise InputError(
                "conditional",
                f"values of shape {values.shape} for y of shape {points.shape}",
                "as many values as rows of y, or one of either",
            )
        if points.shape[0] < values.size:
            points = np.repeat(points, values.size, axis=0)
        elif values.size < points.shape[0]:
            values = np.repeat(values, points.shape[0])
        return values, points

    def _chunked(
        self, function: Callable[[Array, Array], Array], values: Array, points: Array
    ) -> Array:
        if values.size <= _CHUNK:
            return function(values, points)
        parts = [
            function(values[at : at + _CHUNK], points[at : at + _CHUNK])
            for at in range(0, values.size, _CHUNK)
        ]
        return np.concatenate(parts)
