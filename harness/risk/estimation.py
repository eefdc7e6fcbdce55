"""Stage two: the probability of the event, by importance sampling with independent draws.

p = E_q[1_F φ/q] for any density q that is positive where φ is (Owen, Monte Carlo theory, methods
and examples, ch. 9).  The draws are independent, their number is fixed before the first of them,
and nothing that the proposal was fitted on is counted.  So the estimate is unbiased whatever the
exploration missed.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from threadpoolctl import threadpool_limits

from harness.encounter import FloatArray
from harness.risk.exploring import LEVEL_SHARE, POINTS, Evaluate, Exploration, explore
from harness.risk.proposal import NOMINAL_SHARE, Proposal, fit_proposal, nominal

CONFIDENCE = 0.95

EXPLORATIONS = 3
"""Independent explorations: one alone now and then loses a way to the event."""

_REFITS = 3
_POINTS_OF_REFIT = 2_000

_FEWEST_EVENTS = 10
"""Effective events below which a batch says nothing about a proposal's worth."""

_LEAST_DRAWS = 2_000

_RESERVE = 2.5
"""More draws than the refits say are needed: weights found late are the large ones."""

_SMALL_SAMPLE = 30
"""An effective sample size below this makes no trustworthy interval."""

_LARGE_SHARE = 0.1
"""One weight, or the nominal draws together, should not hold more of the estimate."""

_CHECK_TAIL = 0.001
"""A brute-force check as unlikely as this disagrees."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A probability with its two-sided interval; None where no draw was in the event.

    Then ``ci_high`` is the one-sided bound of as many nominal draws.

    ``effective_sample_size`` is (Σw)²/Σw² over the draws in the event; ``largest_share`` the
    largest weight's part of the estimate, None where there is none.
    """

    probability: float | None
    coefficient_of_variation: float | None
    ci_low: float
    ci_high: float
    effective_sample_size: float
    largest_share: float | None
    draws: int
    events: int


@dataclass(frozen=True, slots=True)
class Findings:
    """The estimate and how it came about.

    ``z`` (n, d), ``weights`` (n,) and ``draws`` (n,), their places among the last draws, are those
    of the last draws that were in the event.  ``first_draw`` is the number of episodes before them,
    ``failed_weight`` the probability that failed episodes would add if all were in the event.
    """

    estimate: Estimate
    explorations: tuple[Exploration, ...]
    proposal: Proposal
    z: FloatArray
    weights: FloatArray
    draws: NDArray[np.intp]
    first_draw: int
    failed_weight: float
    warnings: tuple[str, ...]


class _Counted:
    """Counts the episodes of an evaluation."""

    def __init__(self, evaluate: Evaluate) -> None:
        self._evaluate = evaluate
        self.episodes = 0

    def __call__(self, z: FloatArray, what: str) -> FloatArray:
        self.episodes += len(z)
        return self._evaluate(z, what)


def estimate_probability(
    evaluate: Evaluate,
    dimensions: int,
    rng: np.random.Generator,
    target_cv: float = 0.1,
    most_draws: int = 200_000,
) -> Findings:
    """Explore, fit a proposal, estimate.

    Args:
        evaluate: runs episodes.
        dimensions: d, the number of sampled uniforms.
        rng: draws everything.
        target_cv: wanted coefficient of variation of the estimate.
        most_draws: bound on the draws of the last stage.
    """
    # Small matrices are slower on several threads, and their last bits depend on the number.
    with threadpool_limits(1, user_api="blas"):
        return _estimate(_Counted(evaluate), dimensions, rng, target_cv, most_draws)


def _estimate(
    counted: _Counted,
    dimensions: int,
    rng: np.random.Generator,
    target_cv: float,
    most_draws: int,
) -> Findings:
    explorations = [explore(counted, dimensions, rng)]
    common = explorations[0].nominal_events >= LEVEL_SHARE * POINTS
    if not common:
        explorations += [explore(counted, dimensions, rng, n) for n in range(1, EXPLORATIONS)]
    found = np.concatenate([exploration.failures for exploration in explorations])
    if common:
        share = explorations[0].nominal_events / POINTS
        proposal, squared_cv = nominal(dimensions), (1 - share) / share
    elif len(found):
        rough = float(np.mean([exploration.rough for exploration in explorations]))
        proposal, squared_cv = _refit(counted, found, rough, rng)
    else:
        # Nothing is known of where the event might be: more nominal draws only bound it.
        proposal, squared_cv = nominal(dimensions), 0.0
    wanted = math.ceil(_RESERVE * squared_cv / target_cv**2)
    draws = min(max(wanted, _LEAST_DRAWS), most_draws)
    first_draw = counted.episodes
    z = proposal.draw(draws, rng)
    score = counted(z, "estimating")[:, 0]
    event, lost = score <= 0, np.isnan(score)
    weight = np.exp(proposal.log_weight(z))
    estimate = estimate_of(weight, event)
    if not len(found) and not event.any():
        # The first points of every exploration were nominal draws too.
        estimate = estimate_of(*_nothing(draws + POINTS * len(explorations)))
    warnings = list(_warnings(estimate, explorations, weight[event], proposal))
    if len(found) and not common and len(proposal.shares) == 1:
        warnings.append("no proposal was better than brute force, which the estimate is")
    if wanted > most_draws:
        warnings.append(
            f"{wanted:,} draws were needed for a coefficient of variation of {target_cv:g}; "
            f"{most_draws:,} were allowed"
        )
    return Findings(
        estimate,
        tuple(explorations),
        proposal,
        z[event],
        weight[event],
        np.flatnonzero(event),
        first_draw,
        float(weight[lost].sum() / draws),
        tuple(warnings),
    )


def _refit(
    evaluate: Evaluate, found: FloatArray, rough: float, rng: np.random.Generator
) -> tuple[Proposal, float]:
    """The proposal fitted on what was explored and on weighted draws of its own, or brute force.

    Brute force where it is as good, or where the draws of no proposal were worth ``_FEWEST_EVENTS``
    events: failures in many narrow islands are not described by a normal mixture.

    Returns:
        It, and the squared coefficient of variation of a single draw's contribution.
    """
    even = np.full(len(found), 1 / len(found))
    best, least = nominal(found.shape[1]), 1 / rough - 1
    proposal = fit_proposal(found, even, rng)
    for _ in range(_REFITS):
        z = proposal.draw(_POINTS_OF_REFIT, rng)
        event = evaluate(z, "fitting the proposal")[:, 0] <= 0
        weight = np.exp(proposal.log_weight(z)) * event
        total = float(weight.sum())
        if total == 0:
            break
        if total**2 / float(np.sum(weight**2)) >= _FEWEST_EVENTS:
            squared_cv = float(weight.var() / weight.mean() ** 2)
            if squared_cv < least:
                best, least = proposal, squared_cv
        points = np.concatenate([found, z[event]])
        proposal = fit_proposal(points, np.concatenate([even, weight[event] / total]), rng)
    return best, least


def _nothing(draws: int) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Weights and events of nominal draws none of which was in the event."""
    return np.ones(draws), np.zeros(draws, dtype=bool)


def estimate_of(weight: FloatArray, event: NDArray[np.bool_]) -> Estimate:
    """Mean of w·1_F with its interval.

    Where all weights are 1 the interval is Clopper–Pearson's.  Else it is the one of Student's t on
    the scale of ln p, p̂ exp(± t s/(p̂ √n)), as weights and estimate are skew.

    Args:
        weight: φ/q of every draw, shape (n,).
        event: whether the draw is in the event, shape (n,).

    >>> estimate_of(np.ones(1_000), np.arange(1_000) < 3).probability
    0.003
    """
    n, events = len(weight), int(event.sum())
    if events == 0:
        return Estimate(None, None, 0.0, 1 - (1 - CONFIDENCE) ** (1 / n), 0.0, None, n, 0)
    values = weight * event
    total = float(values.sum())
    p, largest = total / n, float(values.max()) / total
    size = total**2 / float(np.sum(values**2))
    cv = float(values.std(ddof=1)) / math.sqrt(n) / p
    if np.all(weight == 1):
        tail = (1 - CONFIDENCE) / 2
        low = float(stats.beta.ppf(tail, events, n - events + 1))
        high = float(stats.beta.ppf(1 - tail, events + 1, n - events)) if events < n else 1.0
        return Estimate(p, cv, low, high, size, largest, n, events)
    factor = math.exp(float(stats.t.ppf((1 + CONFIDENCE) / 2, max(events - 1, 1))) * cv)
    return Estimate(p, cv, p / factor, min(1.0, p * factor), size, largest, n, events)


def _warnings(
    estimate: Estimate,
    explorations: list[Exploration],
    weights: FloatArray,
    proposal: Proposal,
) -> list[str]:
    """Where the proposal missed, in words."""
    p = estimate.probability
    if p is None:
        return []
    words = []
    if estimate.effective_sample_size < _SMALL_SAMPLE:
        size = estimate.effective_sample_size
        words.append(f"the effective sample size is {size:.0f}: the interval is too narrow")
    weighted = len(proposal.shares) > 1
    if weighted and estimate.largest_share is not None and estimate.largest_share > _LARGE_SHARE:
        share = 100 * estimate.largest_share
        words.append(f"one draw holds {share:.0f} % of the estimate: the interval is too narrow")
    beyond = float(weights[weights > 0.5 / NOMINAL_SHARE].sum() / weights.sum())
    if weighted and beyond > _LARGE_SHARE:
        words.append(
            f"{100 * beyond:.0f} % of the estimate comes from events that the exploration missed"
        )
    events = sum(exploration.nominal_events for exploration in explorations)
    trials = POINTS * len(explorations)
    too_many = stats.binom.sf(events - 1, trials, estimate.ci_high) < _CHECK_TAIL
    too_few = stats.binom.cdf(events, trials, estimate.ci_low) < _CHECK_TAIL
    if too_many or too_few:
        words.append(f"brute force disagrees: {events} events in {trials:,} episodes")
    return words
