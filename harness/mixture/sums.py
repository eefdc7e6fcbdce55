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
