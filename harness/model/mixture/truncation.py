"""Takes normal distributions and a box and returns masses and moments of the truncated ones.

Let α(m) be the mass inside the box as a function of the location m. The moments are
E = m + S ∇log α and V = S + S (∇² log α) S. The derivatives are probabilities on the faces and
edges of the box. Sources: Tallis (1961); Manjunath and Wilhelm (2012), eqs. (11) and (16).
"""

import numpy as np
from numpy.typing import NDArray

from harness.model.mixture.boxes import FAR, box_probability, interval, standard_box

Array = NDArray[np.float64]

# For smaller masses the closed forms lose their digits by cancellation. A sum of positive terms
# does not, but is much slower.
_SMALL = 1e-6
_NEGLIGIBLE = 1e-17
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(40)


def masses(locations: Array, scale_matrices: Array, lower: Array, upper: Array) -> Array:
    """Mass α of each normal component inside the box.

    Args:
        locations: (K, d), d from 1 to 4.
        scale_matrices: (K, d, d), positive definite.
        lower, upper: (d,), may be infinite.

    Returns:
        (K,) in [0, 1]. The absolute error is below 1e-8 at condition numbers up to 100. Masses
        above about 1e-100 have a few correct digits; smaller ones may be 0.
    """
    correlations, a, b, _ = _standardised(locations, scale_matrices, lower, upper)
    return _masses(correlations, a, b)


def moments(
    locations: Array, scale_matrices: Array, lower: Array, upper: Array
) -> tuple[Array, Array, Array]:
    """Masses (K,), means (K, d) and covariances (K, d, d) of the truncated components.

    The arguments are those of `masses`. The error of means and covariances is below 1e-7 of the
    component's spread at condition numbers up to 100. They are nan or inf if the mass is nearly 0.
    """
    correlations, a, b, spread = _standardised(locations, scale_matrices, lower, upper)
    mass = _masses(correlations, a, b)
    gradient, hessian = _derivatives(correlations, a, b)
    # Moments are undefined for a mass near 0; callers check the mass.
    with np.errstate(all="ignore"):
        slope = gradient / mass[:, None]
        curvature = hessian / mass[:, None, None] - slope[:, :, None] * slope[:, None, :]
        shift = np.einsum("kij,kj->ki", correlations, slope)
        covariance = correlations + correlations @ curvature @ correlations
    return (
        mass,
        locations + spread * shift,
        covariance * spread[:, :, None] * spread[:, None, :],
    )


def _standardised(
    locations: Array, scale_matrices: Array, lower: Array, upper: Array
) -> tuple[Array, Array, Array, Array]:
    """Correlations, bounds in units of each component's spread (cut at ±FAR), spreads."""
    spread = np.sqrt(np.diagonal(scale_matrices, axis1=1, axis2=2))
    a = np.clip((lower - locations) / spread, -FAR, FAR)
    b = np.clip((upper - locations) / spread, -FAR, FAR)
    return scale_matrices / (spread[:, :, None] * spread[:, None, :]), a, b, spread


def _masses(correlations: Array, a: Array, b: Array) -> Array:
    """Masses by closed forms, or by sums of positive terms if the closed forms are inaccurate."""
    mass = standard_box(correlations, a, b)
    if a.shape[1] > 1:
        for k in np.flatnonzero(mass < _SMALL):
            mass[k] = _positive_mass(correlations[k], a[k], b[k])
    return mass


def _positive_mass(covariance: Array, a: Array, b: Array) -> float:
    """Mass of a small box, by integrating one variable after the other; all terms are positive."""
    centre = np.zeros((1, a.size))
    weights = np.ones(1)
    for i in range(a.size - 1):
        scale = np.sqrt(covariance[i, i])
        z, w = _window((a[i] - centre[:, i]) / scale, (b[i] - centre[:, i]) / scale)
        column = covariance[:, i] / scale
        centre = (centre[:, None, :] + z[:, :, None] * column).reshape(-1, a.size)
        weights = (weights[:, None] * w).ravel()
        keep = weights > weights.max(initial=0.0) * 1e-25
        centre, weights = centre[keep], weights[keep]
        covariance = covariance - np.outer(column, column)
    scale = np.sqrt(covariance[-1, -1])
    inside = interval((a[-1] - centre[:, -1]) / scale, (b[-1] - centre[:, -1]) / scale)
    return float(weights @ inside)


def _window(lo: Array, hi: Array) -> tuple[Array, Array]:
    """Nodes and weights (N, M) for the integral of φ over [lo, hi], cut where φ fell by e^-40."""
    nearest = np.clip(0.0, lo, hi)
    reach = np.sqrt(nearest**2 + 80.0)
    lo, hi = np.maximum(lo, -reach), np.minimum(hi, reach)
    half = 0.5 * np.maximum(hi - lo, 0.0)[:, None]
    z = 0.5 * (hi + lo)[:, None] + half * _NODES
    return z, half * _WEIGHTS * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)


def _derivatives(correlations: Array, a: Array, b: Array) -> tuple[Array, Array]:
    """Gradient (K, d) and Hessian (K, d, d) of the mass in the standardised location."""
    dimension = a.shape[1]
    edges = np.stack((a, b), axis=2)
    faces = _faces(correlations, a, b, edges)
    gradient = faces[:, :, 0] - faces[:, :, 1]
    hessian = _corners(correlations, a, b, edges)
    on_faces = edges[:, :, 0] * faces[:, :, 0] - edges[:, :, 1] * faces[:, :, 1]
    diagonal = on_faces - np.einsum("kij,kij->ki", correlations, hessian)
    steps = np.arange(dimension)
    hessian[:, steps, steps] = diagonal
    return gradient, hessian


def _faces(correlations: Array, a: Array, b: Array, edges: Array) -> Array:
    """φ at both bounds of each variable, times the others' conditional probability, (K, d, 2)."""
    dimension = a.shape[1]
    others = np.array([[p for p in range(dimension) if p != i] for i in range(dimension)], int)
    result: Array = np.exp(-0.5 * edges * edges) / np.sqrt(2.0 * np.pi)
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


def _corners(correlations: Array, a: Array, b: Array, edges: Array) -> Array:
    """Signed sums over the four corners of each pair of variables, (K, d, d), 0 on the diagonal."""
    count, dimension = a.shape
    hessian = np.zeros((count, dimension, dimension))
    first, second = np.triu_indices(dimension, 1)
    others = np.array(
        [
            [p for p in range(dimension) if p not in (i, j)]
            for i, j in zip(first, second, strict=True)
        ],
        int,
    ).reshape(first.size, max(dimension - 2, 0))
    r = correlations[:, first, second][:, :, None, None]
    x, y = edges[:, first, :, None], edges[:, second, None, :]
    left = 1.0 - r * r
    density = np.exp(-0.5 * (x * x - 2.0 * r * x * y + y * y) / left)
    density *= np.array([[1.0, -1.0], [-1.0, 1.0]]) / (2.0 * np.pi * np.sqrt(left))
    k, pair, p, q = np.nonzero(np.abs(density) > _NEGLIGIBLE)
    i, j, rest = first[pair], second[pair], others[pair]
    # Regression of the others on the two variables at the corner.
    with_i = correlations[k[:, None], rest, i[:, None]]
    with_j = correlations[k[:, None], rest, j[:, None]]
    r, left = r[k, pair, 0, 0][:, None], left[k, pair, 0, 0][:, None]
    on_i, on_j = (with_i - r * with_j) / left, (with_j - r * with_i) / left
    within = correlations[k[:, None, None], rest[:, :, None], rest[:, None, :]]
    centre = on_i * edges[k, i, p][:, None] + on_j * edges[k, j, q][:, None]
    inside = box_probability(
        within - on_i[:, :, None] * with_i[:, None, :] - on_j[:, :, None] * with_j[:, None, :],
        a[k[:, None], rest] - centre,
        b[k[:, None], rest] - centre,
    )
    sums = np.bincount(
        k * first.size + pair, density[k, pair, p, q] * inside, minlength=count * first.size
    )
    hessian[:, first, second] = hessian[:, second, first] = sums.reshape(count, first.size)
    return hessian
