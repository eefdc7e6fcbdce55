"""Fits the proposal of the estimate to explored states in the event."""

import math

import numpy as np

from harness.core.encounter import FloatArray
from harness.old.studies.risk.fitting import first_components, fit_components, spread
from harness.old.studies.risk.layout import Layout
from harness.old.studies.risk.outcomes import Counted
from harness.old.studies.risk.proposal import Draws, Proposal, draws_from, nominal

_REFITS = 3
_POINTS_OF_REFIT = 2_000

_WORTH = 20.0
"""Effective number of explored states.  Many of them descend from the same few states."""

_FITTED = 2_000
"""Maximum number of explored states for the first fit."""

_FEWEST_EVENTS = 10
"""A batch with fewer effective events cannot compare a proposal with brute force."""

_ENOUGH_EVENTS = 200
"""Effective number of events at which a refit draws no further batch."""


def refit(
    counted: Counted,
    layout: Layout,
    explored: FloatArray,
    probability: float,
    rng: np.random.Generator,
) -> tuple[Proposal, float]:
    """Fit a proposal to explored states and to weighted draws of earlier proposals.

    The result is brute force if no proposal is better, or if every proposal's draws had fewer than
    ``_FEWEST_EVENTS`` effective events.

    Args:
        counted: runs and counts episodes.
        layout: layout of the states.
        explored: states in the event, shape (n, width).
        probability: the exploration's estimate of the event's probability.
        rng: generator for all draws.

    Returns:
        The proposal, and the squared coefficient of variation of one draw's contribution.
    """
    best, squared_cv, lowest_cost = nominal(layout), 1 / probability - 1, math.inf
    explored = explored[rng.permutation(len(explored))[:_FITTED]]
    components = first_components(explored, rng)
    fitted, worths = [explored], [np.full(len(explored), _WORTH / len(explored))]
    for round_ in range(_REFITS):
        joint = np.concatenate(worths)
        components = fit_components(components, np.concatenate(fitted), joint)
        proposal, before = spread(layout, components), counted.episodes
        batches: list[Draws] = []
        weight, size = np.empty(0), 0.0
        # Later proposals are better, so later rounds may draw more batches.
        while len(batches) <= round_ and size < _ENOUGH_EVENTS:
            batches.append(
                draws_from(proposal, counted, _POINTS_OF_REFIT, rng, "fitting the proposal")
            )
            weight = np.concatenate([weight, batches[-1].weight * batches[-1].event])
            size = _effective(weight)
        if size == 0:
            break
        if size >= _FEWEST_EVENTS:
            draw_squared_cv = float(weight.var() / weight.mean() ** 2)
            cost = draw_squared_cv * (counted.episodes - before) / len(weight)
            brute_force_cost = 1 / min(float(weight.mean()), 1.0) - 1
            if cost < min(lowest_cost, brute_force_cost):
                best, squared_cv, lowest_cost = proposal, draw_squared_cv, cost
        fitted += [drawn.z[drawn.event] for drawn in batches]
        worths.append(size * weight[weight > 0] / weight.sum())
    return best, squared_cv


def _effective(weight: FloatArray) -> float:
    """Return Kish's effective number, (Σw)²/Σw²; 0 if all weights are 0."""
    squares = float(np.sum(weight**2))
    return float(weight.sum()) ** 2 / squares if squares else 0.0
