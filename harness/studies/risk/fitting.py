"""Fits a proposal on states in the event, by expectation maximisation.

Who of a crowd was placed is part of what is fitted: a component's responsibility for a case is
shared among its people.  It is the cross-entropy method with a hidden choice.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import FloatArray
from harness.model.mixture.clusters import k_means
from harness.studies.risk.layout import Layout
from harness.studies.risk.proposal import NOMINAL_SHARE, Cases, Component, Proposal

COMPONENTS = 8
"""At most so many, with and without a placed one each."""

_POINTS = 20
"""Cases that a component should rest on."""

_NARROWEST = 1e-4
"""Least variance of a component in any direction; the nominal density has 1."""

_VARIANCE_PRIOR = 2.0
"""Cases that say that a variance is 1."""

_CORRELATION_PRIOR = 4.0
"""Cases for each dimension that say that two uniforms are independent given the event."""

_DIVERGENCE = 0.1
"""Nats by which a uniform of the failures has to differ from a nominal one."""

_ROUNDS = 20

_FEWEST = 2.0
"""Effective cases below which a component is given up."""


def first_components(
    layout: Layout, cases: Cases, who: NDArray[np.intp], rng: np.random.Generator
) -> tuple[Component, ...]:
    """Components around cases in the event.

    Args:
        layout: of the states.
        cases: in the event.
        who: place of the one who matters in each case, −1 where nobody does, shape (n,).
        rng: for the starts.
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
        _, cluster_of = k_means(y, np.ones(len(y)), count, 1, rng)
        for k in np.unique(cluster_of):
            cluster = y[cluster_of == k]
            moments = cluster.mean(axis=0), np.atleast_2d(np.cov(cluster.T, bias=True))
            share = len(cluster) / len(who)
            parts.append(_component(layout, share, placed, *moments, len(cluster)))
    return tuple(parts)


def fit_components(
    layout: Layout, components: tuple[Component, ...], cases: Cases, weights: FloatArray
) -> tuple[Component, ...]:
    """Components fitted on weighted cases in the event, from components to start with.

    Args:
        layout: of the states.
        components: to begin with.
        cases: in the event.
        weights: of the cases, ≥ 0; equal where they are drawn from the nominal law given the event.
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
    """The proposal of fitted components: with a nominal part, even shares, and heavier tails.

    The components get half of their shares evenly: a way to the event of which the exploration
    found few examples is drawn from as well.  Each comes twice: as wide as the cases it describes,
    and wider.
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
    """A component from the moments of so many cases.

    Variances are drawn towards 1, correlations towards none: few states say little.  A uniform
    that differs little from a nominal one, by its divergence (m² + v − 1 − ln v)/2, is taken for
    nominal, and independent of the others.
    """
    raw = np.maximum(np.diag(scatter), 1e-12)
    correlations = scatter / np.sqrt(np.outer(raw, raw))
    correlations *= count / (count + _CORRELATION_PRIOR * len(mean))
    np.fill_diagonal(correlations, 1.0)
    variances = np.maximum(raw ** (count / (count + _VARIANCE_PRIOR)), _NARROWEST)
    plain = (mean**2 + variances - 1 - np.log(variances)) / 2 < _DIVERGENCE
    if placed:
        plain[layout.fixed] = False  # the time, which is not normal nominally
    covariance = correlations * np.sqrt(np.outer(variances, variances))
    covariance[plain[:, None] | plain[None, :]] = 0.0
    covariance[plain, plain] = 1.0
    factor = np.linalg.cholesky(_floored(covariance, _NARROWEST)).astype(np.float64, copy=False)
    return Component(share, placed, np.where(plain, 0.0, mean), factor)


def _floored(covariance: FloatArray, least: float) -> FloatArray:
    """The covariance with no variance below ``least`` in any direction."""
    values, directions = np.linalg.eigh(covariance)
    floored: FloatArray = (directions * np.maximum(values, least)) @ directions.T
    return floored
