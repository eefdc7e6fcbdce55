"""Takes a log density on an interval and returns its distribution function and quantiles.

The density is interpolated by Chebyshev polynomials on panels (Trefethen, Approximation Theory and
Approximation Practice, 2013).
"""

from bisect import bisect_right
from collections.abc import Callable
from math import ceil

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

Array = NDArray[np.float64]

_DEGREE = 15
# With panels of two spreads the interpolation error is 1e-11 of a normal density's peak.
_SPREADS = 2.0
_MOST_PANELS = 1000
# Panels whose last coefficients exceed the tolerance are halved, for at most this many rounds.
_TOLERANCE = 1e-9
_MOST_ROUNDS = 6
_MOST_STEPS = 60
_NODES = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
# Matrices from values at the nodes to coefficients of the density and of its integral from −1.
_DENSITY = np.linalg.inv(chebyshev.chebvander(_NODES, _DEGREE))
_INTEGRAL = chebyshev.chebint(_DENSITY, lbnd=-1.0)
_WHOLE, _LAST = _INTEGRAL.sum(axis=0), np.ascontiguousarray(_DENSITY[-3:].T)


def panel_edges(lower: float, upper: float, spread: float) -> Array:
    """Edges of the first panels for a density whose narrowest normal component has this spread.

    Components narrower than 1/2000 of the interval may be missed.
    """
    panels = min(max(ceil((upper - lower) / (_SPREADS * spread)), 1), _MOST_PANELS)
    return np.linspace(lower, upper, panels + 1)


class TabulatedDensity:
    """A piecewise polynomial density, normalised on [lower, upper].

    Args:
        log_density: maps positions (m,) to the log density (m,), up to a constant.
        edges: (p + 1,) increasing edges of the first panels, from the lower to the upper bound.
            The panels must be narrow enough to resolve every component (``panel_edges``).

    Attributes:
        highest: the node with the highest density.
        log_total: log of the integral of exp(log_density) over the interval.
    """

    def __init__(self, log_density: Callable[[Array], Array], edges: Array) -> None:
        edges, logs = _refined(log_density, edges)
        half = 0.5 * (edges[1:] - edges[:-1])
        panel, node = divmod(int(logs.argmax()), _NODES.size)
        peak = float(logs[panel, node])
        self.highest = float(edges[panel] + half[panel] * (1.0 + _NODES[node]))
        masses = half[:, None] * np.exp(logs - peak)
        reached = np.cumsum(np.maximum(masses @ _WHOLE, 0.0))
        self.log_total = float(np.log(reached[-1]) + peak)
        self._masses = masses / reached[-1]
        self._reached: list[float] = [0.0, *(reached / reached[-1]).tolist()]
        self._edges: list[float] = edges.tolist()
        # Cache by panel: coefficients of the integral and of the density.
        self._series: dict[int, tuple[list[float], list[float]]] = {}

    def cdf(self, x: float) -> float:
        """Distribution function at x, in [0, 1]."""
        panel = bisect_right(self._edges, x, 1, len(self._edges) - 1) - 1
        left, right = self._edges[panel : panel + 2]
        z = min(max(2.0 * (x - left) / (right - left) - 1.0, -1.0), 1.0)
        reached = self._reached[panel] + _series(self._panel(panel)[0], z)
        return min(max(reached, 0.0), 1.0)

    def ppf(self, u: float) -> float:
        """Inverse of ``cdf`` at u in [0, 1], by Newton's method inside the panel with u."""
        panel = bisect_right(self._reached, u, 1, len(self._reached) - 1) - 1
        integral, density = self._panel(panel)
        target = u - self._reached[panel]
        mass = self._reached[panel + 1] - self._reached[panel]
        lo, hi = -1.0, 1.0
        z = 2.0 * target / mass - 1.0 if mass > 0.0 else -1.0
        for _ in range(_MOST_STEPS):
            excess = _series(integral, z) - target
            if excess == 0.0:
                break
            if excess < 0.0:
                lo = z
            else:
                hi = z
            slope = _series(density, z)
            newton = z - excess / slope if slope > 0.0 else lo
            moved = newton if lo < newton < hi else 0.5 * (lo + hi)
            change, z = abs(moved - z), moved
            if change <= 1e-13:
                break
        left, right = self._edges[panel : panel + 2]
        return min(max(left + 0.5 * (z + 1.0) * (right - left), left), right)

    def _panel(self, panel: int) -> tuple[list[float], list[float]]:
        if panel not in self._series:
            masses = self._masses[panel]
            self._series[panel] = (_INTEGRAL @ masses).tolist(), (_DENSITY @ masses).tolist()
        return self._series[panel]


def _refined(log_density: Callable[[Array], Array], edges: Array) -> tuple[Array, Array]:
    """Edges (p + 1,) of panels that resolve the density, and the log density (p, nodes)."""
    half = 0.5 * (edges[1:] - edges[:-1])[:, None]
    logs = log_density((edges[:-1, None] + half * (1.0 + _NODES)).ravel()).reshape(half.size, -1)
    for _ in range(_MOST_ROUNDS):
        sizes = np.abs(np.exp(logs - logs.max()) @ _LAST).max(axis=1)
        coarse = np.flatnonzero(sizes > _TOLERANCE)
        if not coarse.size:
            break
        middles = 0.5 * (edges[coarse] + edges[coarse + 1])
        edges = np.insert(edges, coarse + 1, middles)
        # Indices of both halves; every panel that is split shifts the later panels by one.
        split = (coarse + np.arange(coarse.size))[:, None] + np.array([0, 1])
        logs = np.insert(logs, coarse + 1, 0.0, axis=0)
        half = 0.5 * (edges[split + 1] - edges[split])[:, :, None]
        x = edges[split][:, :, None] + half * (1.0 + _NODES)
        logs[split.ravel()] = log_density(x.ravel()).reshape(split.size, -1)
    return edges, logs


def _series(coefficients: list[float], z: float) -> float:
    """Chebyshev series at one position, by Clenshaw's recurrence."""
    doubled = 2.0 * z
    ahead, beyond = coefficients[-1], 0.0
    for value in coefficients[-2:0:-1]:
        ahead, beyond = value + doubled * ahead - beyond, ahead
    return coefficients[0] + z * ahead - beyond
