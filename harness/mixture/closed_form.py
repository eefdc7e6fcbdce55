"""Density, derivatives and distribution function of the target, summed over the components.

Two cases have closed forms: nothing integrated out (`Direct`), and one variable integrated out
over its bounds (`OneIntegrated`, with normal rectangles by Owen's T).

The same arithmetic serves many points and one. For many, the arrays of the components are
(K, 1, n) and positions x are (c, n); for one, made `flat`, they are (K,) and x is a number, which
spares most of numpy's overhead. Each result is the same to the last bit either way.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, owens_t

from harness.mixture.regression import Regression, State
from harness.mixture.sums import ordered_sum

Array = NDArray[np.float64]

_ROOT_TWO_PI = float(np.sqrt(2.0 * np.pi))
_TINY = 1e-30


class Cumulative(NamedTuple):
    """What the running mass needs at the given points, before any x is known.

    Attributes:
        parts: arrays that only the form that made them reads, components first, points last.
    """

    parts: tuple[Array, ...]


class Form(Protocol):
    """The arithmetic of one case, up to a factor exp(shift) common to each point."""

    # A total below this, relative to the heaviest component, has lost its digits.
    smallest_total: float

    def density(self, state: State, x: Array | float) -> Array:
        """Density at x."""
        ...

    def curve(self, state: State, x: Array | float) -> tuple[Array, Array, Array]:
        """Density at x and its first two derivatives."""
        ...

    def log_density(self, state: State, x: Array | float) -> Array:
        """Log of the density at x, safe far in the tails."""
        ...

    def cumulative(self, state: State) -> Cumulative:
        """The parts of the running mass."""
        ...

    def running(self, cumulative: Cumulative, x: Array | float) -> Array:
        """Mass up to x, counted from an arbitrary start; its derivative is `density`."""
        ...


class Direct:
    """Nothing integrated out: a truncated univariate mixture."""

    smallest_total = 1e-200

    def __init__(self, regression: Regression, lower: float, upper: float, flat: bool) -> None:
        shape = (-1,) if flat else (-1, 1, 1)
        spread = regression.spread.reshape(shape)
        # Between infinite bounds either tail will do.
        self._middle = 0.0 if np.isinf(lower) and np.isinf(upper) else 0.5 * (lower + upper)
        self._inverse = 1.0 / spread
        self._curvature = -(spread**-2.0)
        self._log_height = -np.log(_ROOT_TWO_PI * spread)

    def _logs(self, state: State, x: Array | float) -> tuple[Array, Array]:
        """Log density of each component and its slope."""
        away = x - state.means
        slope = away * self._curvature
        away *= slope
        away *= 0.5
        away += state.log_weights + self._log_height
        return away, slope

    def density(self, state: State, x: Array | float) -> Array:
        logs, _ = self._logs(state, x)
        return ordered_sum(np.exp(logs, out=logs))

    def curve(self, state: State, x: Array | float) -> tuple[Array, Array, Array]:
        logs, slope = self._logs(state, x)
        terms = np.exp(logs, out=logs)
        bend = slope * slope
        bend += self._curvature
        bend *= terms
        slope *= terms
        return ordered_sum(terms), ordered_sum(slope), ordered_sum(bend)

    def log_density(self, state: State, x: Array | float) -> Array:
        return log_sum(self._logs(state, x)[0])

    def cumulative(self, state: State) -> Cumulative:
        # In the upper tail Φ(b) − Φ(a) loses its digits and Φ(−a) − Φ(−b) does not.
        sign = np.copysign(1.0, state.means - self._middle)
        weights = np.exp(state.log_weights)
        return Cumulative((weights * sign, self._inverse * sign, state.means))

    def running(self, cumulative: Cumulative, x: Array | float) -> Array:
        weights, scale, means = cumulative.parts
        z = x - means
        z *= scale
        below = ndtr(z, out=z)
        below *= weights
        return ordered_sum(below)


class OneIntegrated:
    """One variable integrated out over its bounds (`edges`, finite): normal rectangles."""

    smallest_total = 1e-7

    def __init__(self, regression: Regression, edges: tuple[float, float], flat: bool) -> None:
        shape = (-1,) if flat else (-1, 1, 1)
        spread, slope = regression.spread, regression.rest_slopes[:, 0]
        rest_spread = np.sqrt(regression.rest_covariances[:, 0, 0])
        self._edges = edges
        self._inverse = (1.0 / spread).reshape(shape)
        self._curvature = (-(spread**-2.0)).reshape(shape)
        self._log_height = (-np.log(_ROOT_TWO_PI * spread)).reshape(shape)
        self._rest_inverse = (1.0 / rest_spread).reshape(shape)
        self._turn = (slope / rest_spread).reshape(shape)
        # Spread and correlation of the integrated variable with the target not yet known.
        loose = np.sqrt(rest_spread**2 + (slope * spread) ** 2)
        self._loose_inverse = (1.0 / loose).reshape(shape)
        root = np.tile(rest_spread / loose, 2).reshape(shape)
        self._rho = np.tile(slope * spread / loose, 2).reshape(shape)
        self._rho_over_root, self._inverse_root = self._rho / root, 1.0 / root

    def _logs(self, state: State, x: Array | float) -> tuple[Array, Array, Array, Array]:
        """Log density and slope of each component, and the integrated variable's bounds there."""
        away = x - state.means
        slope = away * self._curvature
        centre = state.rest_means[0]
        turned = away * self._turn
        lo = (self._edges[0] - centre) * self._rest_inverse - turned
        hi = (self._edges[1] - centre) * self._rest_inverse - turned
        away *= slope
        away *= 0.5
        away += state.log_weights + self._log_height
        return away, slope, lo, hi

    def density(self, state: State, x: Array | float) -> Array:
        logs, _, lo, hi = self._logs(state, x)
        return ordered_sum(np.exp(logs) * _interval(lo, hi))

    def curve(self, state: State, x: Array | float) -> tuple[Array, Array, Array]:
        logs, slope, lo, hi = self._logs(state, x)
        terms = np.exp(logs)
        inside = _interval(lo, hi)
        at_lo = np.exp(-0.5 * lo * lo) * (self._turn / _ROOT_TWO_PI)
        at_hi = np.exp(-0.5 * hi * hi) * (self._turn / _ROOT_TWO_PI)
        first = at_lo - at_hi
        bend = (slope * slope + self._curvature) * inside + 2.0 * slope * first
        bend += self._turn * (lo * at_lo - hi * at_hi)
        return (
            ordered_sum(terms * inside),
            ordered_sum(terms * (slope * inside + first)),
            ordered_sum(terms * bend),
        )

    def log_density(self, state: State, x: Array | float) -> Array:
        logs, _, lo, hi = self._logs(state, x)
        return log_sum(logs + _log_interval(lo, hi))

    def cumulative(self, state: State) -> Cumulative:
        weights = np.exp(state.log_weights)
        centre = state.rest_means[0]
        lo = (self._edges[0] - centre) * self._loose_inverse
        hi = (self._edges[1] - centre) * self._loose_inverse
        k = np.concatenate((hi, lo))
        k = np.where(k == 0.0, _TINY, k)
        signed = np.concatenate((-weights, weights))
        return Cumulative((signed, state.means, k, self._inverse_root / k))

    def running(self, cumulative: Cumulative, x: Array | float) -> Array:
        signed, means, k, scaled_inverse = cumulative.parts
        z = (x - means) * self._inverse
        z = np.where(z == 0.0, _TINY, z)
        h = np.concatenate((z, z))
        ratio = k / h
        # Φ2(h, k) less the halves of Φ(h) and Φ(k), which cancel in differences (Owen 1956).
        corner = owens_t(h, ratio * self._inverse_root - self._rho_over_root)
        corner += owens_t(k, h * scaled_inverse - self._rho_over_root)
        corner += 0.5 * (ratio < 0.0)
        corner *= signed
        return ordered_sum(corner)


def log_sum(logs: Array) -> Array:
    """Log of the sum of exponentials over the components."""
    largest = np.maximum.reduce(logs, axis=0)
    result: Array = largest + np.log(ordered_sum(np.exp(logs - largest)))
    return result


def _interval(a: Array, b: Array) -> Array:
    """Φ(b) − Φ(a), a ≤ b, accurate in both tails."""
    sign = np.copysign(1.0, -a - b)
    probability: Array = (ndtr(b * sign) - ndtr(a * sign)) * sign
    return probability


def _log_interval(a: Array, b: Array) -> Array:
    """log(Φ(b) − Φ(a)), a < b, finite however far out the interval lies."""
    flip = a + b > 0.0
    a, b = np.where(flip, -b, a), np.where(flip, -a, b)
    outer: Array = log_ndtr(b)
    return outer + np.log(-np.expm1(log_ndtr(a) - outer))
