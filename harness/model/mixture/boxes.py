"""Takes normal distributions of one to four variables and returns the probabilities of boxes.

One and two variables have closed forms (the normal distribution function and Owen's T). Three and
four variables use Plackett's identity: the derivative of the probability with respect to a
correlation is a bivariate density at the corners times the probability of the other variables. The
probability is then one integral along a path of correlation matrices. All functions are batched
over the leading axis.

Sources: Owen (1956); Plackett (1954); Gassmann, Deák, Szántai (2002).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, owens_t

Array = NDArray[np.float64]

# The tail beyond this standardised bound is below double precision.
FAR = 30.0
# Corners with a smaller weight change a probability by less than rounding.
_NEGLIGIBLE = 1e-17
# The Gauss-Legendre rule for correlations up to each limit, accurate to 1e-12. The last limit has
# no rule, because Owen's T is used there.
_RULES = (
    (0.3, np.polynomial.legendre.leggauss(5)),
    (0.6, np.polynomial.legendre.leggauss(8)),
    (0.85, np.polynomial.legendre.leggauss(12)),
    (np.inf, None),
)
# The number of Gauss-Legendre nodes for canonical correlations up to each limit. With these numbers
# boxes of three or four variables are accurate to 1e-11.
_PATH_LIMITS = np.array([0.2, 0.4, 0.6, 0.8, 0.9, 0.95])
_PATH_SIZES = np.array([4, 5, 7, 9, 11, 13, 24])
_PATH_STARTS = np.cumsum(_PATH_SIZES) - _PATH_SIZES
_PATH_NODES, _PATH_WEIGHTS = np.concatenate(
    [np.polynomial.legendre.leggauss(int(size)) for size in _PATH_SIZES], axis=1
)
# Number of boxes in a batch, which limits the memory.
_CHUNK = 2048
_TINY = 1e-30


def interval(a: Array, b: Array) -> Array:
    """Φ(b) − Φ(a) for standardised bounds a ≤ b of any shape, accurate in both tails."""
    # In the upper tail both values are near 1 and their difference loses its digits.
    flip = a > -b
    probability: Array = ndtr(np.where(flip, -a, b)) - ndtr(np.where(flip, -b, a))
    return probability


def rectangle(a1: Array, b1: Array, a2: Array, b2: Array, rho: Array) -> Array:
    """P(a1 < X < b1, a2 < Y < b2) for standard normals of correlation rho, all (N,).

    Weak correlations use Plackett's integral, which then needs few nodes; strong correlations use
    Owen's T. Bounds must be finite (cut at ±FAR).
    """
    result = np.empty(rho.shape)
    size = np.abs(rho)
    below = 0.0
    for limit, rule in _RULES:
        chosen = np.flatnonzero((size >= below) & (size < limit))
        if chosen.size:
            edges = a1[chosen], b1[chosen], a2[chosen], b2[chosen], rho[chosen]
            result[chosen] = _owen(*edges) if rule is None else _weak(*edges, *rule)
        below = limit
    return np.maximum(result, 0.0, out=result)


def _weak(
    a1: Array, b1: Array, a2: Array, b2: Array, rho: Array, nodes: Array, weights: Array
) -> Array:
    """Product of the intervals plus Plackett's integral over correlations from 0 to rho = sin θ."""
    angle = np.arcsin(rho)
    sine = np.sin(0.5 * angle * (nodes + 1.0)[:, None])
    inverse = 0.5 / (1.0 - sine * sine)
    total = np.zeros_like(sine)
    for h, k, sign in ((b1, b2, 1.0), (a1, b2, -1.0), (b1, a2, -1.0), (a1, a2, 1.0)):
        exponent = (2.0 * h * k) * sine
        exponent -= h * h + k * k
        exponent *= inverse
        np.exp(exponent, out=exponent)
        total = total + exponent if sign > 0 else total - exponent
    change = (total * weights[:, None]).sum(axis=0) * angle / (4.0 * np.pi)
    result: Array = interval(a1, b1) * interval(a2, b2) + change
    return result


def _owen(a1: Array, b1: Array, a2: Array, b2: Array, rho: Array) -> Array:
    """Signed sum of Owen's T at the four corners; the univariate terms cancel."""
    root = np.sqrt(1.0 - rho * rho)
    upper = _corner(b1, b2, rho, root) - _corner(a1, b2, rho, root)
    return upper - _corner(b1, a2, rho, root) + _corner(a1, a2, rho, root)


def _corner(h: Array, k: Array, rho: Array, root: Array) -> Array:
    """Φ2(h, k; rho) − (Φ(h) + Φ(k))/2, from Owen (1956)."""
    # Owen's formula divides by h and k, so a bound of 0 is replaced by a negligible number.
    h = np.where(h == 0.0, _TINY, h)
    k = np.where(k == 0.0, _TINY, k)
    ratio = k / h
    parts = owens_t(h, (ratio - rho) / root) + owens_t(k, (1.0 / ratio - rho) / root)
    corner: Array = -parts - 0.5 * (ratio < 0.0)
    return corner


def box_probability(covariances: Array, lower: Array, upper: Array) -> Array:
    """Probability that a centred normal vector lies in a box.

    Args:
        covariances: (N, d, d), d from 0 to 4, positive definite.
        lower, upper: (N, d), relative to the centre; may be infinite.

    Returns:
        (N,) in [0, 1]. The absolute error is at most about 1e-9 at condition numbers up to 100.
        Small probabilities have few correct digits if d ≥ 2.
    """
    spread = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    a = np.clip(lower / spread, -FAR, FAR)
    b = np.clip(upper / spread, -FAR, FAR)
    correlations = covariances / (spread[:, :, None] * spread[:, None, :])
    return standard_box(correlations, a, b)


def standard_box(correlations: Array, a: Array, b: Array) -> Array:
    """`box_probability` for unit variances and bounds already cut at ±FAR."""
    dimension = a.shape[1]
    if dimension == 0:
        return np.ones(a.shape[0])
    if dimension == 1:
        return interval(a[:, 0], b[:, 0])
    if dimension == 2:
        return rectangle(a[:, 0], b[:, 0], a[:, 1], b[:, 1], correlations[:, 0, 1])
    return np.clip(_by_paths(*_ordered(correlations, a, b)), 0.0, 1.0)


def _by_paths(correlations: Array, a: Array, b: Array) -> Array:
    """Probabilities of boxes of three or four variables; each path has its own number of nodes."""
    parts = []
    for at in range(0, a.shape[0], _CHUNK):
        part = correlations[at : at + _CHUNK], a[at : at + _CHUNK], b[at : at + _CHUNK]
        parts.append(_plackett(*part, *_path(_largest_canonical(part[0]))))
    return np.concatenate(parts) if parts else np.empty(0)


def _ordered(correlations: Array, a: Array, b: Array) -> tuple[Array, Array, Array]:
    """The same boxes, with variables permuted so that the correlations between blocks are least."""
    if a.shape[1] == 3:
        orders = np.array([[0, 1, 2], [0, 2, 1], [1, 2, 0]])
    else:
        orders = np.array([[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2]])
    squares = correlations**2
    kept = squares[:, orders[:, 0], orders[:, 1]]
    if a.shape[1] == 4:
        kept = kept + squares[:, orders[:, 2], orders[:, 3]]
    order = orders[np.argmax(kept, axis=1)]
    rows = np.arange(a.shape[0])[:, None]
    permuted = correlations[rows[:, :, None], order[:, :, None], order[:, None, :]]
    return permuted, a[rows, order], b[rows, order]


def _largest_canonical(correlations: Array) -> Array:
    """Largest canonical correlation (N,) between the two blocks, strictly between 0 and 1."""
    cross = correlations[:, :2, 2:]
    first = np.linalg.solve(correlations[:, :2, :2], cross).astype(np.float64)
    second = np.linalg.solve(correlations[:, 2:, 2:], np.swapaxes(cross, 1, 2)).astype(np.float64)
    size = cross.shape[2]
    products = [first[:, i, j] * second[:, j, i] for i in range(2) for j in range(size)]
    half_trace = 0.5 * np.sum(products, axis=0)
    determinant = np.zeros(half_trace.shape)
    if size == 2:
        determinant = _determinant(first) * _determinant(second)
    largest = half_trace + np.sqrt(np.maximum(half_trace**2 - determinant, 0.0))
    result: Array = np.sqrt(np.clip(largest, 1e-12, 1.0 - 1e-14))
    return result


def _determinant(matrices: Array) -> Array:
    result: Array = matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]
    return result


def _path(canonical: Array) -> tuple[NDArray[np.intp], Array, Array]:
    """Index of the box, position t in [0, 1] and weight of every node of the joining paths.

    The integrand is singular at t = 1/c, where c is the largest canonical correlation of the two
    blocks.  The substitution t = sin(θ)/c removes the singularity, as r = sin(θ) does for two
    variables.
    """
    rule = np.searchsorted(_PATH_LIMITS, canonical, side="right")
    sizes = _PATH_SIZES[rule]
    box = np.repeat(np.arange(canonical.size), sizes)
    within = np.arange(box.size) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    node = _PATH_STARTS[rule][box] + within
    scale = canonical[box]
    angle = 0.5 * np.arcsin(scale)
    theta = angle * (_PATH_NODES[node] + 1.0)
    return box, np.sin(theta) / scale, angle * _PATH_WEIGHTS[node] * np.cos(theta) / scale


def _plackett(
    correlations: Array,
    a: Array,
    b: Array,
    box: NDArray[np.intp],
    t: Array,
    weights: Array,
) -> Array:
    """Probability of the blocks (1, 2) and (3) or (3, 4): product plus integral over the path.

    The integral has a term for every pair (i, j) across the blocks, every corner of i and j, and
    every node.  A term is the bivariate density at the corner times the probability of the other
    variables given the corner.
    """
    dimension = a.shape[1]
    total = standard_box(correlations[:, :2, :2], a[:, :2], b[:, :2]) * standard_box(
        correlations[:, 2:, 2:], a[:, 2:], b[:, 2:]
    )
    i, j = (at.ravel() for at in np.meshgrid([0, 1], range(2, dimension), indexing="ij"))
    others = [1 - i] if dimension == 3 else [1 - i, 5 - j]
    # The first axes are the variables, the last axis is the nodes.
    along = np.ascontiguousarray(np.moveaxis(correlations, 0, 2)[:, :, box])
    edges = np.ascontiguousarray(np.stack((a.T, b.T), axis=1)[:, :, box])
    factor = _joining(along, edges, t, weights, i, j)
    pair, at_i, at_j, node = np.unravel_index(
        np.flatnonzero(np.abs(factor) > _NEGLIGIBLE), factor.shape
    )
    on_i, on_j, spreads, rho = _given_pair(along, t, i, j, others)
    corner = edges[i[pair], at_i, node], edges[j[pair], at_j, node]
    bounds = []
    for k, other in enumerate(others):
        centre = on_i[k][pair, node] * corner[0] + on_j[k][pair, node] * corner[1]
        scale = spreads[k][pair, node]
        for side in range(2):
            bound = (edges[other[pair], side, node] - centre) / scale
            bounds.append(np.clip(bound, -FAR, FAR))
    if dimension == 3:
        inner = interval(bounds[0], bounds[1])
    else:
        inner = rectangle(bounds[0], bounds[1], bounds[2], bounds[3], rho[pair, node])
    terms = factor[pair, at_i, at_j, node] * inner
    result: Array = total + np.bincount(box[node], terms, minlength=a.shape[0])
    return result


def _joining(
    along: Array,
    edges: Array,
    t: Array,
    weights: Array,
    i: NDArray[np.intp],
    j: NDArray[np.intp],
) -> Array:
    """Weight times signed density of each pair (i, j) at each corner, (pairs, 2, 2, nodes)."""
    full = along[i, j]
    r = (full * t)[:, None, None, :]
    rest = 1.0 - r * r
    x, y = edges[i][:, :, None, :], edges[j][:, None, :, :]
    density = np.exp(-0.5 * (x * x - 2.0 * r * x * y + y * y) / rest)
    sign = np.array([[1.0, -1.0], [-1.0, 1.0]])[None, :, :, None]
    factor: Array = sign * density * ((full * weights)[:, None, None, :] / np.sqrt(rest))
    return factor / (2.0 * np.pi)


def _given_pair(
    along: Array,
    t: Array,
    i: NDArray[np.intp],
    j: NDArray[np.intp],
    others: list[NDArray[np.intp]],
) -> tuple[list[Array], list[Array], list[Array], Array]:
    """Regression of the other variables on each pair (i, j) along the path, all (pairs, nodes).

    Returns:
        Slopes on i, slopes on j and residual spreads, one array for each other variable, and the
        residual correlation of two other variables.
    """
    r = along[i, j] * t
    rest = 1.0 - r * r
    # The first other variable is in the block of i, the second in the block of j.
    with_i = [along[p, i] * t if at else along[p, i] for at, p in enumerate(others)]
    with_j = [along[p, j] if at else along[p, j] * t for at, p in enumerate(others)]
    on_i = [(u - r * v) / rest for u, v in zip(with_i, with_j, strict=True)]
    on_j = [(v - r * u) / rest for u, v in zip(with_i, with_j, strict=True)]
    variances = [1.0 - on_i[at] * with_i[at] - on_j[at] * with_j[at] for at in range(len(others))]
    spreads = [np.sqrt(np.maximum(variance, 1e-14)) for variance in variances]
    rho = r
    if len(others) == 2:
        rho = along[others[0], others[1]] * t
        rho = (rho - on_i[0] * with_i[1] - on_j[0] * with_j[1]) / (spreads[0] * spreads[1])
        rho = np.clip(rho, -1.0 + 1e-14, 1.0 - 1e-14)
    return on_i, on_j, spreads, rho
