"""A truncated mixture in; the distribution of one variable given others out."""

from collections.abc import Sequence
from math import exp

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr

from harness.core.errors import InputError
from harness.core.vocabulary import FloatArray
from harness.model.mixture.boxes import box_probability
from harness.model.mixture.distribution import TruncatedGaussianMixture, log_sum
from harness.model.mixture.tabulated import TabulatedDensity

_SMALLEST_TOTAL = 1e-7
"""A smaller total probability has too few digits."""
_LOWEST = 1e-300
"""Densities are kept above this, so that they have a logarithm."""
_LOOKS = np.linspace(-1.0, 1.0, 33)
_NARROWING = 0.2 * 16.0 ** -np.arange(4)
"""The mode is searched on finer and finer grids around the highest node of a table.  Nodes are at
most a fifth of the narrowest component's spread apart."""
_KEPT = 64
"""Number of cached tables, for states that repeat, such as the state at the trigger."""
_NO_PART, _LOW = 25.0, 7.0
"""A component whose peak is below e^-25 of another's moves a mode by less than 1e-9.  One below
e^-7 adds at most a thousandth to another peak, so no ascent starts from it."""
_MOST_STEPS = 60
"""Newton's method ends after so many steps at the latest."""
_LAST_STEP = 1e-5
"""In spreads: a shorter step is the last one, because Newton's method converges quadratically."""

Normal = tuple[float, float, float, float]
"""log h, mean, 1/s² and s of the density h · exp(−(x − mean)²/(2 s²))."""


class Conditional:
    """Distribution of variable ``target`` given the values y of variables ``given``.

    Component k has weight π_k N_k(y)/α_k.  Inside its bounds the target is normal with the paper's
    (a1) and (a2).  The other variables are integrated out: the density is multiplied by the
    probability that they lie inside their bounds.

    The methods take y of shape (n, len(given)), with columns in the order of ``given``, and one
    value per point (n,).  A single row of y, or a single value, applies to all points.  For y
    outside its bounds the same formula is evaluated.  ``ppf`` and ``mode`` of a point do not depend
    on the other points of the batch, to the last bit.

    Args:
        mixture: the joint distribution, with finite bounds.
        target: index of the target variable.
        given: indices of the g known variables, in the order of y's columns; may be empty.  The r
            variables that are neither are integrated out.
    """

    def __init__(
        self, mixture: TruncatedGaussianMixture, target: int, given: Sequence[int]
    ) -> None:
        if not np.isfinite([mixture.lower, mixture.upper]).all():
            raise InputError("conditional", "the mixture has an infinite bound", "finite bounds")
        rest = [i for i in range(mixture.lower.size) if i != target and i not in given]
        self.given = tuple(given)
        self.lower, self.upper = float(mixture.lower[target]), float(mixture.upper[target])
        self._rest_lower, self._rest_upper = mixture.lower[rest], mixture.upper[rest]
        known, order = len(given), [*given, target, *rest]
        ordered = mixture.scale_matrices[:, order][:, :, order]
        factors: FloatArray = np.asarray(np.linalg.cholesky(ordered), dtype=np.float64)
        centre = mixture.locations[:, order]
        # The inverse is triangular except for rounding.
        whitening = np.tril(np.linalg.inv(factors[:, :known, :known]))
        # With L the factor of the given block, S21 S11^-1 = L21 L11^-1.
        slopes = factors[:, known:, :known] @ whitening
        # ``matrix @ y + offset`` has g + 1 + r numbers for each component. The sum of squares of
        # the first g is minus the exponent of N_k(y). The others are the means of the target and
        # of the rest.
        rows = np.concatenate((whitening * np.sqrt(0.5), slopes), axis=1)
        offset = np.concatenate((np.zeros_like(centre[:, :known]), centre[:, known:]), axis=1)
        offset = offset - np.einsum("krg,kg->kr", rows, centre[:, :known])
        self._shape = rows.shape[:2]
        self._matrix, self._offset = rows.reshape(offset.size, known), offset.ravel()
        diagonal = np.diagonal(factors[:, :known, :known], axis1=1, axis2=2)
        # The log of the factor before that exponential, up to a common constant.
        self._log_constant = np.log(mixture.weights / mixture.masses)
        self._log_constant -= np.log(diagonal).sum(axis=1)
        # Given y: covariances of target and rest. Given the target too: those of the rest.
        tail, last = factors[:, known:, known:], factors[:, known + 1 :, known + 1 :]
        self._covariances: FloatArray = tail @ np.swapaxes(tail, 1, 2)
        self._rest_covariances: FloatArray = last @ np.swapaxes(last, 1, 2)
        spread = np.ascontiguousarray(tail[:, 0, 0])
        self._spread, self._rest_slopes = spread, tail[:, 1:, 0] / spread[:, None]
        # The narrowest part of the density is a component given all other variables.
        precisions = np.linalg.inv(mixture.scale_matrices)[:, target, target]
        self._narrowest = float(precisions.max() ** -0.5)
        heights = self._log_constant - np.log(spread)
        self._heights = np.stack((heights, spread**-2.0, spread), axis=1).tolist()
        self._tables: dict[tuple[float, ...], TabulatedDensity] = {}

    def logpdf(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Log density at x (n,) given y (n, g), (n,); −inf outside the bounds."""
        values, points = self._aligned(x, y)
        inside = (values >= self.lower) & (values <= self.upper)
        log_weights, means = self._at(points)
        logs = self._log_unnormalised(values, log_weights, means)
        total = np.zeros(values.size)
        if self.given:  # otherwise one table serves all points
            centre = np.moveaxis(means, 2, 1)
            lower = np.append(self.lower, self._rest_lower) - centre
            upper = np.append(self.upper, self._rest_upper) - centre
            boxes = _boxes(self._covariances, lower, upper)
            total = (np.exp(log_weights) * boxes).sum(axis=0)
        log_total = np.log(np.maximum(total, _LOWEST))
        for i in np.flatnonzero(~(total > _SMALLEST_TOTAL)):
            log_total[i] = self._table(points[i]).log_total
        return np.where(inside, logs - log_total, -np.inf)

    def pdf(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Density at x (n,) given y (n, g), (n,), ≥ 0; 0 outside the bounds."""
        return np.asarray(np.exp(self.logpdf(x, y)))

    def cdf(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Distribution function at x (n,) given y (n, g), (n,) in [0, 1]."""
        pairs = zip(*self._aligned(x, y), strict=True)
        return np.array([self._table(point).cdf(float(value)) for value, point in pairs])

    def ppf(self, u: ArrayLike, y: ArrayLike) -> FloatArray:
        """Inverse of ``cdf``: x (n,) inside the bounds with cdf(x, y) = u to 1e-9.

        u = 0 and u = 1 give the bounds themselves.

        Raises:
            InputError: u is outside [0, 1] or NaN.
        """
        values, points = self._aligned(u, y)
        for wrong in values[~((values >= 0.0) & (values <= 1.0))]:
            raise InputError("ppf", f"probability {wrong}", "0 to 1")
        pairs = zip(values.tolist(), points, strict=True)
        return np.array([self.ppf_at(value, point) for value, point in pairs])

    def ppf_at(self, u: float, y: FloatArray) -> float:
        """``ppf`` of one u in [0, 1] given one y (g,) of finite numbers."""
        if u in (0.0, 1.0):
            return self.upper if u else self.lower
        return self._table(y).ppf(u)

    def mode(self, y: ArrayLike) -> FloatArray:
        """Position (n,) of the highest density given y (n, g); it may lie on a bound."""
        return np.array([self.mode_at(point) for point in _finite(y)])

    def mode_at(self, y: FloatArray) -> float:
        """``mode`` given one y (g,) of finite numbers."""
        if not self._rest_lower.size:
            return _highest_point(self._normals(y), self.lower, self.upper)
        given = self._at(y[None])
        x = self._table(y).highest
        for reach in _NARROWING * self._narrowest:
            grid = np.clip(x + reach * _LOOKS, self.lower, self.upper)
            x = float(grid[self._log_unnormalised(grid, *given).argmax()])
        return x

    def _normals(self, y: FloatArray) -> list[Normal]:
        """The components given y, as normal densities of the target."""
        numbers = (self._matrix @ y + self._offset).tolist()
        step, known = self._shape[1], len(self.given)
        return [
            (height - sum([z * z for z in numbers[at : at + known]]), numbers[at + known], *width)
            for at, (height, *width) in zip(
                range(0, len(numbers), step), self._heights, strict=True
            )
        ]

    def _table(self, y: FloatArray) -> TabulatedDensity:
        """The tabulated density given one y (g,)."""
        key = tuple(y.tolist())
        if key not in self._tables:
            if len(self._tables) >= _KEPT:
                self._tables.clear()
            given = self._at(y[None])
            self._tables[key] = TabulatedDensity(
                lambda x: self._log_unnormalised(x, *given), self.lower, self.upper, self._narrowest
            )
        return self._tables[key]

    def _at(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The untruncated components given y (n, g).

        Returns:
            Log of π_k N_k(y)/α_k less the largest, (K, n); means of target and rest, (K, 1 + r, n).
        """
        # The last bits of a matrix product may depend on the number of threads; einsum's do not.
        rows = np.einsum("rg,ng->rn", self._matrix, y) + self._offset[:, None]
        parts = rows.reshape(*self._shape, -1)
        known = len(self.given)
        log_weights = self._log_constant[:, None] - (parts[:, :known] ** 2).sum(axis=1)
        return log_weights - log_weights.max(axis=0), parts[:, known:]

    def _log_unnormalised(
        self, x: FloatArray, log_weights: FloatArray, means: FloatArray
    ) -> FloatArray:
        """Log density up to a constant at x (n,), for n given points or for one."""
        away = x - means[:, 0]
        spread = self._spread[:, None]
        z = away / spread
        logs = log_weights - np.log(spread * np.sqrt(2.0 * np.pi)) - 0.5 * z * z
        if self._rest_lower.size:
            centre = np.moveaxis(means[:, 1:] + self._rest_slopes[:, :, None] * away[:, None], 2, 1)
            logs += self._log_inside(self._rest_lower - centre, self._rest_upper - centre)
        return log_sum(logs)

    def _log_inside(self, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """Log probability (K, n) that the other variables are in bounds (K, n, r) about them."""
        if lower.shape[2] > 1:
            log_inside: FloatArray = np.log(
                np.maximum(_boxes(self._rest_covariances, lower, upper), _LOWEST)
            )
            return log_inside
        # log(Φ(b) − Φ(a)), finite even if the interval is far from 0.
        spread = np.sqrt(self._rest_covariances[:, :, 0])
        a, b = lower[:, :, 0] / spread, upper[:, :, 0] / spread
        flip = a > -b
        outer: FloatArray = log_ndtr(np.where(flip, -a, b))
        inner: FloatArray = log_ndtr(np.where(flip, -b, a))
        return outer + np.log(-np.expm1(inner - outer))

    def _aligned(self, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """x (n,) and y (n, g); a single row or value is repeated to fit the other."""
        values, points = np.atleast_1d(np.asarray(x, dtype=np.float64)), _finite(y)
        size = max(values.size, len(points)) if values.size and len(points) else 0
        return np.broadcast_to(values, size), np.broadcast_to(points, (size, points.shape[1]))


def _finite(y: ArrayLike) -> FloatArray:
    points = np.asarray(y, dtype=np.float64)
    if not np.isfinite(points).all():
        raise InputError("conditional", "y has values that are not finite", "finite numbers")
    return points


def _boxes(covariances: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Probabilities (K, n) of boxes (K, n, d) under centred normals of (K, d, d)."""
    shape = lower.shape
    every = np.repeat(covariances, shape[1], axis=0)
    flat = (-1, shape[2])
    return box_probability(every, lower.reshape(flat), upper.reshape(flat)).reshape(shape[:2])


def _highest_point(normals: Sequence[Normal], lower: float, upper: float) -> float:
    """Position of the global maximum on [lower, upper] of a sum of normals.

    An ascent starts from every mean, clipped to the interval, because in one dimension these
    ascents reach all peaks of a mixture of normals (Carreira-Perpiñán 2000).  The numbers are
    Python's floats, because with a few components arrays would mostly add overhead.
    """
    starts = [min(max(mean, lower), upper) for _, mean, _, _ in normals]
    peaks = [
        log_height - 0.5 * precision * (x - mean) ** 2
        for (log_height, mean, precision, _), x in zip(normals, starts, strict=True)
    ]
    highest = max(peaks)
    some = [
        (log_height - highest, *normal)
        for (log_height, *normal), peak in zip(normals, peaks, strict=True)
        if peak > highest - _NO_PART
    ]
    ends = [
        _climbed(some, x, normal[3], lower, upper)
        for normal, x, peak in zip(normals, starts, peaks, strict=True)
        if peak > highest - _LOW
    ]
    return max(ends)[1]


def _climbed(
    normals: Sequence[tuple[float, ...]], x: float, reach: float, lower: float, upper: float
) -> tuple[float, float]:
    """Height and position of the next peak; a step that would lower the height is quartered."""
    best, onward = _newton(normals, x, reach)
    step = min(max(x + onward, lower), upper) - x
    for _ in range(_MOST_STEPS):
        if abs(step) <= _LAST_STEP * reach:
            break
        value, onward = _newton(normals, x + step, reach)
        if value >= best:
            x, best = x + step, value
            step = min(max(x + onward, lower), upper) - x
        else:
            step *= 0.25
    return best, x + step


def _newton(normals: Sequence[tuple[float, ...]], x: float, reach: float) -> tuple[float, float]:
    """The density at x, and Newton's step for its log: uphill and at most ``reach`` long."""
    value, first, second = _LOWEST, 0.0, 0.0
    for log_height, mean, precision, _ in normals:
        away = mean - x
        slope = precision * away
        term = exp(log_height - 0.5 * slope * away)
        value += term
        first += term * slope
        second += term * (slope * slope - precision)
    slope = first / value
    # If the log density is not concave, the step has the maximum length.
    bend = max(slope * slope - second / value, abs(slope) / reach + _LOWEST)
    return value, slope / bend
