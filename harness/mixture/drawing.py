"""Random draws from a truncated univariate mixture, many given points at once."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from harness.mixture.regression import State

Array = NDArray[np.float64]


def draw(state: State, spread: Array, lower: float, upper: float, u: Array) -> Array:
    """One draw (n,) per given point from uniforms u (4, n); spread (K,) of the components.

    A component and a normal value are drawn as if there were no bounds. The values that fall
    outside are drawn again, exactly, from the truncated components, whose masses cost more. nan
    where no component has a mass that double precision can hold.
    """
    weights, centres = np.exp(state.log_weights[:, 0]), state.means[:, 0]
    chosen = _chosen(weights, u[0])
    columns = np.arange(chosen.size)
    x: Array = centres[chosen, columns] + spread[chosen] * ndtri(u[1])
    outside = np.flatnonzero(~((x >= lower) & (x <= upper)))
    if outside.size:
        means, heights = centres[:, outside], weights[:, outside]
        x[outside] = _inside(means, heights, spread[:, None], lower, upper, u[2:, outside])
    return x


def _chosen(weights: Array, u: Array) -> NDArray[np.intp]:
    """Index (n,) of the component that u falls in; weights (K, n), not normalised."""
    reached = np.add.accumulate(weights, axis=0)
    chosen: NDArray[np.intp] = (reached[:-1] <= u * reached[-1]).sum(axis=0)
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
    chosen = _chosen(masses, u[0])
    columns = np.arange(chosen.size)
    at_a, at_b, sign = at_a[chosen, columns], at_b[chosen, columns], sign[chosen, columns]
    z = sign * ndtri(at_a + u[1] * (at_b - at_a))
    x = np.minimum(np.maximum(means[chosen, columns] + spread[chosen, 0] * z, lower), upper)
    result: Array = np.where(masses[chosen, columns] > 0.0, x, np.nan)
    return result
