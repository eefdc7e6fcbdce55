"""One variable of a truncated mixture, given some of the others."""

from collections.abc import Callable, Iterator, Sequence
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.errors import InputError
from harness.mixture.boxes import box_probability
from harness.mixture.closed_form import Direct, OneIntegrated
from harness.mixture.drawing import draw
from harness.mixture.regression import Regression, State, component_sum
from harness.mixture.search import (
    Forms,
    highest_point,
    highest_point_one,
    inverse,
    inverse_one,
)
from harness.mixture.tabulated import TabulatedDensity

if TYPE_CHECKING:
    from harness.mixture.distribution import TruncatedGaussianMixture

Array = NDArray[np.float64]

# Points handled at once; small enough for the temporary arrays to stay in the cache.
_CHUNK = 512
_MODES = 128
_DRAWS = 1024
# An infinite bound is replaced by one this many spreads beyond every component.
_BEYOND = 12.0
# Where the highest density found is below this, everything has underflowed.
_UNDERFLOWED = 1e-280
# First panels of a table end at each component's mean and this many spreads from it.
_MARKS = np.array([-8.0, -4.0, -2.0, 0.0, 2.0, 4.0, 8.0])


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
        self.target, self.given = target, tuple(given)
        self.lower, self.upper = float(mixture.lower[target]), float(mixture.upper[target])
        self._lower, self._upper = np.array([self.lower]), np.array([self.upper])
        self._bounded = bool(np.isfinite(self._lower + self._upper)[0])
        self._regression = Regression(
            mixture.weights,
            mixture.masses,
            mixture.locations,
            mixture.scale_matrices,
            target,
            given,
            rest,
        )
        spread = np.sqrt(mixture.scale_matrices[:, rest, rest])
        reach = 1e3 * spread.max(axis=0, initial=0.0)
        low = mixture.locations[:, rest].min(axis=0) - reach
        high = mixture.locations[:, rest].max(axis=0) + reach
        self._rest_lower = np.where(np.isinf(mixture.lower[rest]), low, mixture.lower[rest])
        self._rest_upper = np.where(np.isinf(mixture.upper[rest]), high, mixture.upper[rest])
        self._forms = self._closed_forms()
        self._table: TabulatedDensity | None = None

    def _closed_forms(self) -> Forms | None:
        if self._rest_lower.size == 0:
            bounds = self.lower, self.upper
            return Forms(*(Direct(self._regression, *bounds, flat=flat) for flat in (False, True)))
        if self._rest_lower.size == 1:
            edges = float(self._rest_lower[0]), float(self._rest_upper[0])
            return Forms(*(OneIntegrated(self._regression, edges, flat) for flat in (False, True)))
        return None

    def logpdf(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Log density at x (n,) given y (n, g), (n,); −inf outside the bounds."""
        values, points = self._aligned(x, y)
        return self._chunked(self._logpdf, values, points)

    def pdf(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Density at x (n,) given y (n, g), (n,), ≥ 0; 0 outside the bounds."""
        density: Array = np.exp(self.logpdf(x, y))
        return density

    def cdf(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Distribution function at x (n,) given y (n, g), (n,) in [0, 1]."""
        values, points = self._aligned(x, y)
        return self._chunked(self._cdf, values, points)

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
        if values.size == 1 and self._forms is not None:
            return self._ppf_one(self._forms, values, points)
        return self._chunked(self._ppf, values, points)

    def mode(self, y: ArrayLike) -> Array:
        """Position (n,) of the highest density given y (n, g); it may lie on a bound."""
        points = self._points(y)
        if points.shape[0] == 1 and self._forms is not None:
            return self._mode_one(self._forms, points)
        return self._chunked(self._mode, np.zeros(points.shape[0]), points, _MODES)

    def sample(self, y: ArrayLike, rng: np.random.Generator) -> Array:
        """One draw (n,) per row of y (n, g); the generator moves on by 4 n uniforms at most."""
        points = self._points(y)
        if self._rest_lower.size:
            return self._chunked(self._ppf, rng.random((points.shape[0],)), points)
        result = np.empty(points.shape[0])
        for at in range(0, result.size, _DRAWS):
            part = points[at : at + _DRAWS]
            result[at : at + _DRAWS] = self._drawn(part, rng.random((part.shape[0], 4)).T)
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
        self,
        function: Callable[[Array, Array], Array],
        values: Array,
        points: Array,
        size: int = _CHUNK,
    ) -> Array:
        if values.size <= size:
            return function(values, points)
        parts = [
            function(values[at : at + size], points[at : at + size])
            for at in range(0, values.size, size)
        ]
        return np.concatenate(parts)

    def _bounds(self, state: State, count: int) -> tuple[Array, Array]:
        """Finite bounds (n,): an infinite one is put where no component has any density."""
        lower, upper = self._lower.repeat(count), self._upper.repeat(count)
        if not self._bounded:
            means = state.means.reshape(-1, count)
            reach = _BEYOND * self._regression.spread[:, None]
            if np.isinf(self.lower):
                lower = np.minimum.reduce(means - reach, axis=0)
            if np.isinf(self.upper):
                upper = np.maximum.reduce(means + reach, axis=0)
        return lower, upper

    def _logpdf(self, x: Array, y: Array) -> Array:
        inside = (x >= self.lower) & (x <= self.upper)
        if self._forms is None:
            logs = np.full(x.size, -np.inf)
            for rows, table in self._tables(y):
                chosen = rows[inside[rows]]
                logs[chosen] = self._log_unnormalised(x[chosen], y[rows[:1]]) - table.log_total
            return logs
        state = self._regression.at(y)
        lower, upper = self._bounds(state, x.size)
        cumulative = self._forms.many.cumulative(state)
        sums = self._forms.many.running(cumulative, np.stack((lower, upper)))
        total = sums[1] - sums[0]
        weak = self._weak(total)
        log_total = np.log(np.where(total > 0.0, total, 1.0))
        for i in weak:
            log_total[i] = self._tabulate(y[i : i + 1]).log_total
        at = np.where(inside, x, lower)
        return np.where(
            inside, self._forms.many.log_density(state, at[None])[0] - log_total, -np.inf
        )

    def _cdf(self, x: Array, y: Array) -> Array:
        if self._forms is None:
            result = np.empty(x.size)
            for rows, table in self._tables(y):
                result[rows] = table.cdf(np.clip(x[rows], table.edges[0], table.edges[-1]))
        else:
            state = self._regression.at(y)
            lower, upper = self._bounds(state, x.size)
            clipped = np.minimum(np.maximum(x, lower), upper)
            cumulative = self._forms.many.cumulative(state)
            sums = self._forms.many.running(cumulative, np.stack((lower, clipped, upper)))
            total = sums[2] - sums[0]
            result = np.clip((sums[1] - sums[0]) / np.where(total > 0.0, total, 1.0), 0.0, 1.0)
            for i in self._weak(total):
                table = self._tabulate(y[i : i + 1])
                result[i] = table.cdf(np.clip(x[i : i + 1], table.edges[0], table.edges[-1]))[0]
        return np.where(x <= self.lower, 0.0, np.where(x >= self.upper, 1.0, result))

    def _ppf(self, u: Array, y: Array) -> Array:
        if self._forms is None:
            result = np.empty(u.size)
            for rows, table in self._tables(y):
                result[rows] = table.ppf(u[rows])
        else:
            form, state = self._forms.many, self._regression.at(y)
            bounds = self._bounds(state, u.size)
            result, total = inverse(form, state, form.cumulative(state), u, *bounds)
            for i in self._weak(total):
                result[i] = self._tabulate(y[i : i + 1]).ppf(u[i : i + 1])[0]
        return np.where(u == 0.0, self.lower, np.where(u == 1.0, self.upper, result))

    def _ppf_one(self, forms: Forms, u: Array, y: Array) -> Array:
        probability = float(u[0])
        if probability in (0.0, 1.0):
            return self._upper.copy() if probability else self._lower.copy()
        state = self._regression.at_one(y[0].tolist())
        x, total = inverse_one(forms, state, probability, *self._bounds(state, 1))
        if not total > forms.one.smallest_total:
            return self._tabulate(y).ppf(u)
        return np.array([x])

    def _mode(self, _: Array, y: Array) -> Array:
        result = np.empty(y.shape[0])
        if self._forms is None:
            for rows, table in self._tables(y):
                result[rows] = table.mode
            return result
        state = self._regression.at(y)
        bounds = self._bounds(state, y.shape[0])
        result, height = highest_point(self._forms.many, state, *bounds)
        for i in np.flatnonzero(height <= _UNDERFLOWED):
            result[i] = self._tabulate(y[i : i + 1]).mode
        return result

    def _mode_one(self, forms: Forms, y: Array) -> Array:
        state = self._regression.at_one(y[0].tolist())
        x, height = highest_point_one(forms, state, *self._bounds(state, 1))
        if height <= _UNDERFLOWED:
            x = self._tabulate(y).mode
        return np.array([x])

    def _weak(self, total: Array) -> NDArray[np.intp]:
        """Points whose closed form has lost its digits, for the table to take over."""
        smallest = self._forms.many.smallest_total if self._forms else 0.0
        return np.flatnonzero(~(total > smallest))

    def _drawn(self, y: Array, u: Array) -> Array:
        """Draws (n,) with nothing integrated out, from uniforms (4, n)."""
        x = draw(self._regression.at(y), self._regression.spread, self.lower, self.upper, u)
        lost = np.flatnonzero(np.isnan(x))
        if lost.size:
            x[lost] = self._ppf(u[3, lost], y[lost])
        return x

    def _log_unnormalised(self, x: Array, y: Array) -> Array:
        """Log density at x (m,) given the one row y (1, g), up to a constant of that row."""
        state = self._regression.at(y)
        if self._forms is not None:
            return self._forms.many.log_density(state, x[:, None])[:, 0]
        regression = self._regression
        away = x - state.means[:, 0]
        centre = np.stack(state.rest_means, axis=-1)[:, 0] + (
            away[:, :, None] * regression.rest_slopes[:, None]
        )
        lower, upper = self._rest_lower - centre, self._rest_upper - centre
        shape = (-1, self._rest_lower.size)
        covariances = np.repeat(regression.rest_covariances, x.size, axis=0)
        inside = box_probability(covariances, lower.reshape(shape), upper.reshape(shape))
        z = away / regression.spread[:, None]
        logs = state.log_weights[:, 0] - np.log(regression.spread)[:, None] - 0.5 * z * z
        terms = logs + np.log(np.maximum(inside.reshape(away.shape), 1e-300))
        largest = np.maximum.reduce(terms, axis=0)
        result: Array = largest + np.log(component_sum(np.exp(terms - largest)))
        return result

    def _tabulate(self, y: Array) -> TabulatedDensity:
        """The density given the one row y (1, g)."""
        state = self._regression.at(y)
        (lower,), (upper,) = self._bounds(state, 1)
        marks = state.means[:, 0] + self._regression.spread[:, None] * _MARKS
        marks = np.sort(np.concatenate((marks.ravel(), np.linspace(lower, upper, 9)[1:-1])))
        apart = 1e-3 * (upper - lower) / marks.size
        breaks = [lower]
        for mark in marks:
            if mark - breaks[-1] > apart and upper - mark > apart:
                breaks.append(mark)
        breaks.append(upper)
        return TabulatedDensity(lambda x: self._log_unnormalised(x, y), np.array(breaks))

    def _tables(self, y: Array) -> Iterator[tuple[NDArray[np.intp], TabulatedDensity]]:
        """For each distinct row of y (n, g): which rows equal it, and its table."""
        if not self.given:
            yield np.arange(y.shape[0]), self._marginal()
            return
        distinct, which = np.unique(y, axis=0, return_inverse=True)
        for i, row in enumerate(distinct):
            yield np.flatnonzero(which == i), self._tabulate(row[None])

    def _marginal(self) -> TabulatedDensity:
        """The table for nothing given, made on first use."""
        if self._table is None:
            self._table = self._tabulate(np.empty((1, 0)))
        return self._table
