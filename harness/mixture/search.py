"""The highest point of a density and the inverse of a distribution function, many at once.

Every decision is taken element by element, so the answer for one point does not depend on which
others are in the batch.
"""

import numpy as np
from numpy.typing import NDArray

from harness.mixture.closed_form import Cumulative, Form
from harness.mixture.regression import State

Array = NDArray[np.float64]

_GRID = np.linspace(0.0, 1.0, 25)[:, None]
_COARSE = np.linspace(0.0, 1.0, 9)[:, None]
_MOST_STEPS = 60


def highest_point(form: Form, state: State, lower: Array, upper: Array) -> Array:
    """Position of the global maximum of the density on [lower, upper], all (n,).

    One Newton step is taken from every candidate (a grid, the bounds and the component means),
    the best of what it reaches is polished. Comparing after a step rather than before keeps two
    nearly equal peaks apart, of which the grid sees one better than the other.
    """
    width = upper - lower
    means = np.minimum(np.maximum(state.means, lower), upper)
    x = np.concatenate((lower + width * _GRID, means))
    reach = width / (_GRID.size - 1)
    value, first, second = form.curve(state, x)
    moved = np.minimum(np.maximum(x + _ascent(value, first, second, reach), lower), upper)
    columns = np.arange(width.size)
    value, first, second = form.curve(state, moved)
    best = value.argmax(axis=0)
    x = moved[best, columns]
    value, first, second = value[best, columns], first[best, columns], second[best, columns]
    return _polished(form, state, x, (value, first, second), lower, upper)


def _ascent(value: Array, first: Array, second: Array, reach: Array) -> Array:
    """Newton's step on the log density, uphill and no longer than reach."""
    floor = value * 1e-300 + 1e-300
    slope = first / (value + floor)
    bend = slope * slope - second / (value + floor)
    # Where the log density is not concave the step goes uphill as far as allowed.
    step = slope / np.maximum(bend, np.abs(slope) / reach + 1e-300)
    return step


def _polished(
    form: Form,
    state: State,
    x: Array,
    at: tuple[Array, Array, Array],
    lower: Array,
    upper: Array,
) -> Array:
    """Newton steps from x (n,) until they stop moving; a step that loses height is halved."""
    result = x.copy()
    reach = (upper - lower) / (_GRID.size - 1)
    left = np.arange(x.size)
    value, first, second = at
    step = np.minimum(np.maximum(x + _ascent(value, first, second, reach), lower), upper) - x
    for _ in range(_MOST_STEPS):
        moving = np.flatnonzero(np.abs(step) > 1e-9 * reach)
        if moving.size < left.size:
            left, x, step, value = left[moving], x[moving], step[moving], value[moving]
            state = _columns(state, moving)
            lower, upper, reach = lower[moving], upper[moving], reach[moving]
        if not left.size:
            break
        moved = x + step
        new, first, second = (part[0] for part in form.curve(state, moved[None]))
        better = new >= value
        x, value = np.where(better, moved, x), np.where(better, new, value)
        onward = x + _ascent(new, first, second, reach)
        onward = np.minimum(np.maximum(onward, lower), upper) - x
        step = np.where(better, onward, 0.25 * step)
        result[left] = x
    return result


def _columns(state: State, chosen: NDArray[np.intp]) -> State:
    """The state at some of the points; arrays stay in the usual order in memory."""
    return State(
        np.take(state.log_weights, chosen, axis=1),
        state.shift[chosen],
        np.take(state.means, chosen, axis=1),
        [np.take(part, chosen, axis=1) for part in state.rest_means],
    )


def inverse(
    form: Form, state: State, cumulative: Cumulative, u: Array, lower: Array, upper: Array
) -> Array:
    """x (n,) in [lower, upper] with distribution function u (n,), by Newton inside a bracket."""
    target = cumulative.start + u * cumulative.total
    parts = cumulative.parts
    columns = np.arange(u.size)
    grid = lower + (upper - lower) * _COARSE
    sums = form.running(parts, grid)
    cell = (sums[1:-1] <= target).sum(axis=0)
    lo, hi = grid[cell, columns], grid[cell + 1, columns]
    below, above = sums[cell, columns], sums[cell + 1, columns]
    gap = above - below
    share = (target - below) / np.where(gap > 0.0, gap, 1.0)
    x = lo + (hi - lo) * np.minimum(np.maximum(share, 0.0), 1.0)
    tolerance = 1e-14 * cumulative.total
    result = x.copy()
    left = columns
    smallest = 1e-13 * (upper - lower)
    for _ in range(_MOST_STEPS):
        excess = form.running(parts, x[None])[0] - target
        slope = form.density(state, x[None])[0]
        lo, hi = np.where(excess < 0.0, x, lo), np.where(excess > 0.0, x, hi)
        wanted = x - excess / np.where(slope > 0.0, slope, 1e-300)
        inside = (wanted > lo) & (wanted < hi)
        moved = np.where(inside, wanted, 0.5 * (lo + hi))
        done = (np.abs(excess) <= tolerance) | (np.abs(moved - x) <= smallest)
        x = np.where(np.abs(excess) <= tolerance, x, moved)
        result[left] = x
        if done.all():
            break
        if done.any():
            more = np.flatnonzero(~done)
            left, x, lo, hi, target = left[more], x[more], lo[more], hi[more], target[more]
            tolerance, smallest = tolerance[more], smallest[more]
            state = _columns(state, more)
            parts = tuple(np.take(part, more, axis=-1) for part in parts)
    return np.where(u <= 0.0, lower, np.where(u >= 1.0, upper, result))
