"""The reading ``curve``: walking speed given (R, v, L), along the curve T_adv(v_p).

T_adv = |R/v − L/v_p| holds v_p itself, so with L known the four variables lie on a curve: v_p
runs, and w = 1/T_adv with it.  Changing variables from w to L in the joint density of
(1/R, v, v_p, w) gives

    f(v_p | R, v, L) ∝ f(1/R, v, v_p, w(v_p)) · w²/v_p · s,

with s the chance of the sign of R/v − L/v_p that L asks for: both signs are open, ½ each, where
v_p > L v/(2R); below that a positive sign would need L < 0, and s = 1.  The box bounds w, so the
density has a hole around v_p = L v/R, where the two would meet.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from harness.encounter import FloatArray
from harness.mixture import TruncatedGaussianMixture

# Cells of a first look at the density, and those added where it is high.
_CELLS = 12
_ADDED = 12
# The density rises steeply towards the hole: cells shrink like this power towards it.
_GRADING = 1.3
_FEWEST = 4
_CHUNK = 128
_STEPS = 60
# Gauss points of each cell, and the matrix from values there to a polynomial's coefficients.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_TO_COEFFICIENTS = np.linalg.inv(np.vander(_NODES, increasing=True))


class _Cells(NamedTuple):
    """Cells of n points: left ends and widths (m, n), density at their Gauss points (m, 5, n)."""

    left: FloatArray
    width: FloatArray
    values: FloatArray

    def masses(self) -> FloatArray:
        """(m, n), summed point by point so that the batch cannot enter."""
        sums = self.values[:, 0] * _WEIGHTS[0]
        for i in range(1, _WEIGHTS.size):
            sums = sums + self.values[:, i] * _WEIGHTS[i]
        mass: FloatArray = 0.5 * self.width * sums
        return mass

    def holding(self, cell: np.ndarray) -> "_Polynomial":
        """The density in one cell of each of the n points."""
        columns = np.arange(cell.size)
        values = self.values[cell, :, columns].T
        coefficients = []
        for row in _TO_COEFFICIENTS:
            total = values[0] * row[0]
            for i in range(1, row.size):
                total = total + values[i] * row[i]
            coefficients.append(total)
        return _Polynomial(self.left[cell, columns], self.width[cell, columns], coefficients)


class _Polynomial(NamedTuple):
    """Density c0 + c1 z + … in cells [left, left + width], z from −1 to 1; all (n,)."""

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

    def chosen(self, which: np.ndarray) -> "_Polynomial":
        return _Polynomial(
            self.left[which], self.width[which], [part[which] for part in self.coefficients]
        )


class CurveReading:
    """f(v_p | R, v, L) of a mixture.

    The distribution function is that of a piecewise polynomial density through five Gauss points
    in each of 24 cells.  A point's result is the same to the last bit whatever else is in the
    batch.

    Undefined (NaN) where no walking speed of the box gives a T_adv of the box: L so long, or the
    vehicle so near, that the hole covers everything.

    Args:
        mixture: of dimension 4; bounds of v_p and of w = 1/T_adv must be finite.
        order: columns of 1/R, v, v_p and w in it.
    """

    def __init__(self, mixture: TruncatedGaussianMixture, order: tuple[int, int, int, int]) -> None:
        columns = list(order)
        self._lower, self._upper = mixture.lower[columns], mixture.upper[columns]
        self._centre = mixture.locations[:, columns]
        scales = mixture.scale_matrices[:, columns][:, :, columns]
        self._precision = np.linalg.inv(scales)
        self._constant = (
            np.log(mixture.weights / mixture.masses) - 0.5 * (np.linalg.slogdet(scales)[1])
        )

    def ppf(
        self,
        quantile: FloatArray,
        range_m: FloatArray,
        lateral_m: FloatArray,
        vehicle_speed_mps: FloatArray,
    ) -> FloatArray:
        """v_p at a quantile, (n,) in m/s.

        Args:
            quantile: (n,) in [0, 1].
            range_m, lateral_m, vehicle_speed_mps: (n,), R > 0, L > 0, v > 0; R and v within the
                model's box (the caller clamps them).
        """
        return _chunked(self._ppf, quantile, range_m, lateral_m, vehicle_speed_mps)

    def cdf(
        self,
        speed_mps: FloatArray,
        range_m: FloatArray,
        lateral_m: FloatArray,
        vehicle_speed_mps: FloatArray,
    ) -> FloatArray:
        """Distribution function at v_p, (n,) in [0, 1]; arguments as for ``ppf``."""
        return _chunked(self._cdf, speed_mps, range_m, lateral_m, vehicle_speed_mps)

    def density(
        self,
        speed_mps: FloatArray,
        range_m: FloatArray,
        lateral_m: FloatArray,
        vehicle_speed_mps: FloatArray,
    ) -> FloatArray:
        """Density at v_p, (n,) in s/m, 0 in the hole and outside the box; see ``ppf``."""
        return _chunked(self._density, speed_mps, range_m, lateral_m, vehicle_speed_mps)

    def _ppf(
        self, u: FloatArray, range_m: FloatArray, lateral: FloatArray, speed: FloatArray
    ) -> FloatArray:
        cells, _, defined = self._cells(range_m, lateral, speed)
        reached = np.add.accumulate(cells.masses(), axis=0)
        target = u * reached[-1]
        # Cells without width have no mass; the last one with any holds whatever rounding left.
        holding = reached.shape[0] - 1 - np.argmax(cells.width[::-1] > 0, axis=0)
        cell = np.minimum((reached[:-1] <= target).sum(axis=0), holding)
        before = np.where(cell > 0, reached[cell - 1, np.arange(u.size)], 0.0)
        x = _inverse(cells.holding(cell), target - before)
        return np.where(defined, x, np.nan)

    def _cdf(
        self, x: FloatArray, range_m: FloatArray, lateral: FloatArray, speed: FloatArray
    ) -> FloatArray:
        cells, _, defined = self._cells(range_m, lateral, speed)
        reached = np.add.accumulate(cells.masses(), axis=0)
        cell = np.maximum((cells.left <= x).sum(axis=0) - 1, 0)
        before = np.where(cell > 0, reached[cell - 1, np.arange(x.size)], 0.0)
        held = cells.holding(cell)
        share = np.clip((x - held.left) / np.where(held.width > 0, held.width, 1.0), 0.0, 1.0)
        sums = before + np.where(held.width > 0, held.mass_to(2.0 * share - 1.0), 0.0)
        return np.where(defined, np.clip(sums / reached[-1], 0.0, 1.0), np.nan)

    def _density(
        self, x: FloatArray, range_m: FloatArray, lateral: FloatArray, speed: FloatArray
    ) -> FloatArray:
        cells, shift, defined = self._cells(range_m, lateral, speed)
        total = np.add.accumulate(cells.masses(), axis=0)[-1]
        (a1, b1), (a2, b2) = self._branches(range_m / speed, lateral)
        inside = ((x >= a1) & (x <= b1)) | ((x >= a2) & (x <= b2))
        at = np.where(inside, x, 1.0)[None]
        logs = self._logs(at, range_m, lateral, speed)[0]
        with np.errstate(under="ignore"):
            value = np.exp(logs - shift) / total
        return np.where(defined, np.where(inside, value, 0.0), np.nan)

    def _branches(
        self, arrival: FloatArray, lateral: FloatArray
    ) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
        """Walking speeds of the box on either side of the hole; an empty side has a = b."""
        low, high = self._lower[2], self._upper[2]
        nearest = 1.0 / self._upper[3]
        with np.errstate(divide="ignore"):
            furthest = 1.0 / np.float64(self._lower[3])
        # Slower than the hole L/v_p = R/v + T, faster L/v_p = R/v − T, T from nearest to furthest.
        a1, b1 = lateral / (arrival + furthest), lateral / (arrival + nearest)
        with np.errstate(divide="ignore"):
            a2 = np.where(arrival > nearest, lateral / np.maximum(arrival - nearest, 0.0), np.inf)
            b2 = np.where(arrival > furthest, lateral / np.maximum(arrival - furthest, 0.0), np.inf)
        a1, b1 = np.clip(a1, low, high), np.clip(b1, low, high)
        return (a1, b1), (np.clip(a2, low, high), np.clip(b2, low, high))

    def _cells(
        self, range_m: FloatArray, lateral: FloatArray, speed: FloatArray
    ) -> tuple[_Cells, FloatArray, np.ndarray]:
        """Cells with their densities over exp(shift), the shifts, and where anything is defined."""
        left, right = self._edges(range_m / speed, lateral)
        left, right = self._refined(left, right, (range_m, lateral, speed))
        width = right - left
        defined = np.asarray((width > 0).any(axis=0))
        x = left[:, None] + (0.5 * width)[:, None] * (1.0 + _NODES[:, None])
        x = x.reshape(-1, range_m.size)
        logs = self._logs(np.maximum(x, self._lower[2]), range_m, lateral, speed)
        weighted = np.where(np.repeat(width > 0, _NODES.size, axis=0), logs, -np.inf)
        shift = np.where(defined, np.maximum.reduce(weighted, axis=0), 0.0)
        with np.errstate(under="ignore"):
            values = np.exp(weighted - shift).reshape(left.shape[0], _NODES.size, -1)
        return _Cells(left, width, values), shift, defined

    def _edges(self, arrival: FloatArray, lateral: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Left and right ends (m, n) of the cells: graded towards the hole, one at the jump."""
        (a1, b1), (a2, b2) = self._branches(arrival, lateral)
        slower, faster = b1 - a1, b2 - a2
        share = slower / np.maximum(slower + faster, 1e-300)
        count = np.clip(np.rint(_CELLS * share), _FEWEST, _CELLS - _FEWEST)
        count = np.where(faster <= 0, _CELLS, np.where(slower <= 0, 0, count))
        step = np.arange(_CELLS + 1)[:, None]
        along = np.clip(step / np.maximum(count, 1.0), 0.0, 1.0)
        beyond = np.clip((step - count) / np.maximum(_CELLS - count, 1.0), 0.0, 1.0)
        below = b1 - slower * (1.0 - along) ** _GRADING
        above = a2 + faster * beyond**_GRADING
        left = np.where(step < count, below, above)[:-1]
        right = np.where(step <= count, below, above)[1:]
        right = np.where(step[1:] > count, above[1:], right)
        # The factor s jumps here; the nearer end of the cell it falls into is moved onto it.
        jump = lateral / (2.0 * arrival)
        cut = (left < jump) & (jump < right)
        first, last = step[:-1] == 0, step[:-1] == count - 1
        move_left = cut & ((jump - left < right - jump) | last) & ~first
        move_right = cut & ~move_left
        left = np.where(move_left, jump, left)
        right = np.where(move_right, jump, right)
        left[1:] = np.where(move_right[:-1], jump, left[1:])
        right[:-1] = np.where(move_left[1:], jump, right[:-1])
        return left, right

    def _refined(
        self,
        left: FloatArray,
        right: FloatArray,
        state: tuple[FloatArray, FloatArray, FloatArray],
    ) -> tuple[FloatArray, FloatArray]:
        """The cells (m, n) split, more of them where one look at each finds more mass."""
        width, middle = right - left, 0.5 * (left + right)
        logs = self._logs(np.maximum(middle, self._lower[2]), *state)
        logs = np.where(width > 0, logs, -np.inf)
        largest = np.maximum.reduce(logs, axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            mass = np.sqrt(width * np.exp(np.maximum(logs - largest, -700.0)))
        # A peak between two looks shows in the cells beside it.
        mass[1:-1] = mass[1:-1] + 0.5 * (mass[:-2] + mass[2:])
        reached = np.add.accumulate(np.where(width > 0, mass, 0.0), axis=0)
        reached /= np.where(reached[-1] > 0, reached[-1], 1.0)
        last = np.floor(_ADDED * reached).astype(np.intp)
        last[-1] = _ADDED
        parts = np.diff(last, axis=0, prepend=0) + 1
        total = _CELLS + _ADDED
        whole = np.tile(np.arange(_CELLS), parts.shape[1])
        cell = np.repeat(whole, parts.T.ravel()).reshape(-1, total).T
        columns = np.arange(parts.shape[1])
        first = np.cumsum(parts, axis=0) - parts
        step = np.arange(total)[:, None] - first[cell, columns]
        share = parts[cell, columns]
        low, size = left[cell, columns], width[cell, columns]
        end = np.where(step + 1 == share, right[cell, columns], low + size * ((step + 1) / share))
        return low + size * (step / share), end

    def _logs(
        self, x: FloatArray, range_m: FloatArray, lateral: FloatArray, speed: FloatArray
    ) -> FloatArray:
        """Log of f · w²/v_p · s at walking speeds x (m, n), up to a constant."""
        arrival = range_m / speed
        apart = np.abs(arrival - lateral / x)
        # In the hole and on its rim nothing is read from w; it must only be finite.
        w = np.minimum(1.0 / np.maximum(apart, 1e-12), self._upper[3])
        sign = np.where(x > lateral / (2.0 * arrival), 0.5, 1.0)
        logs = self._log_joint(1.0 / range_m, speed, x, w)
        logs += np.log(w * w / x * sign)
        return logs

    def _log_joint(
        self, inverse_range: FloatArray, speed: FloatArray, x: FloatArray, w: FloatArray
    ) -> FloatArray:
        """Log of the mixture at (1/R, v, x, w), x and w (m, n), up to a constant."""
        p, m = self._precision, self._centre
        terms = np.empty((m.shape[0], *x.shape))
        inner = np.empty(x.shape)
        for k, term in enumerate(terms):
            a, b = inverse_range - m[k, 0], speed - m[k, 1]
            on_x, on_w = p[k, 2, 0] * a + p[k, 2, 1] * b, p[k, 3, 0] * a + p[k, 3, 1] * b
            fixed = p[k, 0, 0] * a * a + 2.0 * p[k, 0, 1] * a * b + p[k, 1, 1] * b * b
            # -½ of the quadratic form in (x, w), written out around 0: no array but these two.
            x0, w0 = m[k, 2], m[k, 3]
            fixed += p[k, 2, 2] * x0 * x0 + 2.0 * p[k, 2, 3] * x0 * w0 + p[k, 3, 3] * w0 * w0
            fixed -= 2.0 * (on_x * x0 + on_w * w0)
            np.multiply(w, -p[k, 2, 3], out=term)
            np.multiply(x, -0.5 * p[k, 2, 2], out=inner)
            term += inner
            term += p[k, 2, 2] * x0 + p[k, 2, 3] * w0 - on_x
            term *= x
            np.multiply(w, -0.5 * p[k, 3, 3], out=inner)
            inner += p[k, 3, 3] * w0 + p[k, 2, 3] * x0 - on_w
            inner *= w
            term += inner
            term += self._constant[k] - 0.5 * fixed
        largest = np.maximum.reduce(terms, axis=0)
        terms -= largest
        # Far below the largest nothing counts, and numbers next to 0 are slow to work with.
        np.maximum(terms, -700.0, out=terms)
        np.exp(terms, out=terms)
        sums = np.add.accumulate(terms, axis=0)[-1] if x.size == 1 else terms.sum(axis=0)
        result: FloatArray = largest + np.log(sums)
        return result


def _chunked(
    function: Callable[[FloatArray, FloatArray, FloatArray, FloatArray], FloatArray],
    *arguments: FloatArray,
) -> FloatArray:
    """The function over slices that fit the cache; arguments (n,) or one value for all."""
    parts = np.broadcast_arrays(*(np.atleast_1d(np.asarray(a, dtype=float)) for a in arguments))
    slices = [slice(at, at + _CHUNK) for at in range(0, parts[0].size, _CHUNK)]
    found = [function(*(part[chosen] for part in parts)) for chosen in slices]
    return np.concatenate(found) if found else np.empty(0)


def _inverse(held: _Polynomial, target: FloatArray) -> FloatArray:
    """x (n,) in each of n cells with that mass below it, by Newton inside a bracket."""
    mass = held.mass_to(np.ones_like(target))
    z = np.clip(2.0 * target / np.where(mass > 0, mass, 1.0) - 1.0, -1.0, 1.0)
    found, left, whole = z.copy(), np.arange(z.size), held
    low, high = np.full(z.shape, -1.0), np.full(z.shape, 1.0)
    for _ in range(_STEPS):
        excess, rate = held.mass_to(z) - target, held.density(z)
        low, high = np.where(excess < 0, z, low), np.where(excess > 0, z, high)
        wanted = z - excess / np.where(rate > 0, rate, 1e-300)
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
