"""Random draws from a truncated univariate mixture, many given points at once."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from harness.mixture.regression import State
from harness.mixture.sums import running_sum

Array = NDArray[np.float64]


# Uniforms that one draw may use: two for each try without bounds, two for the exact one.
UNIFORMS = 6


def draw(state: State, spread: Array, lower: float, upper: float, u: Array) -> Array:
    """One draw (n,) per given point from uniforms u (UNIFORMS, n); spread (K,).

    A component and a normal value are drawn as if there were no bounds, twice if the first falls
    outside. What then is still outside is drawn from the truncated components, whose masses cost
    more. Each way has the truncated distribution, so the result has. nan where no component has
    a mass that double precision can hold.
    """
    weights, means = np.exp(state.log_weights[:, 0]), state.means[:, 0]
    reached = running_sum(weights)
    x = np.empty(u.shape[1])
    left = np.arange(x.size)
    for at in (0, 2):
        chosen = _chosen(reached if at == 0 else reached.take(left, axis=1), u[at, left])
        x[left] = means[chosen, left] + spread[chosen] * ndtri(u[at + 1, left])
        left = left[~((x[left] >= lower) & (x[left] <= upper))]
    if left.size:
        some = means.take(left, axis=1), weights.take(left, axis=1)
        x[left] = _inside(*some, spread[:, None], lower, upper, u[4:, left])
    return x


def _chosen(reached: Array, u: Array) -> NDArray[np.intp]:
    """Index (n,) of the component that u falls in; running sums of weights (K, n)."""
    passed = reached[:-1] <= u * reached[-1]
    # A narrow sum over the components is several times quicker than numpy's default.
    chosen: NDArray[np.intp] = passed.sum(axis=0, dtype=np.uint16).astype(np.intp)
    return chosen


def _inside(
    means: Array, weights: Array, spread: Array, lower: float, upper: float, u: Array
) -> Array:
    """Draws from the truncated components by inverse distribution functions, u (2, n)."""
    a, b = (lower - means) / spread, (upper - means) / spread
    # In the upper tail work with the mirrored variable, where small masses keep their digits.
    sign = np.where(a + b > 0.0, -1.0, 1.0)
    at_a, at_b = ndtr(a * sign), ndtr(b * sign)
    masses = weights * np.abs(at_b - at_a)
    chosen = _chosen(running_sum(masses), u[0])
    columns = np.arange(chosen.size)
    at_a, at_b, sign = at_a[chosen, columns], at_b[chosen, columns], sign[chosen, columns]
    z = sign * ndtri(at_a + u[1] * (at_b - at_a))
    x = np.minimum(np.maximum(means[chosen, columns] + spread[chosen, 0] * z, lower), upper)
    result: Array = np.where(masses[chosen, columns] > 0.0, x, np.nan)
    return result
