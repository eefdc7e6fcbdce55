"""The density that rare events are drawn from: a normal mixture around the failures found.

A proposal is a mixture of normal densities in standard normal space.  Its first component is the
nominal density itself, with at least ``NOMINAL_SHARE``: so no weight φ/q exceeds its inverse,
whatever the exploration missed.  Every other component comes twice: as wide as the failures it
describes, and nowhere narrower than the nominal density, so that its tails are heavy enough.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from harness.encounter import FloatArray

NOMINAL_SHARE = 0.1
"""Share of the draws that come from the nominal density."""

COMPONENTS = 8

_NARROWEST = 0.002
"""Least variance of a component in any direction; the nominal density has 1."""

_CORRELATION_PRIOR = 4.0
"""Points for each dimension that say that two uniforms are independent given the event."""

_DIVERGENCE = 0.1
"""Nats by which a uniform of the failures has to differ from a nominal one."""

_ITERATIONS = 20


@dataclass(frozen=True, slots=True)
class Proposal:
    """A normal mixture, the nominal density first.

    ``shares`` (k,), ``means`` (k, d), ``factors`` (k, d, d): lower Cholesky of the covariances.
    """

    shares: FloatArray
    means: FloatArray
    factors: FloatArray

    @property
    def dimensions(self) -> int:
        """d, the number of sampled uniforms."""
        return int(self.means.shape[1])

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Independent draws, shape (count, d)."""
        component = np.searchsorted(np.cumsum(self.shares), rng.random(count), side="right")
        component = np.minimum(component, len(self.shares) - 1)
        normal = rng.standard_normal((count, self.dimensions))
        drawn: FloatArray = self.means[component] + np.einsum(
            "nij,nj->ni", self.factors[component], normal
        )
        return drawn

    def log_weight(self, z: FloatArray) -> FloatArray:
        """ln φ(z)/q(z), shape (n,); at most −ln ``NOMINAL_SHARE``."""
        parts = self._log_parts(z)
        # The first component is φ; taken from the same sum, its weight alone is exactly 1.
        weight: FloatArray = parts[:, 0] - np.log(self.shares[0]) - logsumexp(parts, axis=1)
        return weight

    def _log_parts(self, z: FloatArray) -> FloatArray:
        """ln of share × density of every component, without (2π)^(−d/2), shape (n, k)."""
        inverse = np.linalg.inv(self.factors)
        parts = np.empty((len(z), len(self.shares)))
        for k, share in enumerate(self.shares):
            scaled = (z - self.means[k]) @ inverse[k].T
            volume = np.log(np.diag(self.factors[k])).sum()
            parts[:, k] = np.log(share) - volume - 0.5 * np.einsum("ij,ij->i", scaled, scaled)
        return parts


def nominal(dimensions: int) -> Proposal:
    """The nominal density alone: brute force."""
    return Proposal(np.ones(1), np.zeros((1, dimensions)), np.eye(dimensions)[None])


def fit_proposal(failures: FloatArray, weights: FloatArray, rng: np.random.Generator) -> Proposal:
    """A proposal around the failures found.

    The components get half of their shares evenly: a way to crash of which the exploration found
    few examples is drawn from as well.

    Args:
        failures: points of the event, shape (n, d), in standard normal space.
        weights: of the points, ≥ 0; equal where they are drawn from the nominal density given
            the event.
        rng: for the starts of the fit.
    """
    fitted = _fit_mixture(failures, weights / weights.sum(), COMPONENTS, rng)
    shares = (fitted.shares + 1 / COMPONENTS) / 2
    covariances = fitted.factors @ np.swapaxes(fitted.factors, 1, 2)
    wide = np.stack([_floored(covariance, 1.0) for covariance in covariances])
    close = np.stack([_floored(covariance, _NARROWEST) for covariance in covariances])
    identity = np.eye(failures.shape[1])[None]
    half = (1 - NOMINAL_SHARE) * shares / 2
    return Proposal(
        np.concatenate([[NOMINAL_SHARE], half, half]),
        np.concatenate([np.zeros((1, failures.shape[1])), fitted.means, fitted.means]),
        _cholesky(np.concatenate([identity, close, wide])),
    )


def _fit_mixture(
    points: FloatArray, weights: FloatArray, components: int, rng: np.random.Generator
) -> Proposal:
    """Expectation maximisation on weighted points; see ``_shrunk`` for the covariances."""
    dimensions = points.shape[1]
    effective = 1.0 / np.sum(weights**2)
    means = starts_of(points, weights, components, rng)
    responsibility = np.eye(components)[nearest_of(points, means)]
    for _ in range(_ITERATIONS):
        mass = responsibility * weights[:, None]
        shares = np.maximum(mass.sum(axis=0), 1e-12)
        means = (mass.T @ points) / shares[:, None]
        covariances: FloatArray = np.empty((components, dimensions, dimensions))
        for k in range(components):
            off = points - means[k]
            scatter = (off * (mass[:, k, None] / shares[k])).T @ off
            means[k], covariances[k] = _plain(
                means[k], _shrunk(scatter, float(shares[k] * effective))
            )
        shares = shares / shares.sum()
        mixture = Proposal(shares, means, _cholesky(covariances))
        log_parts = mixture._log_parts(points)
        updated = np.exp(log_parts - logsumexp(log_parts, axis=1, keepdims=True))
        if np.max(np.abs(updated - responsibility), initial=0.0) < 1e-4:
            break
        responsibility = updated
    return mixture


def starts_of(
    points: FloatArray, weights: FloatArray, components: int, rng: np.random.Generator
) -> FloatArray:
    """k-means++ starts: each next centre is drawn by its squared distance from those before."""
    chosen = [points[rng.choice(len(points), p=weights)]]
    for _ in range(components - 1):
        distance = np.min([((points - centre) ** 2).sum(axis=1) for centre in chosen], axis=0)
        mass = weights * distance
        total = mass.sum()
        chosen.append(points[rng.choice(len(points), p=mass / total if total > 0 else weights)])
    return np.array(chosen)


def _shrunk(scatter: FloatArray, count: float) -> FloatArray:
    """A covariance from few points: variances of their own, correlations drawn towards none.

    Two points more say that a variance is 1: a uniform that does not matter is nominal given the
    event.
    """
    variances = (count * np.diag(scatter) + 2.0) / (count + 2.0)
    root = np.sqrt(np.maximum(np.diag(scatter), 1e-12))
    correlations = scatter / np.outer(root, root)
    correlations *= count / (count + _CORRELATION_PRIOR * len(scatter))
    np.fill_diagonal(correlations, 1.0)
    scale = np.sqrt(np.maximum(variances, _NARROWEST))
    shrunk: FloatArray = correlations * np.outer(scale, scale)
    return shrunk


def _plain(mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nominal, and independent of the others, where a uniform hardly differs from that.

    It differs by its divergence from the nominal density, (m² + v − 1 − ln v)/2: below the limit
    it is taken for chance.
    """
    variances = np.diag(covariance)
    nominal_ones = (mean**2 + variances - 1 - np.log(variances)) / 2 < _DIVERGENCE
    covariance = np.where(nominal_ones[:, None] | nominal_ones[None, :], 0.0, covariance)
    covariance[nominal_ones, nominal_ones] = 1.0
    return np.where(nominal_ones, 0.0, mean), covariance


def nearest_of(points: FloatArray, centres: FloatArray) -> NDArray[np.intp]:
    """Which centre each point is nearest to, shape (n,)."""
    nearest: NDArray[np.intp] = np.argmin(
        ((points[:, None] - centres[None]) ** 2).sum(axis=2), axis=1
    ).astype(np.intp)
    return nearest


def _cholesky(covariances: FloatArray) -> FloatArray:
    return np.linalg.cholesky(covariances).astype(np.float64, copy=False)


def _floored(covariance: FloatArray, least: float) -> FloatArray:
    """The covariance with no variance below ``least`` in any direction."""
    values, directions = np.linalg.eigh(covariance)
    floored: FloatArray = (directions * np.maximum(values, least)) @ directions.T
    return floored
