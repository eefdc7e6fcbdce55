"""From what was explored to the proposal that the estimate is drawn from."""

import math

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import FloatArray
from harness.studies.risk.fitting import first_components, fit_components, spread
from harness.studies.risk.layout import Layout
from harness.studies.risk.outcomes import Counted, Evaluate
from harness.studies.risk.proposal import Cases, Draws, Proposal, cases_of, draws_from, nominal

_REFITS = 3
_POINTS_OF_REFIT = 2_000

_WORTH = 20.0
"""The states found are worth so many independent ones: many descend from the same few."""

_FITTED = 2_000
"""On so many of the states found the first proposal is fitted."""

_LOOKED_AT = 600
"""Where there is a crowd on so many: of each it is asked who matters."""

_FEWEST_EVENTS = 10
"""Effective events below which a batch says nothing about a proposal's worth."""

_ENOUGH_EVENTS = 200
"""Effective events that are enough for a refit."""


def refit(
    counted: Counted, layout: Layout, found: FloatArray, rough: float, rng: np.random.Generator
) -> tuple[Proposal, float]:
    """The proposal fitted on what was explored and on weighted draws of its own, or brute force.

    Brute force where it is as good, or where the draws of no proposal were worth ``_FEWEST_EVENTS``
    events.

    Returns:
        It, and the squared coefficient of variation of a single draw's contribution.
    """
    best, squared_cv, least = nominal(layout), 1 / rough - 1, math.inf
    cases, who = _explored(counted, layout, found, rng)
    components = first_components(layout, cases, who, rng)
    fitted, worths = [cases], [np.full(len(who), _WORTH / max(len(who), 1))]
    for round_ in range(_REFITS if components else 0):
        if round_ or not layout.marks:
            joint = np.concatenate(worths)
            components = fit_components(layout, components, _joined(fitted), joint)
        proposal, before = spread(layout, components), counted.episodes
        batches: list[Draws] = []
        weight, size = np.empty(0), 0.0
        # The later the round, the better the proposal, the more is drawn from it.
        while len(batches) <= round_ and size < _ENOUGH_EVENTS:
            batches.append(
                draws_from(proposal, counted, _POINTS_OF_REFIT, rng, "fitting the proposal")
            )
            weight = np.concatenate([weight, batches[-1].weight * batches[-1].event])
            size = _effective(weight)
        if size == 0:
            break
        if size >= _FEWEST_EVENTS:
            of_one = float(weight.var() / weight.mean() ** 2)
            cost = of_one * (counted.episodes - before) / len(weight)
            brute_force = 1 / min(float(weight.mean()), 1.0) - 1
            if cost < min(least, brute_force):
                best, squared_cv, least = proposal, of_one, cost
        fitted += [drawn.cases for drawn in batches]
        worths.append(size * weight[weight > 0] / weight.sum())
    return best, squared_cv


def _effective(weight: FloatArray) -> float:
    """(Σw)²/Σw², 0 where there is none."""
    squares = float(np.sum(weight**2))
    return float(weight.sum()) ** 2 / squares if squares else 0.0


def _explored(
    evaluate: Evaluate, layout: Layout, found: FloatArray, rng: np.random.Generator
) -> tuple[Cases, NDArray[np.intp]]:
    """Cases of states that the exploration found, and who of the crowd matters in each.

    It is the last to arrive of those without whom the event does not happen; −1: nobody.
    """
    found = found[rng.permutation(len(found))[: _LOOKED_AT if layout.marks else _FITTED]]
    if not layout.marks:
        return Cases(found, np.empty((len(found), 0, 0))), np.full(len(found), -1)
    outcomes = evaluate(found, "who matters")
    # What a state does not hold is drawn anew and may have mattered.
    event = outcomes.event
    found = found[event]
    cases, without = cases_of(layout, found, outcomes.where(event), evaluate)
    arrivals_s = np.where(without > 0, layout.arrivals_s(found), -np.inf)
    who = np.where(np.isfinite(arrivals_s).any(axis=1), arrivals_s.argmax(axis=1), -1)
    return cases, who


def _joined(cases: list[Cases]) -> Cases:
    return Cases(
        np.concatenate([part.fixed for part in cases]),
        np.concatenate([part.people for part in cases]),
    )
