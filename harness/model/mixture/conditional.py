"""Takes a truncated mixture and returns the distribution of one variable given others."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import count
from math import inf, isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr

from harness.core.errors import InputError
from harness.model.mixture.boxes import box_probability, interval
from harness.model.mixture.modes import Normal, highest_point
from harness.model.mixture.tabulated import TabulatedDensity, panel_edges

Array = NDArray[np.float64]

# An infinite bound of the target is replaced by this many spreads beyond every component.
_BEYOND = 12.0
# A smaller total probability has too few digits. The second limit is for integrated variables.
_SMALLEST_TOTAL = (1e-200, 1e-7)
_LOWEST = 1e-300
# The mode is searched on finer and finer grids around the highest node of a table. Nodes are at
# most a fifth of the narrowest component's spread apart.
_LOOKS = np.linspace(-1.0, 1.0, 33)
_NARROWING = 0.2 * 16.0 ** -np.arange(4)
# Number of cached tables, for states that repeat, such as the state at the trigger.
_KEPT = 64


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


class Conditional:
    """Distribution of variable ``target`` given the values y of variables ``given``.

    Component k has weight π_k N_k(y)/α_k. Inside its bounds the target is normal with the paper's
    (a1) and (a2). The other variables are integrated out: the density is multiplied by the
    probability that they lie inside their bounds.

    The methods take y of shape (n, len(given)), with columns in the order of ``given``, and one
    value per point (n,). A single row of y, or a single value, applies to all points. For y outside
    its bounds the same formula is evaluated. ``ppf`` and ``mode`` of a point do not depend on the
    other points of the batch, to the last bit.

    Args:
        components: components of the joint distribution.
        target: index of the target variable.
        given: indices of the known variables, in the order of y's columns; may be empty.
    """

    def __init__(self, components: Components, target: int, given: Sequence[int]) -> None:
        rest = [i for i in range(components.lower.size) if i != target and i not in given]
        self.target, self.given = target, tuple(given)
        self.lower, self.upper = float(components.lower[target]), float(components.upper[target])
        self._rest_lower, self._rest_upper = components.lower[rest], components.upper[rest]
        self._regression = Regression(components, target, given, rest)
        # The narrowest part of the density is a component given all other variables.
        precisions = np.linalg.inv(components.scale_matrices)[:, target, target]
        self._narrowest = float(precisions.max() ** -0.5)
        spread = self._regression.spread
        self._log_units = np.log(spread * np.sqrt(2.0 * np.pi))[:, None]
        heights = self._regression.log_constant - np.log(spread)
        self._heights = np.stack((heights, spread**-2.0, spread), axis=1).tolist()
        self._edges: Array | None = None
        if isfinite(self.lower) and isfinite(self.upper):
            self._edges = panel_edges(self.lower, self.upper, self._narrowest)
        self._tables: dict[tuple[float, ...], TabulatedDensity] = {}

    def logpdf(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Log density at x (n,) given y (n, g), (n,); −inf outside the bounds."""
        values, points = self._aligned(x, y)
        inside = (values >= self.lower) & (values <= self.upper)
        given = self._regression.at(points)
        logs = self._log_unnormalised(values, given)
        total, weak = self._total(given)
        with np.errstate(divide="ignore"):
            log_total = np.log(total)
        for i in weak:
            log_total[i] = self._table(points[i]).log_total
        return np.where(inside, logs - log_total, -np.inf)

    def pdf(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Density at x (n,) given y (n, g), (n,), ≥ 0; 0 outside the bounds."""
        density: Array = np.exp(self.logpdf(x, y))
        return density

    def cdf(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Distribution function at x (n,) given y (n, g), (n,) in [0, 1]."""
        values, points = self._aligned(x, y)
        given = self._regression.at(points)
        total, weak = self._total(given)
        result = np.empty(values.size)
        if weak.size < values.size:
            with np.errstate(divide="ignore", invalid="ignore"):
                result = self._mass(given, np.maximum(values, self.lower)) / total
        for i in weak:
            result[i] = self._table(points[i]).cdf(float(values[i]))
        result = np.clip(result, 0.0, 1.0)
        return np.where(values <= self.lower, 0.0, np.where(values >= self.upper, 1.0, result))

    def ppf(self, u: ArrayLike, y: ArrayLike) -> Array:
        """Inverse of `cdf`: x (n,) inside the bounds with cdf(x, y) = u to 1e-9.

        u = 0 and u = 1 give the bounds themselves.

        Raises:
            InputError: u is outside [0, 1] or NaN.
        """
        values, points = self._aligned(u, y)
        for wrong in values[~((values >= 0.0) & (values <= 1.0))]:
            raise InputError("ppf", f"probability {wrong}", "0 to 1")
        pairs = zip(values.tolist(), points, strict=True)
        return np.array([self.ppf_at(value, point) for value, point in pairs])

    def ppf_at(self, u: float, y: Array) -> float:
        """`ppf` of one u in [0, 1] given one y (g,) of finite numbers."""
        if u in (0.0, 1.0):
            return self.upper if u else self.lower
        return self._table(y).ppf(u)

    def mode(self, y: ArrayLike) -> Array:
        """Position (n,) of the highest density given y (n, g); it may lie on a bound."""
        return np.array([self.mode_at(point) for point in self._points(y)])

    def mode_at(self, y: Array) -> float:
        """`mode` given one y (g,) of finite numbers."""
        if not self._rest_lower.size:
            normals = self._normals(y)
            return highest_point(
                normals, *self._bounds((normal[1], normal[3]) for normal in normals)
            )
        given = self._regression.at(y[None])
        x = self._table(y).highest
        for reach in _NARROWING * self._narrowest:
            grid = np.clip(x + reach * _LOOKS, self.lower, self.upper)
            x = float(grid[self._log_unnormalised(grid, given).argmax()])
        return x

    def _normals(self, y: Array) -> list[Normal]:
        """The components given y, as normal densities of the target."""
        numbers = (self._regression.matrix @ y + self._regression.offset).tolist()
        step = len(self.given) + 1
        return [
            (
                constant - sum([z * z for z in numbers[at : at + step - 1]]),
                numbers[at + step - 1],
                *width,
            )
            for at, (constant, *width) in zip(count(0, step), self._heights, strict=False)
        ]

    def sample(self, y: ArrayLike, rng: np.random.Generator) -> Array:
        """One draw (n,) per row of y (n, g), from one uniform each."""
        points = self._points(y)
        return self.ppf(rng.random(points.shape[0]), points)

    def _table(self, y: Array) -> TabulatedDensity:
        """The tabulated density given one y (g,)."""
        key = tuple(y.tolist())
        if key not in self._tables:
            if len(self._tables) >= _KEPT:
                self._tables.clear()
            given = self._regression.at(y[None])
            edges = self._edges
            if edges is None:
                normals = zip(given.means[:, 0, 0], self._regression.spread, strict=True)
                edges = panel_edges(*self._bounds(normals), self._narrowest)
            self._tables[key] = TabulatedDensity(lambda x: self._log_unnormalised(x, given), edges)
        return self._tables[key]

    def _bounds(self, normals: Iterable[tuple[float, float]]) -> tuple[float, float]:
        """Finite bounds for components with these means and spreads."""
        lower, upper = self.lower, self.upper
        if lower == -inf:
            lower = min(mean - _BEYOND * spread for mean, spread in normals)
        if upper == inf:
            upper = max(mean + _BEYOND * spread for mean, spread in normals)
        return lower, upper

    def _log_unnormalised(self, x: Array, given: Given) -> Array:
        """Log density up to a constant at x (n,), for n given points or for one."""
        regression = self._regression
        away = x - given.means[:, 0]
        z = away / regression.spread[:, None]
        logs = given.log_weights - self._log_units - 0.5 * z * z
        if self._rest_lower.size:
            centre = given.means[:, 1:] + regression.rest_slopes[:, :, None] * away[:, None]
            logs += self._log_inside(np.swapaxes(centre, 1, 2))
        largest = logs.max(axis=0)
        result: Array = largest + np.log(np.exp(logs - largest).sum(axis=0))
        return result

    def _log_inside(self, centre: Array) -> Array:
        """Log probability (K, n) that the other variables, centred at (K, n, r), are in bounds."""
        covariances = self._regression.rest_covariances
        lower, upper = self._rest_lower - centre, self._rest_upper - centre
        if centre.shape[2] == 1:
            spread = np.sqrt(covariances[:, :, 0])
            return _log_interval(lower[:, :, 0] / spread, upper[:, :, 0] / spread)
        inside = _boxes(covariances, lower, upper)
        log_inside: Array = np.log(np.maximum(inside, _LOWEST))
        return log_inside

    def _total(self, given: Given) -> tuple[Array, NDArray[np.intp]]:
        """Integral over the target's bounds, (n,), and the points that need a table instead.

        A point needs a table if the integral has too few digits, or if no variable is given.
        """
        if not self.given:
            points = np.arange(given.means.shape[2])
            return np.ones(points.size), points
        total = self._mass(given, np.full(given.means.shape[2], self.upper))
        smallest = _SMALLEST_TOTAL[self._rest_lower.size > 0]
        return total, np.flatnonzero(~(total > smallest))

    def _mass(self, given: Given, x: Array) -> Array:
        """Integral of the density from the target's lower bound to x (n,)."""
        centre = np.swapaxes(given.means, 1, 2)
        lower, upper = np.empty_like(centre), np.empty_like(centre)
        lower[..., 0], upper[..., 0] = self.lower, x
        lower[..., 1:], upper[..., 1:] = self._rest_lower, self._rest_upper
        inside = _boxes(self._regression.covariances, lower - centre, upper - centre)
        mass: Array = (np.exp(given.log_weights) * inside).sum(axis=0)
        return mass

    def _points(self, y: ArrayLike) -> Array:
        points = np.asarray(y, dtype=np.float64)
        if not np.isfinite(points).all():
            raise InputError("conditional", "y has values that are not finite", "finite numbers")
        return points

    def _aligned(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """x (n,) and y (n, g); a single row or value is repeated to fit the other."""
        values, points = np.atleast_1d(np.asarray(x, dtype=np.float64)), self._points(y)
        size = max(values.size, len(points)) if values.size and len(points) else 0
        return np.broadcast_to(values, size), np.broadcast_to(points, (size, points.shape[1]))


def _boxes(covariances: Array, lower: Array, upper: Array) -> Array:
    """Probabilities (K, n) of boxes (K, n, d) under centred normals of (K, d, d)."""
    shape = lower.shape
    every = np.repeat(covariances, shape[1], axis=0)
    flat = (-1, shape[2])
    return box_probability(every, lower.reshape(flat), upper.reshape(flat)).reshape(shape[:2])


def _log_interval(a: Array, b: Array) -> Array:
    """log(Φ(b) − Φ(a)) for a < b; finite even if the interval is far from 0."""
    inside = interval(a, b)
    if inside.min() > _LOWEST:
        log_inside: Array = np.log(inside)
        return log_inside
    flip = a > -b
    a, b = np.where(flip, -b, a), np.where(flip, -a, b)
    outer: Array = log_ndtr(b)
    return outer + np.log(-np.expm1(log_ndtr(a) - outer))
