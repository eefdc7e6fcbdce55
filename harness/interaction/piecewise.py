"""Distributions of one variable as polynomials on cells, many at once, of any numbers of cells.

Each point's result is the same to the last bit whatever else is in the batch: sums along cells
and coefficients are written out, and no matrix product runs along the batch.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.encounter import FloatArray
from harness.mixture.sums import running_sum

IntArray = NDArray[np.intp]

# Gauss points of a cell from −1 to 1, and the matrix from values there to a polynomial's
# coefficients.
NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_TO_COEFFICIENTS = np.linalg.inv(np.vander(NODES, increasing=True))
_STEPS = 60
_TINY = 1e-300


class Polynomial(NamedTuple):
    """Density c0 + c1 z + … in n cells [left, left + width], z from −1 to 1; all (n,)."""

    left: FloatArray
    width: FloatArray
    coefficients: list[FloatArray]

    def density(self, z: FloatArray) -> FloatArray:
        """Per unit of z."""
        value = self.coefficients[-1]
        for coefficient in self.coefficients[-2::-1]:
            value = value * z + coefficient
        return 0.5 * self.width * value

    def mass_to(self, z: FloatArray) -> FloatArray:
        """From the left end to z."""
        upper, lower = np.zeros_like(z), np.zeros_like(z)
        for power, coefficient in reversed(list(enumerate(self.coefficients, start=1))):
            upper = (upper + coefficient / power) * z
            lower = -(lower + coefficient / power)
        mass: FloatArray = 0.5 * self.width * (upper - lower)
        return mass

    def chosen(self, which: NDArray[np.bool_]) -> "Polynomial":
        return Polynomial(
            self.left[which], self.width[which], [part[which] for part in self.coefficients]
        )


class Pieces:
    """Distributions of n variables, each on its own cells; not normalised.

    Args:
        counts: (n,), ≥ 1: cells of each variable, which follow each other in the other arrays.
        left, width: of the cells, in growing order for each variable; no density between them.
        values: densities (m, cells) ≥ 0 at the m ``NODES`` of each cell.

    Attributes:
        total: mass of each, (n,).
    """

    def __init__(
        self, counts: IntArray, left: FloatArray, width: FloatArray, values: FloatArray
    ) -> None:
        self._left, self._width, self._values = left, width, values
        masses = values[0] * _WEIGHTS[0]
        for weight, value in zip(_WEIGHTS[1:], values[1:], strict=True):
            masses += weight * value
        masses *= 0.5 * width
        # Side by side (most, n), those with fewer cells filled up with empty ones.
        self._first, self._last = np.cumsum(counts) - counts, counts - 1
        step = np.arange(counts.max())[:, None]
        self._cells = self._first + np.minimum(step, self._last)
        self._filled = step <= self._last
        masses = np.where(self._filled, masses.take(self._cells), 0.0)
        self._reached = running_sum(masses)
        self.total: FloatArray = self._reached[-1]

    def cdf(self, x: FloatArray) -> FloatArray:
        """Share of the mass below x (n,), in [0, 1]."""
        begun = self._filled & (self._left.take(self._cells) <= x)
        cell = np.maximum(begun.sum(axis=0, dtype=np.intp) - 1, 0)
        held = self._polynomial(cell)
        share = np.clip((x - held.left) / np.maximum(held.width, _TINY), 0.0, 1.0)
        below = self._before(cell) + held.mass_to(2.0 * share - 1.0)
        result: FloatArray = np.clip(below / self.total, 0.0, 1.0)
        return result

    def ppf(self, u: FloatArray) -> FloatArray:
        """x (n,) with the share u (n,) of the mass below it, inside a cell."""
        target = u * self.total
        cell = (self._reached <= target).sum(axis=0, dtype=np.intp)
        cell = np.minimum(cell, self._last)
        return _inverse(self._polynomial(cell), target - self._before(cell))

    def _before(self, cell: IntArray) -> FloatArray:
        """Mass of all cells before one of each variable, (n,)."""
        reached = self._reached[cell - 1, np.arange(cell.size)]
        result: FloatArray = np.where(cell > 0, reached, 0.0)
        return result

    def _polynomial(self, cell: IntArray) -> Polynomial:
        """The density in one cell of each variable, (n,)."""
        at = self._first + cell
        values = self._values.take(at, axis=1)
        coefficients = []
        for row in _TO_COEFFICIENTS:
            total = values[0] * row[0]
            for factor, value in zip(row[1:], values[1:], strict=True):
                total += factor * value
            coefficients.append(total)
        return Polynomial(self._left.take(at), self._width.take(at), coefficients)


def _inverse(held: Polynomial, target: FloatArray) -> FloatArray:
    """x (n,) in each of n cells with that mass below it, by Newton inside a bracket."""
    mass = held.mass_to(np.ones_like(target))
    z = np.clip(2.0 * target / np.maximum(mass, _TINY) - 1.0, -1.0, 1.0)
    found, left, whole = z.copy(), np.arange(z.size), held
    low, high = np.full(z.shape, -1.0), np.full(z.shape, 1.0)
    for _ in range(_STEPS):
        excess, rate = held.mass_to(z) - target, held.density(z)
        low, high = np.where(excess < 0, z, low), np.where(excess > 0, z, high)
        wanted = z - excess / np.where(rate > 0, rate, _TINY)
        moved = np.where((wanted > low) & (wanted < high), wanted, 0.5 * (low + high))
        # A step too small to matter ends the search; from the bracket's end it would bisect.
        moving = (np.abs(wanted - z) > 1e-12) & (np.abs(moved - z) > 1e-12)
        z = np.where(moving, moved, z)
        found[left] = z
        if not moving.any():
            break
        left, z, low, high = left[moving], z[moving], low[moving], high[moving]
        target, held = target[moving], held.chosen(moving)
    return whole.left + 0.5 * whole.width * (found + 1.0)
