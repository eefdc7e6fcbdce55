"""Sums whose result for one point is the same however many points are summed at once."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def ordered_sum(values: Array) -> Array:
    """Sum over axis 0 in a fixed order, the same bytes for one point as for many.

    numpy adds row after row where axis 0 is not the fastest in memory, and pairwise
    where it is; the latter happens with a single column, and is avoided.
    """
    result: Array
    if values.size == values.shape[0]:
        result = np.add.accumulate(values, axis=0)[-1]
    else:
        result = np.add.reduce(np.ascontiguousarray(values), axis=0)
    return result


def running_sum(values: Array) -> Array:
    """Sums of the first 1, 2, … rows over axis 0, the same bytes for one point as for many.

    Row by row this is ten times quicker than numpy's accumulate, which walks down each column.
    """
    result = np.empty_like(values)
    result[0] = values[0]
    for i in range(1, values.shape[0]):
        np.add(result[i - 1], values[i], out=result[i])
    return result
