"""Normal distributions of one to four variables and a box in; its probability and moments out.

One and two variables have closed forms (the normal distribution function and Owen's T).  Three and
four variables use Plackett's identity: the derivative of the probability with respect to a
correlation is its second derivative in the locations of the two variables (``_corner_sums``).  The
probability is then one integral along a path of correlation matrices.  All functions are batched
over the leading axis.

Sources: Owen (1956); Plackett (1954); Gassmann, Deák, Szántai (2002).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, owens_t

from harness.core.vocabulary import FloatArray

Indices = NDArray[np.intp]

_FAR = 30.0
"""The tail beyond this standardised bound is below double precision."""
_NEGLIGIBLE = 1e-17
"""Terms with a smaller density change a probability by less than rounding."""
_PATH_LIMITS = np.array([0.2, 0.4, 0.6, 0.8, 0.9, 0.95])
"""Limits of the canonical correlations, by which the number of nodes is chosen."""
_PATH_SIZES = np.array([4, 5, 7, 9, 11, 13, 24])
"""The number of Gauss-Legendre nodes for canonical correlations up to each limit.  With these
numbers boxes of three or four variables are accurate to 1e-11."""
_PATH_STARTS = np.cumsum(_PATH_SIZES) - _PATH_SIZES
_PATH_NODES, _PATH_WEIGHTS = np.concatenate(
    [np.polynomial.legendre.leggauss(int(size)) for size in _PATH_SIZES], axis=1
)
"""Where the nodes of each size begin, the nodes, and their weights."""
_CHUNK = 2048
"""Number of boxes in a batch, which limits the memory."""
_TINY = 1e-30
"""It replaces a bound of exactly 0, by which Owen's T would be divided."""
_ORDERS = {
    3: np.array([[0, 1, 2], [0, 2, 1], [1, 2, 0]]),
    4: np.array([[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2]]),
}
"""The pairings of three or four variables, of which the one with the strongest pairs is used."""


def interval(a: FloatArray, b: FloatArray) -> FloatArray:
    """Φ(b) − Φ(a) for standardised bounds a ≤ b of any shape, accurate in both tails."""
    # In the upper tail both values are near 1 and their difference loses its digits.
    flip = a > -b
    return np.asarray(ndtr(np.where(flip, -a, b)) - ndtr(np.where(flip, -b, a)))


def _rectangle(a: FloatArray, b: FloatArray, rho: FloatArray) -> FloatArray:
    """P(a < (X, Y) < b), for bounds (N, 2), of standard normals of correlation rho (N,)."""
    # Owen's formula divides by each bound, so a bound of 0 is replaced by a negligible number.
    x, y = (np.where(edges == 0.0, _TINY, edges) for edges in (np.stack((a, b)).transpose(2, 0, 1)))
    h, k = x[:, None], y[None]
    ratio, root = k / h, np.sqrt(1.0 - rho * rho)
    # Φ2(h, k; rho) − (Φ(h) + Φ(k))/2 at the four corners; the univariate terms cancel.
    corners = owens_t(h, (ratio - rho) / root) + owens_t(k, (1.0 / ratio - rho) / root)
    corners += 0.5 * (ratio < 0.0)
    result: FloatArray = corners[0, 1] + corners[1, 0] - corners[0, 0] - corners[1, 1]
    return np.maximum(result, 0.0)


def box_probability(covariances: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Probability that a centred normal vector lies in a box.

    Args:
        covariances: (N, d, d), d from 0 to 4, positive definite.
        lower, upper: (N, d), relative to the centre; may be infinite.

    Returns:
        (N,) in [0, 1]. The absolute error is at most about 1e-9 at condition numbers up to 100.
        Small probabilities have few correct digits if d ≥ 2.
    """
    spread = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    a, b = (np.clip(edge / spread, -_FAR, _FAR) for edge in (lower, upper))
    return _standard_box(covariances / (spread[:, :, None] * spread[:, None, :]), a, b)


def _standard_box(correlations: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """``box_probability`` for unit variances and bounds already cut at ±_FAR."""
    count, dimension = a.shape
    if dimension == 0:
        return np.ones(count)
    if dimension == 1:
        return interval(a[:, 0], b[:, 0])
    if dimension == 2:
        return _rectangle(a, b, correlations[:, 0, 1])
    chunks = (slice(at, at + _CHUNK) for at in range(0, count, _CHUNK))
    parts = [_by_path(correlations[at], a[at], b[at]) for at in chunks]
    return np.clip(np.concatenate(parts), 0.0, 1.0) if parts else np.empty(0)


def _corner_sums(
    correlations: FloatArray, a: FloatArray, b: FloatArray, first: Indices, second: Indices
) -> FloatArray:
    """Second derivatives (N, P) of ``_standard_box`` in the locations of P pairs of variables.

    Such a derivative is a signed sum over the four corners of the pair: the bivariate density
    there, times the probability of the other variables given the two.

    Args:
        correlations: (N, d, d), d from 2 to 4.
        a, b: bounds, (N, d).
        first, second: the variables of each pair, (P,).
    """
    count, dimension = a.shape
    others = np.array(
        [
            [at for at in range(dimension) if at not in pair]
            for pair in zip(first, second, strict=True)
        ],
        dtype=np.intp,
    )
    edges = np.stack((a, b), axis=2)
    r = correlations[:, first, second]
    left = 1.0 - r * r
    x, y = edges[:, first, :, None], edges[:, second, None, :]
    twice = x * x - 2.0 * r[..., None, None] * x * y + y * y
    density = np.exp(-0.5 * twice / left[..., None, None])
    box, pair, i, j = np.nonzero(density > _NEGLIGIBLE)
    # Regression of the others on the two variables.
    with_i = correlations[:, others, first[:, None]]
    with_j = correlations[:, others, second[:, None]]
    on_i = (with_i - r[..., None] * with_j) / left[..., None]
    on_j = (with_j - r[..., None] * with_i) / left[..., None]
    within = correlations[:, others[:, :, None], others[:, None, :]]
    within = (
        within - on_i[..., None] * with_i[..., None, :] - on_j[..., None] * with_j[..., None, :]
    )
    at = box, pair
    centre = on_i[at] * edges[box, first[pair], i][:, None]
    centre += on_j[at] * edges[box, second[pair], j][:, None]
    rest, rows = others[pair], box[:, None]
    inside = box_probability(within[at], a[rows, rest] - centre, b[rows, rest] - centre)
    sign = np.where(i == j, 1.0, -1.0) / (2.0 * np.pi * np.sqrt(left[at]))
    terms = sign * density[box, pair, i, j] * inside
    sums = np.bincount(box * first.size + pair, terms, count * first.size)
    return np.asarray(sums, dtype=np.float64).reshape(count, first.size)


def _by_path(correlations: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Probabilities of the blocks (1, 2) and (3) or (3, 4): product plus integral over a path.

    Along the path the correlations between the blocks grow from 0, as t grows from 0 to 1.  The
    integrand is singular at t = 1/c, where c is the largest canonical correlation of the two
    blocks.  The substitution t = sin(θ)/c removes the singularity.
    """
    dimension = a.shape[1]
    squares, orders = correlations**2, _ORDERS[dimension]
    kept = squares[:, orders[:, 0], orders[:, 1]]
    if dimension == 4:
        kept = kept + squares[:, orders[:, 2], orders[:, 3]]
    order = orders[np.argmax(kept, axis=1)]
    rows = np.arange(len(a))[:, None]
    correlations = correlations[rows[:, :, None], order[:, :, None], order[:, None, :]]
    a, b = a[rows, order], b[rows, order]
    canonical = _largest_canonical(correlations)
    rule = np.searchsorted(_PATH_LIMITS, canonical, side="right")
    sizes = _PATH_SIZES[rule]
    box = np.repeat(np.arange(len(a)), sizes)
    node = np.arange(box.size) - np.repeat(np.cumsum(sizes) - sizes - _PATH_STARTS[rule], sizes)
    scale = canonical[box]
    angle = 0.5 * np.arcsin(scale)
    theta = angle * (_PATH_NODES[node] + 1.0)
    along = correlations[box]
    across = along[:, :2, 2:].copy()
    along[:, :2, 2:] *= (np.sin(theta) / scale)[:, None, None]
    along[:, 2:, :2] = np.swapaxes(along[:, :2, 2:], 1, 2)
    first, second = (at.ravel() for at in np.meshgrid([0, 1], range(2, dimension), indexing="ij"))
    slopes = _corner_sums(along, a[box], b[box], first, second) * across.reshape(box.size, -1)
    steps = angle * _PATH_WEIGHTS[node] * np.cos(theta) / scale * slopes.sum(axis=1)
    blocks = [
        _standard_box(correlations[:, block, block], a[:, block], b[:, block])
        for block in (slice(2), slice(2, None))
    ]
    return np.asarray(blocks[0] * blocks[1] + np.bincount(box, steps, len(a)))


def _largest_canonical(correlations: FloatArray) -> FloatArray:
    """Largest canonical correlation (N,) between the two blocks, strictly between 0 and 1."""
    cross = correlations[:, :2, 2:]
    first = np.linalg.solve(correlations[:, :2, :2], cross)
    second = np.linalg.solve(correlations[:, 2:, 2:], np.swapaxes(cross, 1, 2))
    largest = np.linalg.eigvals(first @ second).real.max(axis=1)
    return np.asarray(np.sqrt(np.clip(largest, 1e-12, 1.0 - 1e-14)))


def moments(
    locations: FloatArray, scale_matrices: FloatArray, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Masses α (K,), means E (K, d) and covariances V (K, d, d) of normals truncated to a box.

    The moments are E = m + S ∇log α and V = S + S (∇² log α) S, with derivatives in the location m,
    which are probabilities on the faces and edges of the box.  The error of means and covariances
    is below 1e-7 of the component's spread at condition numbers up to 100.  They are nan or inf if
    the mass is nearly 0.  Sources: Tallis (1961); Manjunath and Wilhelm (2012), eqs. (11) and (16).

    Args:
        locations: m, (K, d), d from 1 to 4.
        scale_matrices: S, (K, d, d), positive definite.
        lower, upper: (d,), may be infinite.
    """
    spread = np.sqrt(np.diagonal(scale_matrices, axis1=1, axis2=2))
    correlations = scale_matrices / (spread[:, :, None] * spread[:, None, :])
    a, b = (np.clip((edge - locations) / spread, -_FAR, _FAR) for edge in (lower, upper))
    mass = _standard_box(correlations, a, b)
    edges = np.stack((a, b), axis=2)
    faces = _faces(correlations, a, b, edges)
    gradient = faces[:, :, 0] - faces[:, :, 1]
    first, second = np.triu_indices(a.shape[1], 1)
    hessian = np.zeros_like(correlations)
    sums = _corner_sums(correlations, a, b, first, second) if first.size else 0.0
    hessian[:, first, second] = hessian[:, second, first] = sums
    steps = np.arange(a.shape[1])
    hessian[:, steps, steps] = (
        edges[:, :, 0] * faces[:, :, 0] - edges[:, :, 1] * faces[:, :, 1]
    ) - np.einsum("kij,kij->ki", correlations, hessian)
    # Moments are undefined for a mass near 0; callers check the mass.
    with np.errstate(all="ignore"):
        slope = gradient / mass[:, None]
        curvature = hessian / mass[:, None, None] - slope[:, :, None] * slope[:, None, :]
        means = locations + spread * np.einsum("kij,kj->ki", correlations, slope)
        covariance = correlations + correlations @ curvature @ correlations
    return mass, means, covariance * spread[:, :, None] * spread[:, None, :]


def _faces(correlations: FloatArray, a: FloatArray, b: FloatArray, edges: FloatArray) -> FloatArray:
    """φ at both bounds of each variable, times the others' conditional probability, (K, d, 2)."""
    dimension = a.shape[1]
    others = np.array([[p for p in range(dimension) if p != i] for i in range(dimension)], int)
    result: FloatArray = np.exp(-0.5 * edges * edges) / np.sqrt(2.0 * np.pi)
    k, i, side = np.nonzero(result > _NEGLIGIBLE)
    rest = others[i]
    slopes = correlations[k[:, None], rest, i[:, None]]
    within = correlations[k[:, None, None], rest[:, :, None], rest[:, None, :]]
    centre = slopes * edges[k, i, side][:, None]
    result[k, i, side] *= box_probability(
        within - slopes[:, :, None] * slopes[:, None, :],
        a[k[:, None], rest] - centre,
        b[k[:, None], rest] - centre,
    )
    return result
