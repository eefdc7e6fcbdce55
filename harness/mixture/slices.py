"""The target's distribution at given points: closed forms, and tables where there are none."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from harness.mixture.boxes import box_probability
from harness.mixture.closed_form import Direct, OneIntegrated, log_sum
from harness.mixture.drawing import draw
from harness.mixture.regression import Regression, State
from harness.mixture.search import (
    Forms,
    highest_point,
    highest_point_one,
    inverse,
    inverse_one,
)
from harness.mixture.tabulated import TabulatedDensity

Array = NDArray[np.float64]

# An infinite bound of the target is replaced by one this many spreads beyond every component, one
# of an integrated variable by one so far out that nothing is lost.
_BEYOND = 12.0
_FAR_BEYOND = 1e6
# Where the highest density found is below this, everything has underflowed.
_UNDERFLOWED = 1e-280
# First panels of a table end at each component's mean and this many spreads from it.
_MARKS = np.array([-8.0, -4.0, -2.0, 0.0, 2.0, 4.0, 8.0])


class Slices:
    """Density, distribution function, inverse and mode for arrays of given points.

    Points whose closed form has lost its digits, and all points where there is none, are served
    from a table made for their y.

    Args:
        regression: of the components on the given variables.
        lower, upper: bounds of the target.
        rest_lower, rest_upper: (r,), of the integrated variables.
    """

    def __init__(
        self,
        regression: Regression,
        lower: float,
        upper: float,
        rest_lower: Array,
        rest_upper: Array,
    ) -> None:
        self._regression = regression
        self._lower, self._upper = np.array([lower]), np.array([upper])
        self._bounded = bool(np.isfinite(lower) and np.isfinite(upper))
        far = _FAR_BEYOND * regression.rest_reach
        self._rest_lower = np.where(np.isinf(rest_lower), -far, rest_lower)
        self._rest_upper = np.where(np.isinf(rest_upper), far, rest_upper)
        self._forms: Forms | None = None
        if rest_lower.size == 0:
            many, one = (Direct(regression, lower, upper, flat) for flat in (False, True))
            self._forms = Forms(many, one)
        elif rest_lower.size == 1:
            edges = float(self._rest_lower[0]), float(self._rest_upper[0])
            self._forms = Forms(*(OneIntegrated(regression, edges, flat) for flat in (False, True)))
        self._marginal: TabulatedDensity | None = None

    def logpdf(self, x: Array, y: Array) -> Array:
        """Log density at x (n,) given y (n, g), −inf outside the bounds."""
        inside = (x >= self._lower) & (x <= self._upper)
        result = np.full(x.size, -np.inf)
        weak = np.arange(x.size)
        if self._forms is not None:
            form, state = self._forms.many, self._regression.at(y)
            lower, upper = self._bounds(state, x.size)
            sums = form.running(form.cumulative(state), np.stack((lower, upper)))
            total = sums[1] - sums[0]
            weak = self._weak(total)
            logs = form.log_density(state, np.where(inside, x, lower)[None])[0]
            logs -= np.log(np.where(total > 0.0, total, 1.0))
            result = np.where(inside, logs, result)
        for rows, table in self._tables(y, weak):
            chosen = rows[inside[rows]]
            result[chosen] = self._log_unnormalised(x[chosen], y[rows[:1]]) - table.log_total
        return result

    def cdf(self, x: Array, y: Array) -> Array:
        """Distribution function at x (n,) given y (n, g)."""
        result = np.empty(x.size)
        weak = np.arange(x.size)
        if self._forms is not None:
            form, state = self._forms.many, self._regression.at(y)
            lower, upper = self._bounds(state, x.size)
            clipped = np.minimum(np.maximum(x, lower), upper)
            sums = form.running(form.cumulative(state), np.stack((lower, clipped, upper)))
            total = sums[2] - sums[0]
            weak = self._weak(total)
            share = (sums[1] - sums[0]) / np.where(total > 0.0, total, 1.0)
            result = np.minimum(np.maximum(share, 0.0), 1.0)
        for rows, table in self._tables(y, weak):
            result[rows] = table.cdf(np.clip(x[rows], table.edges[0], table.edges[-1]))
        return np.where(x <= self._lower, 0.0, np.where(x >= self._upper, 1.0, result))

    def ppf(self, u: Array, y: Array) -> Array:
        """Inverse of the distribution function at u (n,) in [0, 1] given y (n, g)."""
        result = np.empty(u.size)
        weak = np.arange(u.size)
        if self._forms is not None:
            form, state = self._forms.many, self._regression.at(y)
            bounds = self._bounds(state, u.size)
            result, total = inverse(form, state, form.cumulative(state), u, *bounds)
            weak = self._weak(total)
        for rows, table in self._tables(y, weak):
            result[rows] = table.ppf(u[rows])
        return np.where(u == 0.0, self._lower, np.where(u == 1.0, self._upper, result))

    def ppf_one(self, u: float, y: Array) -> float:
        """`ppf` for one point, y (1, g)."""
        if u in (0.0, 1.0):
            return float(self._upper[0] if u else self._lower[0])
        if self._forms is not None:
            state = self._regression.at_one(y[0].tolist())
            x, total = inverse_one(self._forms, state, u, *self._bounds(state, 1))
            if total > self._forms.one.smallest_total:
                return x
        return float(self._table(y).ppf(np.array([u]))[0])

    def mode(self, y: Array) -> Array:
        """Position of the highest density given y (n, g), (n,)."""
        result = np.empty(y.shape[0])
        weak = np.arange(y.shape[0])
        if self._forms is not None:
            state = self._regression.at(y)
            bounds = self._bounds(state, y.shape[0])
            result, height = highest_point(self._forms.many, state, *bounds)
            weak = np.flatnonzero(height <= _UNDERFLOWED)
        for rows, table in self._tables(y, weak):
            result[rows] = table.mode
        return result

    def mode_one(self, y: Array) -> float:
        """`mode` for one point, y (1, g)."""
        if self._forms is not None:
            state = self._regression.at_one(y[0].tolist())
            x, height = highest_point_one(self._forms, state, *self._bounds(state, 1))
            if height > _UNDERFLOWED:
                return x
        return self._table(y).mode

    def drawn(self, y: Array, u: Array) -> Array:
        """Draws (n,) where nothing is integrated out, from uniforms (UNIFORMS, n)."""
        bounds = float(self._lower[0]), float(self._upper[0])
        x = draw(self._regression.at(y), self._regression.spread, *bounds, u)
        lost = np.flatnonzero(np.isnan(x))
        if lost.size:
            x[lost] = self.ppf(u[-1, lost], y[lost])
        return x

    def _bounds(self, state: State, count: int) -> tuple[Array, Array]:
        """Finite bounds (n,): an infinite one is put where no component has any density."""
        lower, upper = self._lower.repeat(count), self._upper.repeat(count)
        if not self._bounded:
            means = state.means.reshape(-1, count)
            reach = _BEYOND * self._regression.spread[:, None]
            if np.isinf(self._lower[0]):
                lower = np.minimum.reduce(means - reach, axis=0)
            if np.isinf(self._upper[0]):
                upper = np.maximum.reduce(means + reach, axis=0)
        return lower, upper

    def _weak(self, total: Array) -> NDArray[np.intp]:
        smallest = self._forms.many.smallest_total if self._forms else np.inf
        return np.flatnonzero(~(total > smallest))

    def _tables(
        self, y: Array, rows: NDArray[np.intp]
    ) -> Iterator[tuple[NDArray[np.intp], TabulatedDensity]]:
        """For each distinct y among the chosen rows: which of them have it, and its table."""
        if not rows.size:
            return
        if not y.shape[1]:
            yield rows, self._table(y)
            return
        distinct, which = np.unique(y[rows], axis=0, return_inverse=True)
        for i, point in enumerate(distinct):
            yield rows[which == i], self._table(point[None])

    def _table(self, y: Array) -> TabulatedDensity:
        """The density given the one row y (1, g); kept where there is only one."""
        if y.shape[1]:
            return self._tabulated(y)
        if self._marginal is None:
            self._marginal = self._tabulated(y[:1])
        return self._marginal

    def _tabulated(self, y: Array) -> TabulatedDensity:
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

    def _log_unnormalised(self, x: Array, y: Array) -> Array:
        """Log density at x (m,) given the one row y (1, g), up to a constant of that row."""
        state = self._regression.at(y)
        if self._forms is not None:
            return self._forms.many.log_density(state, x[:, None])[:, 0]
        regression = self._regression
        away = x - state.means[:, 0]
        turned = away[:, :, None] * regression.rest_slopes[:, None]
        centre = np.stack(state.rest_means, axis=-1)[:, 0] + turned
        shape = (-1, self._rest_lower.size)
        lower = (self._rest_lower - centre).reshape(shape)
        upper = (self._rest_upper - centre).reshape(shape)
        covariances = np.repeat(regression.rest_covariances, x.size, axis=0)
        inside = box_probability(covariances, lower, upper).reshape(away.shape)
        z = away / regression.spread[:, None]
        logs = state.log_weights[:, 0] - np.log(regression.spread)[:, None] - 0.5 * z * z
        return log_sum(logs + np.log(np.maximum(inside, 1e-300)))
