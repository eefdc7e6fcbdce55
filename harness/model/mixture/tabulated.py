"""A density on an interval as polynomials on panels: its integral and the inverse of that.

Chebyshev interpolation: Trefethen, Approximation Theory and Approximation Practice (2013).
"""

from bisect import bisect_right
from collections.abc import Callable
from math import ceil

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

Array = NDArray[np.float64]

_DEGREE = 15
# Panels of two spreads leave an interpolation error of 1e-11 of a normal density's peak.
_SPREADS = 2.0
_MOST_PANELS = 1000
# Panels whose last coefficients are above this are halved, so many times at most.
_TOLERANCE = 1e-9
_MOST_ROUNDS = 6
_MOST_STEPS = 60
_NODES = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
# From values at the nodes to coefficients of the density, and of its integral from −1 on.
_DENSITY = np.linalg.inv(chebyshev.chebvander(_NODES, _DEGREE))
_INTEGRAL = chebyshev.chebint(_DENSITY, lbnd=-1.0)
_WHOLE, _LAST = _INTEGRAL.sum(axis=0), np.ascontiguousarray(_DENSITY[-3:].T)


def panel_edges(lower: float, upper: float, spread: float) -> Array:
    """Edges of first panels for a density whose narrowest normal part has this spread.

    Parts narrower than 1/2000 of the interval may be missed.
    """
    wanted = min(max(ceil((upper - lower) / (_SPREADS * spread)), 1), _MOST_PANELS)
    return np.linspace(lower, upper, wanted + 1)


class TabulatedDensity:
    """Piecewise polynomial density, normalised on [lower, upper].

    Args:
        log_density: maps positions (m,) to the log of the density up to a constant (m,).
        edges: (p + 1,), increasing, from the lower to the upper bound: of the first panels, which
            must be narrow enough to see every part of the density (``panel_edges``).

    Attributes:
        highest: where the density is highest of all nodes.
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
        # Of panels that were asked for: coefficients of the integral and of the density.
        self._series: dict[int, tuple[list[float], list[float]]] = {}

    def cdf(self, x: float) -> float:
        """Distribution function at x, in [0, 1]."""
        panel = bisect_right(self._edges, x, 1, len(self._edges) - 1) - 1
        left, right = self._edges[panel : panel + 2]
        z = min(max(2.0 * (x - left) / (right - left) - 1.0, -1.0), 1.0)
        reached = self._reached[panel] + _series(self._panel(panel)[0], z)
        return min(max(reached, 0.0), 1.0)

    def ppf(self, u: float) -> float:
        """Inverse of ``cdf`` at u in [0, 1], by Newton inside the panel that holds u."""
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
            wanted = z - excess / slope if slope > 0.0 else lo
            moved = wanted if lo < wanted < hi else 0.5 * (lo + hi)
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
    """Edges (p + 1,) of panels on which polynomials agree with the density, its log (p, nodes)."""
    half = 0.5 * (edges[1:] - edges[:-1])[:, None]
    logs = log_density((edges[:-1, None] + half * (1.0 + _NODES)).ravel()).reshape(half.size, -1)
    for _ in range(_MOST_ROUNDS):
        sizes = np.abs(np.exp(logs - logs.max()) @ _LAST).max(axis=1)
        rough = np.flatnonzero(sizes > _TOLERANCE)
        if not rough.size:
            break
        middles = 0.5 * (edges[rough] + edges[rough + 1])
        edges = np.insert(edges, rough + 1, middles)
        # Both halves of each: a panel's index moves by one for each that was split before it.
        split = (rough + np.arange(rough.size))[:, None] + np.array([0, 1])
        logs = np.insert(logs, rough + 1, 0.0, axis=0)
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
