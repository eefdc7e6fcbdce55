"""The highest point of a density and the inverse of a distribution function.

For many points every decision is taken element by element; for one point the same decisions are
taken with plain numbers, which is several times quicker. The two agree to the last bit, so the
answer for a point does not depend on which others are in the batch.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.mixture.closed_form import Cumulative, Form
from harness.mixture.regression import State

Array = NDArray[np.float64]

_GRID = np.linspace(0.0, 1.0, 17)[:, None]
_COARSE = np.linspace(0.0, 1.0, 7)[:, None]
_MOST_STEPS = 60
# Keeps divisions defined where a density has underflowed; steps are 0 there.
_TINY = 1e-300
_SMALLEST_STEP = 1e-5


class Forms(NamedTuple):
    """The same arithmetic for arrays and, flat, for one point."""

    many: Form
    one: Form


def highest_point(form: Form, state: State, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Position and height of the global maximum of the density on [lower, upper], all (n,).

    One Newton step is taken from every candidate (a grid with the bounds, and the component
    means), and the best of what it reaches is polished. Comparing after a step rather than before
    keeps two nearly equal peaks apart, of which the grid may see one better than the other.
    """
    x, reach = _candidates(form, state, lower, upper)
    best = form.density(state, x).argmax(axis=0)
    return _polished(form, state, x[best, np.arange(reach.size)], lower, upper, reach)


def highest_point_one(
    forms: Forms, state: State, lower: Array, upper: Array
) -> tuple[float, float]:
    """`highest_point` for one point, from its flat state; lower, upper (1,)."""
    many = state.many()
    x, reach = _candidates(forms.many, many, lower, upper)
    best = int(forms.many.density(many, x).argmax())
    at, width = float(x[best, 0]), float(reach[0])
    return _polished_one(forms.one, state, at, float(lower[0]), float(upper[0]), width)


def _candidates(form: Form, state: State, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Where one step from every candidate leads (c, n), and the longest step allowed (n,)."""
    width = upper - lower
    reach = width / (_GRID.size - 1)
    x = np.concatenate((lower + width * _GRID, state.means[:, 0]))
    x = np.minimum(np.maximum(x, lower, out=x), upper, out=x)
    x += _ascent(*form.curve(state, x), reach)
    return np.minimum(np.maximum(x, lower, out=x), upper, out=x), reach


def _ascent(value: Array, first: Array, second: Array, reach: Array) -> Array:
    """Newton's step on the log density, uphill and no longer than reach."""
    value = value + _TINY
    slope = first / value
    bend = slope * slope - second / value
    # Where the log density is not concave the step goes uphill as far as allowed.
    limit = np.abs(slope) / reach + _TINY
    step: Array = slope / np.maximum(bend, limit)
    return step


def _polished(
    form: Form, state: State, x: Array, lower: Array, upper: Array, reach: Array
) -> tuple[Array, Array]:
    """Newton steps from x (n,) until they are small; a step that loses height is quartered.

    The last step is taken unseen: after it the error is of the order of its square.
    """
    result, height = x.copy(), np.empty(x.size)
    left = np.arange(x.size)
    step = np.zeros(x.size)
    value = np.full(x.size, -1.0)
    for _ in range(_MOST_STEPS):
        moved = x + step
        new, first, second = (part[0] for part in form.curve(state, moved[None]))
        better = new >= value
        x, value = np.where(better, moved, x), np.where(better, new, value)
        onward = x + _ascent(new, first, second, reach)
        onward = np.minimum(np.maximum(onward, lower), upper) - x
        step = np.where(better, onward, 0.25 * step)
        result[left], height[left] = x + step, value
        moving = np.flatnonzero(np.abs(step) > _SMALLEST_STEP * reach)
        if not moving.size:
            break
        if moving.size < left.size:
            left, x, step, value = left[moving], x[moving], step[moving], value[moving]
            state = state.take(moving)
            lower, upper, reach = lower[moving], upper[moving], reach[moving]
    return result, height


def _polished_one(
    form: Form, state: State, x: float, lower: float, upper: float, reach: float
) -> tuple[float, float]:
    """`_polished` for one point."""
    step, value = 0.0, -1.0
    for _ in range(_MOST_STEPS):
        moved = x + step
        new, first, second = (float(part) for part in form.curve(state, moved))
        if new >= value:
            x, value = moved, new
            new += _TINY
            slope = first / new
            bend = slope * slope - second / new
            limit = abs(slope) / reach + _TINY
            step = min(max(x + slope / max(bend, limit), lower), upper) - x
        else:
            step = 0.25 * step
        if not abs(step) > _SMALLEST_STEP * reach:
            break
    return x + step, value


def inverse(
    form: Form,
    state: State,
    cumulative: Cumulative,
    u: Array,
    lower: Array,
    upper: Array,
) -> tuple[Array, Array]:
    """x (n,) in [lower, upper] with distribution function u (n,), and the total mass (n,).

    Newton's method inside a bracket from a coarse grid, bisecting where it would leave it.
    """
    columns = np.arange(u.size)
    width = upper - lower
    grid = lower + width * _COARSE
    sums = form.running(cumulative, grid)
    total = sums[-1] - sums[0]
    target = sums[0] + u * total
    cell = (sums[1:-1] <= target).sum(axis=0)
    lo, hi = grid[cell, columns], grid[cell + 1, columns]
    below, above = sums[cell, columns], sums[cell + 1, columns]
    share = (target - below) / np.maximum(above - below, _TINY)
    x = lo + (hi - lo) * np.minimum(np.maximum(share, 0.0), 1.0)
    enough, smallest = 1e-14 * total, 1e-13 * width
    return _inverse(form, state, cumulative, x, lo, hi, target, enough, smallest), total


def inverse_one(
    forms: Forms, state: State, u: float, lower: Array, upper: Array
) -> tuple[float, float]:
    """`inverse` for one point, from its flat state; lower, upper (1,)."""
    cumulative = forms.one.cumulative(state)
    many = Cumulative(tuple(part.reshape(-1, 1, 1) for part in cumulative.parts))
    width = upper - lower
    positions = lower + width * _COARSE
    sums = forms.many.running(many, positions)[:, 0].tolist()
    grid = positions[:, 0].tolist()
    total = sums[-1] - sums[0]
    target = sums[0] + u * total
    cell = sum(value <= target for value in sums[1:-1])
    lo, hi, below = grid[cell], grid[cell + 1], sums[cell]
    share = (target - below) / max(sums[cell + 1] - below, _TINY)
    x = lo + (hi - lo) * min(max(share, 0.0), 1.0)
    enough, smallest = 1e-14 * total, 1e-13 * float(width[0])
    return _inverse_one(forms.one, state, cumulative, x, lo, hi, target, enough, smallest), total


def _inverse(
    form: Form,
    state: State,
    cumulative: Cumulative,
    x: Array,
    lo: Array,
    hi: Array,
    target: Array,
    enough: Array,
    smallest: Array,
) -> Array:
    """Solutions (n,) of running mass = target, from x inside [lo, hi]."""
    result = x.copy()
    left = np.arange(x.size)
    for _ in range(_MOST_STEPS):
        excess = form.running(cumulative, x[None])[0] - target
        slope = form.density(state, x[None])[0]
        lo, hi = np.where(excess < 0.0, x, lo), np.where(excess > 0.0, x, hi)
        wanted = x - excess / (slope + _TINY)
        moved = np.where((wanted > lo) & (wanted < hi), wanted, 0.5 * (lo + hi))
        found = np.abs(excess) <= enough
        more = np.flatnonzero(~(found | (np.abs(moved - x) <= smallest)))
        x = np.where(found, x, moved)
        result[left] = x
        if not more.size:
            break
        if more.size < left.size:
            left, x, lo, hi, target = left[more], x[more], lo[more], hi[more], target[more]
            enough, smallest = enough[more], smallest[more]
            state = state.take(more)
            cumulative = Cumulative(tuple(part.take(more, axis=-1) for part in cumulative.parts))
    return result


def _inverse_one(
    form: Form,
    state: State,
    cumulative: Cumulative,
    x: float,
    lo: float,
    hi: float,
    target: float,
    enough: float,
    smallest: float,
) -> float:
    """`_inverse` for one point."""
    for _ in range(_MOST_STEPS):
        excess = float(form.running(cumulative, x)) - target
        if abs(excess) <= enough:
            return x
        if excess < 0.0:
            lo = x
        else:
            hi = x
        wanted = x - excess / (float(form.density(state, x)) + _TINY)
        moved = wanted if lo < wanted < hi else 0.5 * (lo + hi)
        stop = abs(moved - x) <= smallest
        x = moved
        if stop:
            break
    return x
