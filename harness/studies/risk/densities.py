"""A mixture of normal densities that is fitted to weighted points, and can be conditioned."""

import math
from typing import NamedTuple

import numpy as np

from harness.core.freezing import frozen
from harness.core.vocabulary import BoolArray, FloatArray
from harness.model.mixture.normals import NARROWEST, Normals, clustered_normals

_POINTS, _MOST = 15, 24
"""Number of points per component, or four for each dimension if that is more; and the most
components."""

_DIVERGENCE = 0.1
"""A number counts as nominal if its divergence in nats from a standard normal one is below this."""

_WIDER, _WIDE_SHARE = 3.0, 0.3
"""The second copy of each component has this multiple of its standard deviations, and this share
of it."""

_UNLIKELY = -30.0
"""Logarithm of a share below which a component is not distinguished from the others."""


class NormalMixture(Normals):
    """A mixture of normal densities that can be conditioned."""

    __slots__ = ()

    def given(self, known: FloatArray) -> "GivenDensity":
        """The densities of the other numbers given the first ones, ``known`` (n, c).

        A point far from every component chooses among them as if they were equally far.
        """
        size, logs, means, factors = known.shape[1], [], [], []
        for share, mean, covariance in zip(*self, strict=True):
            upper, cross = covariance[:size, :size], covariance[size:, :size]
            slope = cross @ np.linalg.inv(upper)
            logs.append(np.log(share) + _log_normal(known - mean[:size], upper))
            means.append(mean[size:] + (known - mean[:size]) @ slope.T)
            factors.append(np.linalg.cholesky(covariance[size:, size:] - slope @ cross.T))
        together = np.logaddexp(np.array(logs).T, _UNLIKELY)
        chances = np.exp(together - together.max(axis=1, keepdims=True))
        chances /= chances.sum(axis=1, keepdims=True)
        return GivenDensity(*frozen((chances, np.array(means), np.array(factors))))

    def mixed_with(self, other: Normals, share: float) -> "NormalMixture":
        """A mixture in which the other one has a share."""
        weights = np.concatenate([(1 - share) * self.weights, share * other.weights])
        parts = (np.concatenate(both) for both in zip(self[1:], other[1:], strict=True))
        return NormalMixture(*map(frozen, (weights, *parts)))


class GivenDensity(NamedTuple):
    """Mixtures of k normal densities, one mixture for each of n points.

    ``chances`` (n, k), ``means`` (k, n, d) and the covariances' Cholesky factors ``factors``
    (k, d, d).
    """

    chances: FloatArray
    means: FloatArray
    factors: FloatArray

    def points(self, uniform: FloatArray, noise: FloatArray) -> FloatArray:
        """One point of each mixture, (n, d), from uniforms (n,) and normal noise (n, d)."""
        ends = np.cumsum(self.chances, axis=1)
        chosen = (ends < uniform[:, None]).sum(axis=1).clip(max=len(self.factors) - 1)
        spread = np.einsum("nij,nj->ni", self.factors[chosen], noise)
        return np.asarray(self.means[chosen, np.arange(len(chosen))] + spread)

    def density(self, y: FloatArray) -> FloatArray:
        """The density of each mixture at its point of y (n, d), shape (n,)."""
        total = np.zeros(len(y))
        for chance, mean, factor in zip(self.chances.T, self.means, self.factors, strict=True):
            total += chance * np.exp(_log_normal(y - mean, factor @ factor.T))
        return total


def fitted(
    y: FloatArray, weights: FloatArray, standard: BoolArray, rng: np.random.Generator
) -> NormalMixture:
    """A mixture fitted to weighted points around the clusters of k-means.

    A number whose nominal density is standard normal, and which is nearly so among the points too,
    becomes standard normal and independent of the others in every component: otherwise numbers
    without influence would make the weights of draws collapse.  Of every component there is a wider
    copy, which keeps large weights rare.

    Args:
        y: the points, (n, d), n ≥ 1.
        weights: their weights, (n,), > 0.
        standard: whose nominal density is standard normal, (d,).
        rng: generator for the clusters.
    """
    size, share = y.shape[1], weights / weights.sum()
    mean = share @ y
    variances = share @ (y - mean) ** 2 + NARROWEST
    free = standard & ((mean**2 + variances - 1 - np.log(variances)) / 2 < _DIVERGENCE)
    if free.all():
        return NormalMixture(*frozen((np.ones(1), np.zeros((1, size)), np.eye(size)[None])))
    used = np.flatnonzero(~free)
    count = min(_MOST, 1 + len(y) // max(_POINTS, 4 * used.size))
    near = clustered_normals(y[:, used], weights, count, rng)
    near = Normals(*(frozen(part[near.weights > 0]) for part in near))
    locations = np.zeros((2 * len(near.weights), size))
    locations[:, used] = np.tile(near.locations, (2, 1))
    scales = np.tile(np.eye(size), (2 * len(near.weights), 1, 1))
    scales[:, used[:, None], used] = np.concatenate([near.scales, _WIDER**2 * near.scales])
    both = np.concatenate([(1 - _WIDE_SHARE) * near.weights, _WIDE_SHARE * near.weights])
    return NormalMixture(*frozen((both, locations, scales)))


def standard_normal(z: FloatArray) -> FloatArray:
    """The standard normal density at z (n, d), shape (n,)."""
    return np.exp(_log_normal(z, np.eye(z.shape[1])))


def _log_normal(away: FloatArray, covariance: FloatArray) -> FloatArray:
    """The logarithm of a normal density at a distance ``away`` (n, d) from its mean."""
    scaled = away @ np.linalg.inv(np.linalg.cholesky(covariance)).T
    log = -np.einsum("ij,ij->i", scaled, scaled) / 2 - np.linalg.slogdet(covariance)[1] / 2
    return np.asarray(log - away.shape[1] * math.log(2 * math.pi) / 2)
