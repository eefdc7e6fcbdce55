"""A density on an interval held as Chebyshev polynomials on panels, for quick inverse look-ups.

Used where the distribution function has no closed form: the density is evaluated once at the
nodes of panels that are split until the polynomials agree with it, and its integral and inverse
then cost a few operations.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

Array = NDArray[np.float64]

_DEGREE = 15
_TOLERANCE = 1e-13
_MOST_ROUNDS = 6
_MOST_STEPS = 60
_NODES = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
_TO_COEFFICIENTS = np.linalg.inv(chebyshev.chebvander(_NODES, _DEGREE))


class TabulatedDensity:
    """Piecewise polynomial density, normalised on [lower, upper].

    Args:
        log_density: maps positions (m,) to the log of the density up to a constant (m,).
        breaks: (p + 1,), increasing, from the lower to the upper bound: the first panels.
    """

    def __init__(self, log_density: Callable[[Array], Array], breaks: Array) -> None:
        panels, values, peak = _refined(log_density, breaks)
        self.edges = np.append(panels[:, 0], panels[-1, 1])
        self._half = 0.5 * (panels[:, 1] - panels[:, 0])
        self._middle = 0.5 * (panels[:, 1] + panels[:, 0])
        density = values @ _TO_COEFFICIENTS.T
        antiderivative = chebyshev.chebint(density, lbnd=-1.0, axis=1)
        antiderivative = antiderivative * self._half[:, None]
        masses = np.maximum(chebyshev.chebval(1.0, antiderivative.T), 0.0)
        total = masses.sum()
        self.log_total = float(np.log(total) + peak)
        self._density = np.ascontiguousarray((density / total).T)
        self._cumulative = np.ascontiguousarray((antiderivative / total).T)
        self._reached = np.concatenate(([0.0], np.cumsum(masses) / total))
        self._slope = chebyshev.chebder(self._density, axis=0)
        self._bend = chebyshev.chebder(self._slope, axis=0)

        # Coefficients of panels met by `ppf`, as plain numbers: one look-up is then quicker than
        # numpy's overhead would be.
        self._numbers: dict[int, tuple[list[float], list[float]]] = {}

    def cdf(self, x: Array) -> Array:
        """Distribution function at x (n,) inside the bounds, in [0, 1]."""
        panel = self._panel(x)
        z = (x - self._middle[panel]) / self._half[panel]
        value = self._reached[panel] + _clenshaw(self._cumulative[:, panel], z)
        result: Array = np.clip(value, 0.0, 1.0)
        return result

    def ppf(self, u: Array) -> Array:
        """Inverse of `cdf` at u (n,) in [0, 1], by Newton inside the panel that holds u."""
        last = self._half.size - 1
        panels = np.clip(np.searchsorted(self._reached, u, side="right") - 1, 0, last)
        return np.array(
            [self._ppf_one(*at) for at in zip(u.tolist(), panels.tolist(), strict=True)]
        )

    def _ppf_one(self, u: float, panel: int) -> float:
        if panel not in self._numbers:
            self._numbers[panel] = (
                self._cumulative[:, panel].tolist(),
                (self._density[:, panel] * self._half[panel]).tolist(),
            )
        cumulative, density = self._numbers[panel]
        target = u - float(self._reached[panel])
        mass = float(self._reached[panel + 1]) - float(self._reached[panel])
        lo, hi = -1.0, 1.0
        z = 2.0 * target / mass - 1.0 if mass > 0.0 else -1.0
        for _ in range(_MOST_STEPS):
            excess = _series(cumulative, z) - target
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
        x = float(self._middle[panel]) + float(self._half[panel]) * z
        return min(max(x, float(self.edges[0])), float(self.edges[-1]))

    @cached_property
    def mode(self) -> float:
        """Position of the highest density, by Newton from the highest point of a fine grid."""
        grid = np.linspace(-1.0, 1.0, 33)
        heights = chebyshev.chebval(grid, self._density)
        panel, at = np.unravel_index(np.argmax(heights), heights.shape)
        best, height = float(grid[at]), float(heights[panel, at])
        z = best
        for _ in range(20):
            bend = chebyshev.chebval(z, self._bend[:, panel])
            if bend >= 0.0:
                break
            z = float(np.clip(z - chebyshev.chebval(z, self._slope[:, panel]) / bend, -1.0, 1.0))
        if chebyshev.chebval(z, self._density[:, panel]) >= height:
            best = z
        x = float(self._middle[panel] + self._half[panel] * best)
        return min(max(x, float(self.edges[0])), float(self.edges[-1]))

    def _panel(self, x: Array) -> NDArray[np.intp]:
        inside = np.searchsorted(self.edges, x, side="right") - 1
        return np.clip(inside, 0, self._half.size - 1)


def _refined(log_density: Callable[[Array], Array], breaks: Array) -> tuple[Array, Array, float]:
    """Panels (p, 2), density at their nodes (p, m) over exp(peak), and peak."""
    waiting = np.column_stack((breaks[:-1], breaks[1:]))
    panels: list[Array] = []
    logs: list[Array] = []
    peak = -np.inf
    for round_number in range(_MOST_ROUNDS):
        middle, half = waiting.mean(axis=1), 0.5 * (waiting[:, 1] - waiting[:, 0])
        found = log_density((middle[:, None] + half[:, None] * _NODES).ravel())
        found = found.reshape(-1, _NODES.size)
        peak = max(peak, float(found.max()))
        size = np.abs(np.exp(found - peak) @ _TO_COEFFICIENTS.T)
        rough = (size[:, -3:].max(axis=1) > _TOLERANCE) & (round_number < _MOST_ROUNDS - 1)
        panels.append(waiting[~rough])
        logs.append(found[~rough])
        if not rough.any():
            break
        low, high, middle = waiting[rough, 0], waiting[rough, 1], middle[rough]
        waiting = np.concatenate((np.column_stack((low, middle)), np.column_stack((middle, high))))
    every = np.concatenate(panels)
    order = np.argsort(every[:, 0])
    return every[order], np.exp(np.concatenate(logs)[order] - peak), peak


def _clenshaw(coefficients: Array, z: Array) -> Array:
    """Chebyshev series, coefficients (m, n) at z (n,)."""
    doubled = 2.0 * z
    ahead = coefficients[-1]
    beyond = np.zeros_like(ahead)
    for row in coefficients[-2:0:-1]:
        ahead, beyond = row + doubled * ahead - beyond, ahead
    value: Array = coefficients[0] + z * ahead - beyond
    return value


def _series(coefficients: list[float], z: float) -> float:
    """Chebyshev series at one position."""
    doubled = 2.0 * z
    ahead, beyond = coefficients[-1], 0.0
    for value in coefficients[-2:0:-1]:
        ahead, beyond = value + doubled * ahead - beyond, ahead
    return coefficients[0] + z * ahead - beyond
