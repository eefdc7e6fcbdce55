"""Density, derivatives and distribution function of the target, component by component.

Two cases have closed forms: nothing integrated out (`Direct`), and one variable integrated out
over its bounds (`OneIntegrated`, with normal rectangles by Owen's T). Both take the state of the
components at n given points and evaluate at positions x of shape (c, n).
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, owens_t

from harness.mixture.regression import Regression, State, component_sum

Array = NDArray[np.float64]

_ROOT_TWO_PI = float(np.sqrt(2.0 * np.pi))
_TINY = 1e-30


class Cumulative(NamedTuple):
    """What a distribution function needs at n given points, before any x is known.

    Attributes:
        parts: arrays (K or more, n) that only the form that made them reads.
        start, total: (n,), the running sum at the lower bound and from there to the upper one.
    """

    parts: tuple[Array, ...]
    start: Array
    total: Array


class Form(Protocol):
    """The arithmetic of one case; all arrays (c, n) unless said otherwise."""

    # A total below this, relative to the heaviest component, has lost its digits.
    smallest_total: float

    def curve(self, state: State, x: Array) -> tuple[Array, Array, Array]:
        """Density at x up to a factor common to each point, and its first two derivatives."""
        ...

    def log_density(self, state: State, x: Array) -> Array:
        """Log of the density at x (n,) up to `shift`, safe far in the tails, (n,)."""
        ...

    def cumulative(self, state: State) -> Cumulative:
        """The parts of the distribution function at the given points."""
        ...

    def running(self, parts: tuple[Array, ...], x: Array) -> Array:
        """Running sum of the mass up to x, counted from an arbitrary start."""
        ...

    def density(self, state: State, x: Array) -> Array:
        """The derivative of `running` in x."""
        ...


class Direct:
    """Nothing integrated out: a truncated univariate mixture."""

    smallest_total = 1e-200

    def __init__(self, regression: Regression, lower: float, upper: float) -> None:
        self._lower, self._upper = lower, upper
        self._inverse = (1.0 / regression.spread)[:, None]
        self._curvature = (-(regression.spread**-2.0))[:, None, None]
        self._height = (1.0 / (_ROOT_TWO_PI * regression.spread))[:, None, None]
        self._log_height = np.log(self._height[:, :, 0])

    def curve(self, state: State, x: Array) -> tuple[Array, Array, Array]:
        away = x - state.means[:, None]
        slope = away * self._curvature
        terms = self._height * np.exp(state.log_weights[:, None] + 0.5 * away * slope)
        return (
            component_sum(terms),
            component_sum(terms * slope),
            component_sum(terms * (slope * slope + self._curvature)),
        )

    def log_density(self, state: State, x: Array) -> Array:
        z = (x - state.means) * self._inverse
        terms = state.log_weights + self._log_height - 0.5 * z * z
        largest = np.maximum.reduce(terms, axis=0)
        result: Array = largest + np.log(component_sum(np.exp(terms - largest)))
        return result

    def density(self, state: State, x: Array) -> Array:
        away = x - state.means[:, None]
        terms = np.exp(state.log_weights[:, None] + 0.5 * away * away * self._curvature)
        return component_sum(terms * self._height)

    def cumulative(self, state: State) -> Cumulative:
        a = (self._lower - state.means) * self._inverse
        b = (self._upper - state.means) * self._inverse
        # In the upper tail Φ(b) − Φ(a) loses its digits and Φ(−a) − Φ(−b) does not.
        sign = np.where(a + b > 0.0, -1.0, 1.0)
        weights = np.exp(state.log_weights) * sign
        start = component_sum(weights * ndtr(a * sign))
        end = component_sum(weights * ndtr(b * sign))
        parts = (weights[:, None], (self._inverse * sign)[:, None], state.means[:, None])
        return Cumulative(parts, start, end - start)

    def running(self, parts: tuple[Array, ...], x: Array) -> Array:
        weights, scale, means = parts
        return component_sum(weights * ndtr((x - means) * scale))


class OneIntegrated:
    """One variable integrated out over [rest_lower, rest_upper]: normal rectangles."""

    smallest_total = 1e-7

    def __init__(
        self,
        regression: Regression,
        lower: float,
        upper: float,
        rest_lower: float,
        rest_upper: float,
    ) -> None:
        self._lower, self._upper = lower, upper
        spread, slope = regression.spread, regression.rest_slopes[:, 0]
        rest_spread = np.sqrt(regression.rest_covariances[:, 0, 0])
        self._inverse = (1.0 / spread)[:, None, None]
        self._curvature = (-(spread**-2.0))[:, None, None]
        self._height = (1.0 / (_ROOT_TWO_PI * spread))[:, None, None]
        self._edges = (rest_lower, rest_upper)
        self._rest_inverse = (1.0 / rest_spread)[:, None]
        self._turn = (slope / rest_spread)[:, None, None]
        # Spread and correlation of the integrated variable with the target not yet known.
        loose = np.sqrt(rest_spread**2 + (slope * spread) ** 2)
        self._loose_inverse = (1.0 / loose)[:, None]
        self._rho = np.tile(slope * spread / loose, 2)[:, None, None]
        self._root = np.tile(rest_spread / loose, 2)[:, None, None]

    def _bounds(self, state: State, away: Array) -> tuple[Array, Array]:
        """Standardised bounds (K, c, n) of the integrated variable with the target at x."""
        centre = state.rest_means[0]
        turned = away * self._turn
        lo = ((self._edges[0] - centre) * self._rest_inverse)[:, None] - turned
        hi = ((self._edges[1] - centre) * self._rest_inverse)[:, None] - turned
        return lo, hi

    def curve(self, state: State, x: Array) -> tuple[Array, Array, Array]:
        away = x - state.means[:, None]
        slope = away * self._curvature
        terms = self._height * np.exp(state.log_weights[:, None] + 0.5 * away * slope)
        lo, hi = self._bounds(state, away)
        inside = _interval(lo, hi)
        at_lo = np.exp(-0.5 * lo * lo) / _ROOT_TWO_PI
        at_hi = np.exp(-0.5 * hi * hi) / _ROOT_TWO_PI
        first = self._turn * (at_lo - at_hi)
        second = self._turn * self._turn * (lo * at_lo - hi * at_hi)
        return (
            component_sum(terms * inside),
            component_sum(terms * (slope * inside + first)),
            component_sum(
                terms * ((slope * slope + self._curvature) * inside + 2.0 * slope * first + second)
            ),
        )

    def log_density(self, state: State, x: Array) -> Array:
        away = (x - state.means)[:, None]
        lo, hi = self._bounds(state, away)
        terms = state.log_weights[:, None] + 0.5 * away * away * self._curvature
        terms = (terms + np.log(self._height) + _log_interval(lo, hi))[:, 0]
        largest = np.maximum.reduce(terms, axis=0)
        result: Array = largest + np.log(component_sum(np.exp(terms - largest)))
        return result

    def density(self, state: State, x: Array) -> Array:
        away = x - state.means[:, None]
        terms = np.exp(state.log_weights[:, None] + 0.5 * away * away * self._curvature)
        return component_sum(terms * self._height * _interval(*self._bounds(state, away)))

    def cumulative(self, state: State) -> Cumulative:
        weights = np.exp(state.log_weights)
        centre = state.rest_means[0]
        lo = (self._edges[0] - centre) * self._loose_inverse
        hi = (self._edges[1] - centre) * self._loose_inverse
        k = np.concatenate((hi, lo))[:, None]
        k = np.where(k == 0.0, _TINY, k)
        signed = np.concatenate((weights, -weights))[:, None]
        parts = (signed, state.means[:, None], k, 1.0 / k)
        ends = np.empty((2, weights.shape[1]))
        ends[0], ends[1] = self._lower, self._upper
        sums = self.running(parts, ends)
        return Cumulative(parts, sums[0], sums[1] - sums[0])

    def running(self, parts: tuple[Array, ...], x: Array) -> Array:
        signed, means, k, inverse_k = parts
        single = (x - means) * self._inverse
        single = np.where(single == 0.0, _TINY, single)
        h = np.concatenate((single, single))
        ratio = k / h
        # Φ2(h, k) less the halves of Φ(h) and Φ(k), which cancel in differences (Owen 1956).
        corner = owens_t(h, (ratio - self._rho) / self._root)
        corner += owens_t(k, (h * inverse_k - self._rho) / self._root)
        corner += 0.5 * (ratio < 0.0)
        return component_sum(signed * -corner)


def _interval(a: Array, b: Array) -> Array:
    """Φ(b) − Φ(a), a ≤ b, accurate in both tails."""
    sign = np.where(a + b > 0.0, -1.0, 1.0)
    probability: Array = (ndtr(b * sign) - ndtr(a * sign)) * sign
    return probability


def _log_interval(a: Array, b: Array) -> Array:
    """log(Φ(b) − Φ(a)), a < b, finite however far out the interval lies."""
    flip = a + b > 0.0
    a, b = np.where(flip, -b, a), np.where(flip, -a, b)
    outer: Array = log_ndtr(b)
    return outer + np.log(-np.expm1(log_ndtr(a) - outer))
