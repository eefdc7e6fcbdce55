"""Takes (R, v, L) and returns the distribution of the walking speed by the reading ``curve``.

T_adv = |R/v − L/v_p| depends on v_p, so for a known L the four variables lie on a curve:
w = 1/T_adv is a function of v_p.  Changing variables from w to L in the joint density of
(1/R, v, v_p, w) gives

    f(v_p | R, v, L) ∝ f(1/R, v, v_p, w(v_p)) · w²/v_p · s,

where s is the probability of the sign of R/v − L/v_p.  If v_p > L v/(2R), both signs are possible
and s = ½.  Otherwise one sign would need L < 0, so s = 1.  The box bounds w, so the density has a
hole around v_p = L v/R, where vehicle and pedestrian would collide.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from harness.core.encounter import FloatArray
from harness.model.mixture import TruncatedGaussianMixture
from harness.model.mixture.components import Given, Regression

# Numbers of grid points in v_p, and in w on either side of the hole.
_SPEEDS = 48
_TIMES = 128
# Number of cells added where the mass is.
_PARTS = 128
# Gauss's two-point rule in each cell.
_NODES = np.array([-1.0, 1.0]) / np.sqrt(3.0)
# Largest number of values in an array that fits the cache.
_NUMBERS = 200_000


class _Grid(NamedTuple):
    """The densities of n pedestrians, constant within each of m cells.

    Attributes:
        ends: ends of the cells in increasing v_p, (n, m + 1).
        reached: distribution function at the ends, (n, m + 1); NaN if no v_p fits the box.
        log_total: log of the integral of the density, (n,).
    """

    ends: FloatArray
    reached: FloatArray
    log_total: FloatArray


class CurveReading:
    """f(v_p | R, v, L) of a mixture by one-dimensional quadrature on a grid of v_p.

    The distribution function is accurate to 1e-3.  Its inverse uses the same grid.

    It is undefined (NaN) if L ≤ 0, or if no walking speed in the box gives a T_adv in the box.  The
    latter happens if L is too long or the vehicle too near.

    Args:
        mixture: mixture of dimension 4 with finite bounds of v_p and of w = 1/T_adv.
        order: the mixture's columns of 1/R, v, v_p and w.
    """

    def __init__(self, mixture: TruncatedGaussianMixture, order: tuple[int, int, int, int]) -> None:
        *given, target, rest = order
        self._regression = Regression(mixture, target, given, [rest])
        self._speeds = mixture.lower[target], mixture.upper[target]
        self._inverse_times = mixture.lower[rest], mixture.upper[rest]
        self._even = np.linspace(*self._speeds, _SPEEDS)
        # The steps are quadratic because T_adv is mostly some seconds, so w is near 0.
        steps = np.linspace(0.0, 1.0, _TIMES) ** 2
        w = self._inverse_times[0] + (self._inverse_times[1] - self._inverse_times[0]) * steps
        self._advantages = 1.0 / np.maximum(w, 1e-9)

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
        return self._answers(_inverse, quantile, range_m, lateral_m, vehicle_speed_mps)

    def cdf(
        self,
        speed_mps: FloatArray,
        range_m: FloatArray,
        lateral_m: FloatArray,
        vehicle_speed_mps: FloatArray,
    ) -> FloatArray:
        """Distribution function at v_p, (n,) in [0, 1]; arguments as for ``ppf``."""
        return self._answers(_reached, speed_mps, range_m, lateral_m, vehicle_speed_mps)

    def pdf(
        self,
        speed_mps: FloatArray,
        range_m: FloatArray,
        lateral_m: FloatArray,
        vehicle_speed_mps: FloatArray,
    ) -> FloatArray:
        """Density at v_p, (n,) in s/m, 0 in the hole and outside the box; see ``ppf``."""

        def densities(x: FloatArray, grid: _Grid, *state: FloatArray) -> FloatArray:
            logs = self._log_density(x[:, None], *state)[:, 0]
            return np.where(np.isfinite(grid.log_total), np.exp(logs - grid.log_total), np.nan)

        return self._answers(densities, speed_mps, range_m, lateral_m, vehicle_speed_mps)

    def _answers(self, function: Callable[..., FloatArray], *arguments: FloatArray) -> FloatArray:
        """Evaluate a function of x, grid and state for n pedestrians, in batches."""
        parts = np.broadcast_arrays(*(np.atleast_1d(np.asarray(a, dtype=float)) for a in arguments))
        result = np.full(parts[0].size, np.nan)
        ahead = np.flatnonzero(parts[2] > 0.0)
        columns = 2 * (_SPEEDS + 2 * _TIMES + _PARTS) * self._regression.spread.size
        most = max(_NUMBERS // columns, 1)
        for at in range(0, ahead.size, most):
            rows = ahead[at : at + most]
            x, *state = (part[rows] for part in parts)
            result[rows] = function(x, self._grid(*state), *state)
        return result

    def _grid(self, range_m: FloatArray, lateral: FloatArray, speed: FloatArray) -> _Grid:
        arrival, lateral_ = (range_m / speed)[:, None], lateral[:, None]
        faster = lateral_ / np.maximum(arrival - self._advantages, 1e-9)
        slower = lateral_ / (arrival + self._advantages)
        even = np.broadcast_to(self._even, (len(speed), _SPEEDS))
        ends = np.hstack((even, slower, faster, lateral_ / (2.0 * arrival)))
        ends = np.sort(np.clip(ends, *self._speeds), axis=1)
        first = self._grid_between(ends, range_m, lateral, speed)
        # The first grid shows where the mass is; the second has cells with equal parts of it.
        parts = np.linspace(0.0, 1.0, _PARTS + 1)[1:-1]
        quantiles = _between(np.broadcast_to(parts, (len(speed), parts.size)), first.reached, ends)
        finer = np.sort(
            np.hstack((ends, np.where(np.isnan(quantiles), self._speeds[0], quantiles))), axis=1
        )
        return self._grid_between(finer, range_m, lateral, speed)

    def _grid_between(
        self, ends: FloatArray, range_m: FloatArray, lateral: FloatArray, speed: FloatArray
    ) -> _Grid:
        """The grid whose cells have these ends, (n, m + 1)."""
        half = 0.5 * np.diff(ends)[:, :, None]
        x = ends[:, :-1, None] + half * (1.0 + _NODES)
        logs = self._log_density(x.reshape(len(speed), -1), range_m, lateral, speed)
        peak = logs.max(axis=1)
        with np.errstate(invalid="ignore"):
            masses = np.exp(logs - peak[:, None]).reshape(x.shape).sum(axis=2) * half[:, :, 0]
            reached = np.cumsum(masses, axis=1)
            total = reached[:, -1]
            log_total = np.log(total) + peak
            reached = np.hstack((np.zeros((len(speed), 1)), reached / total[:, None]))
        return _Grid(ends, reached, log_total)

    def _log_density(
        self, x: FloatArray, range_m: FloatArray, lateral: FloatArray, speed: FloatArray
    ) -> FloatArray:
        """Log of f · w²/v_p · s at v_p = x (n, m), up to a constant; −inf outside the box."""
        given = self._regression.at(np.column_stack((1.0 / range_m, speed)))
        arrival, lateral = (range_m / speed)[:, None], lateral[:, None]
        with np.errstate(divide="ignore"):
            w = 1.0 / np.abs(arrival - lateral / x)
        inside = (w >= self._inverse_times[0]) & (w <= self._inverse_times[1])
        inside &= (x >= self._speeds[0]) & (x <= self._speeds[1])
        w = np.where(inside, w, 1.0)
        chance = np.where(x > lateral / (2.0 * arrival), 0.5, 1.0)
        logs = self._log_joint(x, w, given) + np.log(w * w / x * chance)
        return np.where(inside, logs, -np.inf)

    def _log_joint(self, x: FloatArray, w: FloatArray, given: Given) -> FloatArray:
        """Log of the mixture's density in (v_p, w), up to a factor for each pedestrian."""
        regression = self._regression
        spread, rest = regression.spread, np.sqrt(regression.rest_covariances[:, 0, 0])
        means, rest_means = given.means[:, 0, :, None], given.means[:, 1, :, None]
        away = x - means
        z = away / spread[:, None, None]
        turned = rest_means + regression.rest_slopes[:, :, None] * away
        y = (w - turned) / rest[:, None, None]
        logs = given.log_weights - np.log(spread * rest)[:, None]
        logs = logs[:, :, None] - 0.5 * (z * z + y * y)
        largest = logs.max(axis=0)
        result: FloatArray = largest + np.log(np.exp(logs - largest).sum(axis=0))
        return result


def _reached(x: FloatArray, grid: _Grid, *_: FloatArray) -> FloatArray:
    """Distribution function at x (n,)."""
    return _between(x, grid.ends, grid.reached)


def _inverse(u: FloatArray, grid: _Grid, *_: FloatArray) -> FloatArray:
    """x (n,) where the distribution function is u (n,)."""
    return _between(u, grid.reached, grid.ends)


def _between(at: FloatArray, steps: FloatArray, values: FloatArray) -> FloatArray:
    """Linear interpolation of values (n, m), row by row, at increasing steps (n, m)."""
    defined = np.isfinite(steps[:, -1] + values[:, -1])
    return np.array(
        [
            np.interp(*row) if good else np.full_like(row[0], np.nan)
            for good, *row in zip(defined, at, steps, values, strict=True)
        ]
    )
