"""Takes weighted states in the event and returns the proposal's components.

The fit is expectation maximisation (the cross-entropy method).
"""

from dataclasses import replace

import numpy as np

from harness.core.encounter import FloatArray
from harness.model.mixture.clusters import k_means
from harness.old.studies.risk.layout import Layout
from harness.old.studies.risk.proposal import NOMINAL_SHARE, Component, Proposal

COMPONENTS = 8
"""Maximum number of components."""

_POINTS = 20
"""Number of states per component."""

_NARROWEST = 1e-4
"""Smallest variance of a component in any direction; the nominal variance is 1."""

_VARIANCE_PRIOR = 2.0
"""The prior variance 1 weighs as much as this number of cases."""

_CORRELATION_PRIOR = 4.0
"""The prior correlation 0 weighs as much as this number of cases per dimension."""

_DIVERGENCE = 0.1
"""A uniform counts as nominal if its divergence in nats is below this."""

_ROUNDS = 20

_FEWEST = 2.0
"""A component with fewer effective cases is removed."""


def first_components(z: FloatArray, rng: np.random.Generator) -> tuple[Component, ...]:
    """Return the starting components, from clusters of states in the event.

    Args:
        z: states in the event, shape (n, d).
        rng: generator for the clusters.
    """
    parts = []
    count = min(COMPONENTS, 1 + len(z) // _POINTS)
    _, clusters = k_means(z, np.ones(len(z)), count, 1, rng)
    for k in np.unique(clusters):
        cluster = z[clusters == k]
        moments = cluster.mean(axis=0), np.atleast_2d(np.cov(cluster.T, bias=True))
        parts.append(_component(len(cluster) / len(z), *moments, len(cluster)))
    return tuple(parts)


def fit_components(
    components: tuple[Component, ...], z: FloatArray, weights: FloatArray
) -> tuple[Component, ...]:
    """Return the components fitted to weighted states in the event.

    Args:
        components: starting components.
        z: states in the event, shape (n, d).
        weights: weights of the states, ≥ 0; they are equal if the states are nominal draws.
    """
    weights = weights / weights.sum()
    for _ in range(_ROUNDS):
        terms = [
            (1 - NOMINAL_SHARE) * part.share * np.exp(part.log_ratio(z)) for part in components
        ]
        total = np.full(len(z), NOMINAL_SHARE)
        for term in terms:
            total += term
        updated = []
        for term in terms:
            responsible = term * (weights / total)
            mass = float(responsible.sum())
            squares = float(np.sum(responsible**2))
            effective = mass**2 / squares if squares > 0 else 0.0
            if effective < _FEWEST:
                continue
            share = responsible / mass
            mean = share @ z
            scatter = (z * share[:, None]).T @ z - np.outer(mean, mean)
            updated.append(_component(mass, mean, scatter, effective))
        if not updated:
            return components
        whole = sum(part.share for part in updated)
        components = tuple(replace(part, share=part.share / whole) for part in updated)
    return components


def spread(layout: Layout, components: tuple[Component, ...]) -> Proposal:
    """Return the proposal of fitted components, with a nominal part and heavier tails.

    Each component's share is the mean of its fitted share and an equal share, so that ways to the
    event with few explored cases are drawn too.  Each component occurs twice: once with its fitted
    covariance, and once with a variance of at least 1 in every direction.
    """
    parts = []
    whole = sum(part.share for part in components)
    for part in components:
        share = (1 - NOMINAL_SHARE) * (part.share / whole + 1 / len(components)) / 2
        covariance = part.factor @ part.factor.T
        wide = np.linalg.cholesky(_floored(covariance, 1.0))
        parts += [
            replace(part, share=share / 2),
            replace(part, share=share / 2, factor=wide.astype(np.float64, copy=False)),
        ]
    return Proposal(layout, tuple(parts))


def _component(share: float, mean: FloatArray, scatter: FloatArray, count: float) -> Component:
    """Return a component from the moments of ``count`` cases.

    Variances are shrunk towards 1 and correlations towards 0, more strongly for few cases.  A
    uniform with a divergence (m² + v − 1 − ln v)/2 below ``_DIVERGENCE`` from a nominal uniform
    becomes nominal and independent of the others.
    """
    raw = np.maximum(np.diag(scatter), 1e-12)
    correlations = scatter / np.sqrt(np.outer(raw, raw))
    correlations *= count / (count + _CORRELATION_PRIOR * len(mean))
    np.fill_diagonal(correlations, 1.0)
    variances = np.maximum(raw ** (count / (count + _VARIANCE_PRIOR)), _NARROWEST)
    is_nominal = (mean**2 + variances - 1 - np.log(variances)) / 2 < _DIVERGENCE
    covariance = correlations * np.sqrt(np.outer(variances, variances))
    covariance[is_nominal[:, None] | is_nominal[None, :]] = 0.0
    covariance[is_nominal, is_nominal] = 1.0
    factor = np.linalg.cholesky(_floored(covariance, _NARROWEST)).astype(np.float64, copy=False)
    return Component(share, np.where(is_nominal, 0.0, mean), factor)


def _floored(covariance: FloatArray, least: float) -> FloatArray:
    """Return the covariance with variances of at least ``least`` in every direction."""
    values, directions = np.linalg.eigh(covariance)
    floored: FloatArray = (directions * np.maximum(values, least)) @ directions.T
    return floored
