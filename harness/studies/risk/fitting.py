"""Takes weighted states in the event and returns the proposal's components.

The fit is expectation maximisation.  The index of a crowd's placed pedestrian is a latent variable,
so a component's responsibility for a case is divided among the case's pedestrians.  This is the
cross-entropy method with a latent variable.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import FloatArray
from harness.model.mixture.clusters import k_means
from harness.studies.risk.layout import Layout
from harness.studies.risk.proposal import NOMINAL_SHARE, Cases, Component, Proposal

COMPONENTS = 8
"""Maximum number of components with a placed pedestrian, and of components without one."""

_POINTS = 20
"""Number of cases per component."""

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


def first_components(
    layout: Layout, cases: Cases, who: NDArray[np.intp], rng: np.random.Generator
) -> tuple[Component, ...]:
    """Return the starting components, from clusters of cases in the event.

    Args:
        layout: layout of the states.
        cases: cases in the event.
        who: place of each case's decisive pedestrian, shape (n,); −1 if there is none.
        rng: generator for the clusters.
    """
    parts = []
    for placed in (False, True):
        rows = np.flatnonzero((who >= 0) == placed)
        y = cases.fixed[rows]
        if placed:
            y = np.concatenate([y, cases.people[rows, who[rows]]], axis=1)
        y = y[~np.isnan(y).any(axis=1)]
        if y.size == 0:
            continue
        count = min(COMPONENTS, 1 + len(y) // _POINTS)
        _, clusters = k_means(y, np.ones(len(y)), count, 1, rng)
        for k in np.unique(clusters):
            cluster = y[clusters == k]
            moments = cluster.mean(axis=0), np.atleast_2d(np.cov(cluster.T, bias=True))
            share = len(cluster) / len(who)
            parts.append(_component(layout, share, placed, *moments, len(cluster)))
    return tuple(parts)


def fit_components(
    layout: Layout, components: tuple[Component, ...], cases: Cases, weights: FloatArray
) -> tuple[Component, ...]:
    """Return the components fitted to weighted cases in the event.

    Args:
        layout: layout of the states.
        components: starting components.
        cases: cases in the event.
        weights: weights of the cases, ≥ 0; they are equal if the cases are nominal draws.
    """
    weights = weights / weights.sum()
    count = len(weights)
    points = {part.placed: cases.points(placed=part.placed) for part in components}
    for _ in range(_ROUNDS):
        terms = [
            (1 - NOMINAL_SHARE) * part.share * np.exp(part.log_ratio(layout, points[part.placed].y))
            for part in components
        ]
        total = np.full(count, NOMINAL_SHARE)
        for part, term in zip(components, terms, strict=True):
            total += np.bincount(points[part.placed].case, term, count)
        updated = []
        for part, term in zip(components, terms, strict=True):
            y, case = points[part.placed]
            responsible = term * (weights / total)[case]
            mass = float(responsible.sum())
            squares = float(np.sum(np.bincount(case, responsible, count) ** 2))
            effective = mass**2 / squares if squares > 0 else 0.0
            if effective < _FEWEST:
                continue
            share = responsible / mass
            mean = share @ y
            scatter = (y * share[:, None]).T @ y - np.outer(mean, mean)
            updated.append(_component(layout, mass, part.placed, mean, scatter, effective))
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


def _component(
    layout: Layout,
    share: float,
    placed: bool,
    mean: FloatArray,
    scatter: FloatArray,
    count: float,
) -> Component:
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
    if placed:
        is_nominal[layout.fixed] = False  # the arrival, whose nominal density is not normal
    covariance = correlations * np.sqrt(np.outer(variances, variances))
    covariance[is_nominal[:, None] | is_nominal[None, :]] = 0.0
    covariance[is_nominal, is_nominal] = 1.0
    factor = np.linalg.cholesky(_floored(covariance, _NARROWEST)).astype(np.float64, copy=False)
    return Component(share, placed, np.where(is_nominal, 0.0, mean), factor)


def _floored(covariance: FloatArray, least: float) -> FloatArray:
    """Return the covariance with variances of at least ``least`` in every direction."""
    values, directions = np.linalg.eigh(covariance)
    floored: FloatArray = (directions * np.maximum(values, least)) @ directions.T
    return floored
