"""Weighted points in; normal distributions around their clusters out."""

import warnings
from typing import NamedTuple

import numpy as np
from scipy.cluster.vq import kmeans2, vq

from harness.core.freezing import frozen
from harness.core.vocabulary import FloatArray

_ROUNDS = 10
"""Rounds of k-means."""
_MOST_POINTS = 20_000
"""Number of points that k-means looks at."""
_PRIOR = 0.1
"""A component's scatter is shrunk to this share of the variances of all points, which weighs as
much as one point."""
NARROWEST = 1e-5
"""Added to every variance, so that equal points have a covariance."""


class Normals(NamedTuple):
    """A mixture: weights (K,), locations (K, d) and scale matrices (K, d, d), all read-only."""

    weights: FloatArray
    locations: FloatArray
    scales: FloatArray


def effective(weights: FloatArray) -> float:
    """Kish's effective number of points with weights (n,), (Σw)²/Σw²; 0 if all weights are 0."""
    squares = float(np.sum(weights**2))
    return float(weights.sum()) ** 2 / squares if squares else 0.0


def clustered_normals(
    points: FloatArray, weights: FloatArray, count: int, rng: np.random.Generator
) -> Normals:
    """One normal distribution for each cluster of weighted points.

    The clusters are those of k-means from k-means++ centres (Arthur and Vassilvitskii 2007), for
    points drawn by their weights, in units of the points' spread.  A component has the mean and
    covariance of its cluster.  The covariance is shrunk more if a cluster has few effective points,
    (Σw)²/Σw².

    Args:
        points: (n, d), n ≥ 1.
        weights: (n,) > 0.
        count: K ≥ 1.  The weight of a component without points is 0.
        rng: generator for the draws and the first centres.
    """
    share = weights / weights.sum()
    variances = share @ (points - share @ points) ** 2 + NARROWEST
    units = np.sqrt(variances)
    drawn = rng.choice(len(points), min(len(points), _MOST_POINTS), p=share)
    with warnings.catch_warnings(), np.errstate(invalid="ignore"):
        # There may be fewer distinct points than clusters.
        warnings.simplefilter("ignore", UserWarning)
        centres, _ = kmeans2(points[drawn] / units, count, _ROUNDS, minit="++", rng=rng)
    cluster, _ = vq(points / units, centres)
    sizes, locations, scales = np.zeros(count), centres * units, np.empty((count, *2 * units.shape))
    prior = _PRIOR * np.diag(variances)
    for k in range(count):
        own, weight = points[cluster == k], share[cluster == k]
        scatter = np.zeros_like(prior)
        if len(own):
            sizes[k] = weight.sum()
            locations[k] = weight @ own / sizes[k]
            away = own - locations[k]
            scatter = (away.T * weight) @ away / sizes[k]
        weighed = effective(weight)
        scales[k] = (weighed * scatter + prior) / (weighed + 1.0)
    return Normals(*frozen((sizes, locations, scales + NARROWEST * np.eye(units.size))))
