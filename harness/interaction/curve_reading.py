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
from numpy.typing import NDArray

from harness.encounter import FloatArray
from harness.interaction.curve_components import NUMBERS, Components
from harness.interaction.curve_path import CHANCES, SIDES, CurvePath
from harness.interaction.piecewise import NODES, Pieces
from harness.mixture import TruncatedGaussianMixture
from harness.mixture.regression import Regression
from harness.mixture.sums import running_sum

# Equal parts of each of the three stretches of the curve at which a first look is taken.
_LOOKS = 6
_STEPS = np.arange(_LOOKS + 1)[:, None] / _LOOKS
# Width of a cell where the density is highest, in spreads of its sharpest component / √2.
_WIDEST = 1.2
# Gauss's rule with m points errs in proportion to width^2m times the density's 2m-th derivative:
# cells with density f have equal errors if their widths go with f^(-1/(2m + 1)).
_EVENNESS = 1.0 / (2 * NODES.size + 1)
# A part whose density is below e^-20 of the highest gets a tenth of a cell, none over e^5 / 1.2.
_NEGLIGIBLE = 20.0
_FEWEST = 0.1
_LOG_MOST = 5.0
# Points handled at once.
_CHUNK = 2048


class _Cells(NamedTuple):
    """Cells of n curves, one curve's after the other's in the order of growing v_p.

    Attributes:
        counts: of each curve, (n,), ≥ 1.
        row, stretch: which curve and which of its stretches each cell belongs to.
        left, width: along c.
    """

    counts: NDArray[np.intp]
    row: NDArray[np.intp]
    stretch: NDArray[np.intp]
    left: FloatArray
    width: FloatArray


class _Curves(NamedTuple):
    """The density along the curves of n pedestrians."""

    path: CurvePath
    components: Components
    pieces: Pieces


class CurveReading:
    """f(v_p | R, v, L) of a mixture.

    The curve is cut into cells along a coordinate in which the density is smooth, the narrower
    the sharper and higher the density there, and the density in each is the polynomial through its
    values at six Gauss points.  A point's result is the same to the last bit whatever else is in
    the batch.

    Undefined (NaN) where no walking speed of the box gives a T_adv of the box: L so long, or the
    vehicle so near, that the hole covers everything.

    Args:
        mixture: of dimension 4; bounds of v_p and of w = 1/T_adv must be finite.
        order: columns of 1/R, v, v_p and w in it.
    """

    def __init__(self, mixture: TruncatedGaussianMixture, order: tuple[int, int, int, int]) -> None:
        *given, target, rest = order
        self._regression = Regression(
            mixture.weights,
            mixture.masses,
            mixture.locations,
            mixture.scale_matrices,
            target,
            given,
            [rest],
        )
        bounds = list(zip(mixture.lower.tolist(), mixture.upper.tolist(), strict=True))
        self._speeds, self._inverse_times = bounds[target], bounds[rest]
        # Typical spreads of v_p and of w, all else given: units of the coordinate along the curve.
        precisions = np.diagonal(np.linalg.inv(mixture.scale_matrices), axis1=1, axis2=2)
        typical = np.exp(-0.5 * (mixture.weights @ np.log(precisions)))
        self._spreads = float(typical[target]), float(typical[rest])

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

        def speeds(u: FloatArray, curves: _Curves) -> FloatArray:
            return curves.path.speed(curves.pieces.ppf(u))

        return self._answers(speeds, quantile, range_m, lateral_m, vehicle_speed_mps)

    def cdf(
        self,
        speed_mps: FloatArray,
        range_m: FloatArray,
        lateral_m: FloatArray,
        vehicle_speed_mps: FloatArray,
    ) -> FloatArray:
        """Distribution function at v_p, (n,) in [0, 1]; arguments as for ``ppf``."""

        def shares(x: FloatArray, curves: _Curves) -> FloatArray:
            return curves.pieces.cdf(curves.path.coordinate(x))

        return self._answers(shares, speed_mps, range_m, lateral_m, vehicle_speed_mps)

    def density(
        self,
        speed_mps: FloatArray,
        range_m: FloatArray,
        lateral_m: FloatArray,
        vehicle_speed_mps: FloatArray,
    ) -> FloatArray:
        """Density at v_p, (n,) in s/m, 0 in the hole and outside the box; see ``ppf``."""

        def densities(x: FloatArray, curves: _Curves) -> FloatArray:
            w, factor = curves.path.jacobian(x)
            mixed = curves.components.density(x[None], w[None], np.arange(x.size))[0]
            density: FloatArray = mixed * factor / curves.pieces.total
            return density

        return self._answers(densities, speed_mps, range_m, lateral_m, vehicle_speed_mps)

    def _answers(
        self, function: Callable[[FloatArray, _Curves], FloatArray], *arguments: FloatArray
    ) -> FloatArray:
        """The function of x and the curves at x, R, L and v, each (n,) or one value for all."""
        parts = np.broadcast_arrays(*(np.atleast_1d(np.asarray(a, dtype=float)) for a in arguments))
        result = np.full(parts[0].size, np.nan)
        for at in range(0, result.size, _CHUNK):
            chosen = [part[at : at + _CHUNK] for part in parts]
            path = self._path(*chosen[1:])
            defined = np.flatnonzero(path.open.any(axis=0))
            if defined.size < chosen[0].size:
                chosen = [part.take(defined) for part in chosen]
                path = self._path(*chosen[1:])
            if defined.size:
                result[at + defined] = function(chosen[0], self._curves(path, *chosen[1::2]))
        return result

    def _path(self, range_m: FloatArray, lateral: FloatArray, speed: FloatArray) -> CurvePath:
        boxes = self._speeds, self._inverse_times
        return CurvePath(range_m / speed, lateral, *boxes, self._spreads)

    def _curves(self, path: CurvePath, range_m: FloatArray, speed: FloatArray) -> _Curves:
        """The density of n pedestrians for whom it is defined."""
        components = Components(self._regression, np.column_stack((1.0 / range_m, speed)))
        wanted, least = _first_look(path, components)
        # The highest density is about 1 then.
        components.scale(least)
        return _Curves(path, components, _pieces(path, components, _cells(path, wanted)))


def _first_look(path: CurvePath, components: Components) -> tuple[FloatArray, FloatArray]:
    """How many cells each part of the three stretches wants, (3, looks, n), 0 where closed.

    The curve is taken for straight in each. Also returns the least −log density found, (n,).
    """
    count = path.begin.shape[1]
    ends = path.begin[:, None] + (path.end - path.begin)[:, None] * _STEPS
    nearest, wanted = np.empty((2, 3, _LOOKS, count))
    block = NUMBERS // (3 * (_LOOKS + 1))
    for at in range(0, count, block):
        some = slice(at, at + block)
        rows = np.arange(count)[some]
        place = path.at(ends[..., some], SIDES[:, None, None], rows)
        nearest[..., some], wanted[..., some] = components.along_lines(
            place.speed, place.inverse_time, rows, _EVENNESS
        )
    opened = path.open[:, None]
    nearest = np.where(opened, nearest, np.inf)
    least = np.minimum.reduce(nearest, axis=(0, 1))
    number = np.exp(np.minimum(wanted + _EVENNESS * least, _LOG_MOST)) / _WIDEST
    number = np.where(nearest < least + _NEGLIGIBLE, number, _FEWEST)
    return np.where(opened, number, 0.0), least


def _cells(path: CurvePath, wanted: FloatArray) -> _Cells:
    """In each stretch as many cells as are wanted (3, looks, n), rounded up, with equal shares."""
    by_part = wanted.swapaxes(0, 1)
    reached = running_sum(by_part)
    number = np.ceil(reached[-1])
    each = number.T.ravel().astype(np.intp)
    first = np.cumsum(each) - each
    whole = np.repeat(np.arange(each.size), each)

    def of_stretch(values: FloatArray) -> FloatArray:
        """The value (3, n) of each cell's stretch."""
        return values.T.ravel().take(whole)

    begun = np.arange(whole.size) - first.take(whole)
    target = begun * of_stretch(reached[-1] / np.maximum(number, 1.0))
    # The part in which a cell begins, what was wanted before it, and what it wants itself.
    part, before, within = np.zeros(whole.size), np.zeros(whole.size), of_stretch(by_part[0])
    for i in range(1, _LOOKS):
        so_far = of_stretch(reached[i - 1])
        beyond = so_far <= target
        part += beyond
        before = np.where(beyond, so_far, before)
        within = np.where(beyond, of_stretch(by_part[i]), within)
    steps = part + (target - before) / within
    left = of_stretch(path.begin) + of_stretch((path.end - path.begin) / _LOOKS) * steps
    right = np.append(left[1:], 0.0)
    used = each > 0
    right[(first + each - 1)[used]] = path.end.T.ravel()[used]
    counts = number.sum(axis=0).astype(np.intp)
    row = np.repeat(np.arange(counts.size), counts)
    return _Cells(counts, row, whole - 3 * row, left, right - left)


def _pieces(path: CurvePath, components: Components, cells: _Cells) -> Pieces:
    """The density at the Gauss points of the cells."""
    side, chance = SIDES.take(cells.stretch), CHANCES.take(cells.stretch)
    half, row = 0.5 * cells.width, cells.row
    values = np.empty((NODES.size, row.size))
    block = NUMBERS // NODES.size
    for at in range(0, row.size, block):
        some = slice(at, at + block)
        c = cells.left[some] + half[some] * (1.0 + NODES[:, None])
        place = path.at(c, side[some], row[some])
        mixed = components.density(place.speed, place.inverse_time, row[some])
        mixed *= place.factor
        np.multiply(mixed, chance[some], out=values[:, some])
    left = cells.left + np.where(side > 0, path.jump_over.take(row), 0.0)
    return Pieces(cells.counts, left, cells.width, values)
