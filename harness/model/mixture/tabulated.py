"""A log density on an interval in; its distribution function and quantiles out.

The density is interpolated by Chebyshev polynomials on panels (Trefethen, Approximation Theory and
Approximation Practice, 2013).
"""

from bisect import bisect_right
from collections.abc import Callable
from math import ceil, inf

import numpy as np
from numpy.polynomial import chebyshev

from harness.core.vocabulary import FloatArray

_DEGREE = 15
"""Degree of the polynomial on each panel."""
_SPREADS = 2.0
"""With panels of two spreads the interpolation error is 1e-11 of a normal density's peak."""
_MOST_PANELS = 1000
"""Number of panels before they are made finer."""
_FINER, _TOLERANCE = (1, 4, 16, 64), 1e-9
"""Many times more panels are needed where the density is steep, which the last coefficients show.
"""
_MOST_STEPS = 60
"""Newton's method ends after so many steps at the latest; bisection alone would need 45."""
_NODES = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
_DENSITY = np.linalg.inv(chebyshev.chebvander(_NODES, _DEGREE))
"""Matrices from values at the nodes to coefficients of the density and of its integral from −1."""
_INTEGRAL = chebyshev.chebint(_DENSITY, lbnd=-1.0)
_WHOLE, _LAST = _INTEGRAL.sum(axis=0), _DENSITY[-3:].T
"""From values at the nodes: the integral over the panel, and the last three coefficients."""


class TabulatedDensity:
    """A piecewise polynomial density, normalised on [lower, upper].

    Args:
        log_density: maps positions (m,) to the log density (m,), up to a constant.
        lower, upper: the finite bounds.
        spread: that of the narrowest normal component of the density.  Components narrower than
            1/2000 of the interval may be missed.

    Attributes:
        highest: the node with the highest density.
        log_total: log of the integral of exp(log_density) over the interval.
    """

    def __init__(
        self,
        log_density: Callable[[FloatArray], FloatArray],
        lower: float,
        upper: float,
        spread: float,
    ) -> None:
        panels = min(max(ceil((upper - lower) / (_SPREADS * spread)), 1), _MOST_PANELS)
        for finer in _FINER:
            edges = np.linspace(lower, upper, panels * finer + 1)
            half = 0.5 * np.diff(edges)[:, None]
            x = edges[:-1, None] + half * (1.0 + _NODES)
            logs = log_density(x.ravel()).reshape(x.shape)
            if np.abs(np.einsum("pn,nk->pk", np.exp(logs - logs.max()), _LAST)).max() <= _TOLERANCE:
                break
        self.highest = float(x.flat[logs.argmax()])
        peak = float(logs.max())
        masses = half * np.exp(logs - peak)
        # Unlike those of BLAS, these sums do not depend on a number of threads.
        reached = np.cumsum(np.maximum(np.einsum("pn,n->p", masses, _WHOLE), 0.0))
        self.log_total = float(np.log(reached[-1]) + peak)
        self._masses = masses / reached[-1]
        self._reached: list[float] = [0.0, *(reached / reached[-1]).tolist()]
        self._edges: list[float] = edges.tolist()

    def cdf(self, x: float) -> float:
        """Distribution function at x, in [0, 1]."""
        if not self._edges[0] < x < self._edges[-1]:
            return float(x >= self._edges[-1])
        panel = bisect_right(self._edges, x, 1, len(self._edges) - 1) - 1
        left, right = self._edges[panel : panel + 2]
        z = min(max(2.0 * (x - left) / (right - left) - 1.0, -1.0), 1.0)
        integral = (_INTEGRAL @ self._masses[panel]).tolist()
        return min(max(self._reached[panel] + _series(integral, z), 0.0), 1.0)

    def ppf(self, u: float) -> float:
        """Inverse of ``cdf`` at u in [0, 1], by Newton's method inside the panel with u."""
        panel = bisect_right(self._reached, u, 1, len(self._reached) - 1) - 1
        integral = (_INTEGRAL @ self._masses[panel]).tolist()
        density = (_DENSITY @ self._masses[panel]).tolist()
        target = u - self._reached[panel]
        mass = self._reached[panel + 1] - self._reached[panel]
        lo, hi = -1.0, 1.0
        z = 2.0 * target / mass - 1.0 if mass > 0.0 else -1.0
        for _ in range(_MOST_STEPS):
            excess = _series(integral, z) - target
            lo, hi = (z, hi) if excess < 0.0 else (lo, z)
            slope = _series(density, z)
            newton = z - excess / slope if slope > 0.0 else -inf
            moved = newton if lo <= newton <= hi else 0.5 * (lo + hi)
            change, z = abs(moved - z), moved
            if change <= 1e-13:
                break
        left, right = self._edges[panel : panel + 2]
        return min(max(left + 0.5 * (z + 1.0) * (right - left), left), right)


def _series(coefficients: list[float], z: float) -> float:
    """Chebyshev series at one position, by Clenshaw's recurrence."""
    doubled = 2.0 * z
    ahead, beyond = coefficients[-1], 0.0
    for value in coefficients[-2:0:-1]:
        ahead, beyond = value + doubled * ahead - beyond, ahead
    return coefficients[0] + z * ahead - beyond
