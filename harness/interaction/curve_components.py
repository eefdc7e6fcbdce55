"""The components of a mixture over (v_p, 1/T_adv), for many given (1/R, v) at once."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from harness.encounter import FloatArray
from harness.mixture.regression import Regression

# Numbers in one array: more would not stay in the cache.
NUMBERS = 32_000
_TINY = 1e-300
_LOWEST = -700.0


class Components:
    """The mixture's density at n given (1/R, v), Σ exp(height − y1² − y2²) over K components.

    y1 = along v_p + first and y2 = across v_p + steep w + second are linear in v_p and w; height,
    first and second depend on the given point.  A factor for each point is left out.

    Args:
        regression: of v_p on (1/R, v), with w = 1/T_adv left.
        given: 1/R and v, (n, 2).
    """

    def __init__(self, regression: Regression, given: FloatArray) -> None:
        state = regression.at(given)
        means, rest_means = state.means[:, 0], state.rest_means[0][:, 0]
        spread = regression.spread[:, None]
        rest_spread = np.sqrt(regression.rest_covariances[:, 0])
        slope = regression.rest_slopes
        along, steep = np.sqrt(0.5) / spread, np.sqrt(0.5) / rest_spread
        self._slopes = np.stack((along, -steep * slope, steep))
        log_heights = state.log_weights[:, 0] - np.log(spread * rest_spread)
        first, second = -along * means, steep * (slope * means - rest_means)
        self._given = np.stack((first, second, log_heights))

    def scale(self, log_factor: FloatArray) -> None:
        """Multiply the density at each given point by exp(log_factor), (n,)."""
        self._given[2] += log_factor

    def density(
        self, speed: FloatArray, inverse_time: FloatArray, rows: NDArray[np.intp]
    ) -> FloatArray:
        """At v_p and w (…, m) of m of the given points, (…, m)."""
        total, lowest = np.zeros(speed.shape), np.full(rows.size, _LOWEST)
        for y1, y2, height in self._distances(speed, inverse_time, rows):
            y1 *= y1
            y2 *= y2
            y1 += y2
            np.subtract(height, y1, out=y1)
            # Far below nothing counts, and numbers next to 0 are slow to work with.
            np.maximum(y1, lowest, out=y1)
            for term in np.exp(y1, out=y1):
                total += term
        return total

    def along_lines(
        self, speed: FloatArray, inverse_time: FloatArray, rows: NDArray[np.intp], power: float
    ) -> tuple[FloatArray, FloatArray]:
        """About straight lines from place to place (…, c, m): two arrays (…, c − 1, m).

        The least −log density of a component on the line; and the highest
        log(length · density^power), length the line's own in that component's (y1, y2), density
        where it comes nearest.
        """
        shape = (*speed.shape[:-2], speed.shape[-2] - 1, speed.shape[-1])
        least, highest = np.full(shape, np.inf), np.full(shape, -np.inf)
        for y1, y2, height in self._distances(speed, inverse_time, rows):
            from1, from2 = y1[..., :-1, :], y2[..., :-1, :]
            step1, step2 = y1[..., 1:, :] - from1, y2[..., 1:, :] - from2
            towards = from1 * step1
            towards += from2 * step2
            cost = from1 * from1
            cost += from2 * from2
            step1 *= step1
            step2 *= step2
            step1 += step2
            length = np.maximum(step1, _TINY, out=step1)
            share = np.divide(towards, length, out=step2)
            np.negative(share, out=share)
            np.maximum(share, 0.0, out=share)
            np.minimum(share, 1.0, out=share)
            # At a share of the way the distance² has changed by share (2 towards + share length).
            towards += towards
            towards += share * length
            towards *= share
            cost += towards
            cost -= height
            score = np.log(length, out=length)
            score *= 0.5
            score -= np.multiply(cost, power, out=share)
            for some, value in zip(cost, score, strict=True):
                np.minimum(least, some, out=least)
                np.maximum(highest, value, out=highest)
        return least, highest

    def _distances(
        self, speed: FloatArray, inverse_time: FloatArray, rows: NDArray[np.intp]
    ) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
        """y1 and y2 (g, …, m) and height (g, …, m) of some components after the others."""
        group = max(NUMBERS // speed.size, 1)
        shape = (-1, *(1,) * speed.ndim)
        for at in range(0, self._slopes.shape[1], group):
            along, across, steep = self._slopes[:, at : at + group].reshape(3, *shape)
            given = self._given[:, at : at + group].take(rows, axis=2)
            first, second, height = given.reshape(3, *shape[:-1], rows.size)
            y1 = along * speed
            y1 += first
            y2 = across * speed
            y2 += steep * inverse_time
            y2 += second
            yield y1, y2, height
