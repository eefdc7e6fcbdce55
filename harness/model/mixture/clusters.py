"""Takes weighted rows and returns clusters: k-means from k-means++ centres.

Source: Arthur and Vassilvitskii (2007).
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def k_means(
    rows: Array, weights: Array, count: int, rounds: int, rng: np.random.Generator
) -> tuple[Array, NDArray[np.intp]]:
    """Cluster rows around centres that move to the means of their clusters.

    Args:
        rows: the rows, (n, d).
        weights: weights of the rows, (n,), ≥ 0.
        count: number of centres; a cluster may become empty.
        rounds: maximum number of assignments of rows to centres, ≥ 1.
        rng: generator for the first centres.

    Returns:
        The centres (count, d), and the cluster of each row (n,).
    """
    centres = _first_centres(rows, weights, count, rng)
    cluster = np.full(rows.shape[0], -1, dtype=np.intp)
    for _ in range(rounds):
        # Squared distances minus the squared norm of the row.
        distances = (centres**2).sum(axis=1) - 2.0 * rows @ centres.T
        nearest = distances.argmin(axis=1)
        if np.array_equal(nearest, cluster):
            break
        cluster = nearest
        member = np.eye(count)[cluster]
        sizes = weights @ member
        moved = ((member * weights[:, None]).T @ rows) / np.maximum(sizes, 1e-300)[:, None]
        centres = np.where(sizes[:, None] > 0.0, moved, centres)
    return centres, cluster


def _first_centres(rows: Array, weights: Array, count: int, rng: np.random.Generator) -> Array:
    """Draw rows one by one, by weight times squared distance to the nearest row drawn before."""
    chance = weights
    centres = []
    nearest = np.full(rows.shape[0], np.inf)
    for _ in range(count):
        reached = np.cumsum(chance)
        if not reached[-1] > 0.0:
            # There are fewer distinct rows than centres.
            reached = np.cumsum(weights)
        drawn = np.searchsorted(reached, rng.random() * reached[-1], side="right")
        centres.append(rows[min(int(drawn), rows.shape[0] - 1)])
        nearest = np.minimum(nearest, ((rows - centres[-1]) ** 2).sum(axis=1))
        chance = weights * nearest
    return np.array(centres)
