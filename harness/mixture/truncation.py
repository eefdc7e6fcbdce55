"""Mass and first two moments of normal distributions truncated to a box, batched.

With α(m) the mass inside the box as a function of the location, the moments are derivatives of
log α: E = m + S ∇log α and V = S + S (∇² log α) S. The derivatives are probabilities on the faces
and edges of the box. Sources: Tallis (1961); Manjunath and Wilhelm (2012), eqs. (11) and (16).
"""

import numpy as np
from numpy.typing import NDArray

from harness.mixture.boxes import FAR, box_probability, interval, standard_box

Array = NDArray[np.float64]

# Below this the closed forms have lost their digits to cancellation; a sum of positive terms has
# not, at many times the cost.
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
        (K,) in [0, 1]; absolute error below 1e-8 at condition numbers up to 100. Masses down to
        about 1e-100 keep a few digits; beyond that the answer may be 0.
    """
    correlations, a, b, _ = _standardised(locations, scale_matrices, lower, upper)
    return _masses(correlations, a, b)


def moments(
    locations: Array, scale_matrices: Array, lower: Array, upper: Array
) -> tuple[Array, Array, Array]:
    """Masses (K,), means (K, d) and covariances (K, d, d) of the truncated components.

    Arguments as for `masses`. Means and covariances are right to 1e-7 of the component's spread
    at condition numbers up to 100; undefined (nan) where the mass is 0.
    """
    correlations, a, b, spread = _standardised(locations, scale_matrices, lower, upper)
    mass = _masses(correlations, a, b)
    gradient, hessian = _derivatives(correlations, a, b)
    with np.errstate(divide="ignore", invalid="ignore"):
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
    """Closed forms, and sums of positive terms where those are too small to trust."""
    mass = standard_box(correlations, a, b)
    if a.shape[1] > 1:
        for k in np.flatnonzero(mass < _SMALL):
            mass[k] = _positive_mass(correlations[k], a[k], b[k])
    return mass


def _positive_mass(covariance: Array, a: Array, b: Array) -> float:
    """Mass of a small box: variables integrated one by one, every term positive."""
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
    """Nodes and weights (N, M) for φ over [lo, hi], cut where φ has fallen by e^-40."""
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
    """φ at both bounds of each variable times the probability of the others there, (K, d, 2)."""
    dimension = a.shape[1]
    result: Array = np.exp(-0.5 * edges * edges) / np.sqrt(2.0 * np.pi)
    parts = []
    for i in range(dimension):
        others = [p for p in range(dimension) if p != i]
        slopes = correlations[:, others, i]
        rest = correlations[:, others][:, :, others] - slopes[:, :, None] * slopes[:, None, :]
        k, side = np.nonzero(result[:, i] > _NEGLIGIBLE)
        centre = slopes[k] * edges[k, i, side][:, None]
        parts.append((rest[k], a[k][:, others] - centre, b[k][:, others] - centre))
    inside = box_probability(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    at = 0
    for i in range(dimension):
        k, side = np.nonzero(result[:, i] > _NEGLIGIBLE)
        result[k, i, side] *= inside[at : at + k.size]
        at += k.size
    return result


def _corners(correlations: Array, a: Array, b: Array, edges: Array) -> Array:
    """Signed sums over the four corners of each pair of variables, (K, d, d), 0 on the diagonal."""
    count, dimension = a.shape
    hessian = np.zeros((count, dimension, dimension))
    parts, owners = [], []
    for i in range(dimension):
        for j in range(i + 1, dimension):
            k, weights, box = _corner_boxes(correlations, a, b, edges, i, j)
            parts.append(box)
            owners.append((i, j, k, weights))
    if parts:
        inside = box_probability(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    at = 0
    for i, j, k, weights in owners:
        terms = weights * inside[at : at + k.size]
        hessian[:, i, j] = hessian[:, j, i] = np.bincount(k, terms, minlength=count)
        at += k.size
    return hessian


def _corner_boxes(
    correlations: Array, a: Array, b: Array, edges: Array, i: int, j: int
) -> tuple[NDArray[np.intp], Array, tuple[Array, Array, Array]]:
    """For each corner of i and j that counts: component, signed density, box of the others."""
    others = [p for p in range(a.shape[1]) if p not in (i, j)]
    r = correlations[:, i, j, None, None]
    x, y = edges[:, i, :, None], edges[:, j, None, :]
    rest = 1.0 - r * r
    density = np.exp(-0.5 * (x * x - 2.0 * r * x * y + y * y) / rest)
    density = density * np.array([[1.0, -1.0], [-1.0, 1.0]]) / (2.0 * np.pi * np.sqrt(rest))
    k, p, q = np.nonzero(np.abs(density) > _NEGLIGIBLE)
    pair = correlations[:, [[i], [j]], [i, j]]
    cross = correlations[:, others][:, :, [i, j]]
    slopes = np.swapaxes(np.linalg.solve(pair, np.swapaxes(cross, 1, 2)), 1, 2)
    conditional = correlations[:, others][:, :, others] - slopes @ np.swapaxes(cross, 1, 2)
    corner = np.stack((edges[k, i, p], edges[k, j, q]), axis=1)
    centre = np.einsum("kij,kj->ki", slopes[k], corner)
    box = (conditional[k], a[k][:, others] - centre, b[k][:, others] - centre)
    return k, density[k, p, q], box
