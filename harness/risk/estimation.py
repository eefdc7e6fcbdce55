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

from harness.comparison.intervals import CONFIDENCE, clopper_pearson, zero_bound
from harness.encounter import FloatArray
from harness.risk.exploring import POINTS, Exploration, explore
from harness.risk.fitting import first_components, fit_components, spread
from harness.risk.layout import Layout
from harness.risk.outcomes import Evaluate, Outcomes
from harness.risk.proposal import NOMINAL_SHARE, Cases, Proposal, cases_of, keys_of, nominal

EXPLORATIONS = 3
"""Independent explorations: one alone now and then loses a way to the event."""

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

_LEAST_DRAWS = 4_000

_RESERVE = 2.5
"""More draws than the refits say are needed: weights found late are the large ones."""

_RESERVE_OF_BRUTE_FORCE = 1.25
"""The same where all weights are 1: how frequent the event is is known roughly."""

_AFFORDABLE = 50_000
"""Episodes that exploring and refitting take in any case: brute force may take as many."""

_PILOT_EVENTS = (4, 0.25)
"""The pilot ends at this many events at least, and at this part of what the estimate will need."""

_PILOT_DOUBT = 0.05
"""The pilot ends where so few events are as unlikely as this if brute force were affordable."""

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

    ``z`` (n, width), ``weights`` (n,), ``numbers`` (n,) of the episodes and ``keys`` (n, k), see
    ``keys_of``, are those of the last draws that were in the event.  ``episodes`` were run in all,
    ``failed_weight`` is the probability that failed episodes would add if all were in the event.
    """

    estimate: Estimate
    explorations: tuple[Exploration, ...]
    proposal: Proposal
    z: FloatArray
    weights: FloatArray
    numbers: NDArray[np.int64]
    keys: FloatArray
    episodes: int
    failed_weight: float
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Draws:
    """Draws from a proposal.

    ``event`` and ``failed`` (n,) tell what became of them; ``weight`` (n,) is that of both kinds, 0
    of the others, or 1 where the proposal is the nominal density.  ``cases`` are of the event.
    """

    z: FloatArray
    numbers: NDArray[np.int64]
    event: NDArray[np.bool_]
    failed: NDArray[np.bool_]
    weight: FloatArray
    cases: Cases


class _Counted:
    """Counts the episodes of an evaluation."""

    def __init__(self, evaluate: Evaluate) -> None:
        self._evaluate = evaluate
        self.episodes = 0

    def __call__(
        self, z: FloatArray, what: str, numbers: NDArray[np.int64] | None = None
    ) -> Outcomes:
        self.episodes += len(z)
        return self._evaluate(z, what, numbers)


def estimate_probability(
    evaluate: Evaluate,
    layout: Layout,
    rng: np.random.Generator,
    target_cv: float = 0.1,
    most_draws: int = 200_000,
) -> Findings:
    """Explore, fit a proposal, estimate.

    Args:
        evaluate: runs episodes.
        layout: of the states.
        rng: draws everything.
        target_cv: wanted coefficient of variation of the estimate.
        most_draws: bound on the draws of the last stage.
    """
    # Small matrices are slower on several threads, and their last bits depend on the number.
    with threadpool_limits(1, user_api="blas"):
        return _estimate(_Counted(evaluate), layout, rng, target_cv, most_draws)


def _estimate(
    counted: _Counted,
    layout: Layout,
    rng: np.random.Generator,
    target_cv: float,
    most_draws: int,
) -> Findings:
    # From a generator of its own: what follows is the same whatever the pilot took.
    share, piloted = _pilot(counted, layout, rng.spawn(1)[0], target_cv)
    explorations: list[Exploration] = []
    if share is None:
        explorations = [explore(counted, layout, rng, n) for n in range(EXPLORATIONS)]
    failures = [exploration.failures for exploration in explorations]
    found = np.concatenate([np.empty((0, layout.width)), *failures])
    if share is not None:
        proposal, squared_cv = nominal(layout), (1 - share) / share
    elif len(found):
        rough = float(np.mean([exploration.rough for exploration in explorations]))
        proposal, squared_cv = _refit(counted, layout, found, rough, rng)
    else:
        # Nothing is known of where the event might be: more nominal draws only bound it.
        proposal, squared_cv = nominal(layout), 0.0
    weighted = bool(proposal.components)
    reserve = _RESERVE if weighted else _RESERVE_OF_BRUTE_FORCE
    wanted = math.ceil(reserve * squared_cv / target_cv**2)
    draws = min(max(wanted, POINTS if share is not None else _LEAST_DRAWS), most_draws)
    drawn = _drawn(proposal, counted, draws, rng, "estimating")
    event, weights = drawn.event, drawn.weight[drawn.event]
    estimate = estimate_of(drawn.weight, event)
    if not len(found) and not event.any():
        # The pilot and the first points of every exploration were nominal draws too.
        estimate = estimate_of(*_nothing(draws + piloted + POINTS * len(explorations)))
    warnings = list(_warnings(estimate, explorations, weights, proposal))
    if len(found) and not weighted:
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
        drawn.z[event],
        weights,
        drawn.numbers[event],
        keys_of(proposal, drawn.cases),
        counted.episodes,
        float(drawn.weight[drawn.failed].sum() / draws),
        tuple(warnings),
    )


def _pilot(
    evaluate: Evaluate, layout: Layout, rng: np.random.Generator, target_cv: float
) -> tuple[float | None, int]:
    """Nominal draws, until it is clear whether brute force alone would be affordable.

    Returns:
        The share of events, None where it would not, and how many draws it took.
    """
    least = min(1.0, 1 / (_AFFORDABLE * target_cv**2))
    enough = max(_PILOT_EVENTS[0], math.ceil(_PILOT_EVENTS[1] / target_cv**2))
    events = draws = 0
    while events < enough:
        if stats.binom.cdf(events, draws, least) < _PILOT_DOUBT:
            return None, draws
        events += int(evaluate(layout.draw(POINTS, rng), "a first look").event.sum())
        draws += POINTS
    return events / draws, draws


def _drawn(
    proposal: Proposal, evaluate: Evaluate, count: int, rng: np.random.Generator, what: str
) -> _Draws:
    """Independent draws from a proposal, with their weights."""
    z, outcomes = proposal.draw(count, evaluate, rng, what)
    event, failed = outcomes.event, outcomes.failed
    again = evaluate if proposal.components else None
    weight = np.zeros(count) if proposal.components else np.ones(count)
    kinds = []
    for kind in (event, failed):
        own = Outcomes(outcomes.score[kind], outcomes.passed_s[kind], outcomes.numbers[kind])
        cases, _ = cases_of(proposal.layout, z[kind], own, again)
        weight[kind] = np.exp(proposal.log_weight(cases))
        kinds.append(cases)
    return _Draws(z, outcomes.numbers, event, failed, weight, kinds[0])


def _refit(
    counted: _Counted, layout: Layout, found: FloatArray, rough: float, rng: np.random.Generator
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
        batches: list[_Draws] = []
        weight, size = np.empty(0), 0.0
        # The later the round, the better the proposal, the more is drawn from it.
        while len(batches) <= round_ and size < _ENOUGH_EVENTS:
            batches.append(_drawn(proposal, counted, _POINTS_OF_REFIT, rng, "fitting the proposal"))
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
    outcomes = Outcomes(outcomes.score[event], outcomes.passed_s[event], outcomes.numbers[event])
    cases, without = cases_of(layout, found, outcomes, evaluate)
    arrivals_s = np.where(without > 0, layout.arrivals_s(found), -np.inf)
    who = np.where(np.isfinite(arrivals_s).any(axis=1), arrivals_s.argmax(axis=1), -1)
    return cases, who


def _joined(cases: list[Cases]) -> Cases:
    return Cases(
        np.concatenate([part.fixed for part in cases]),
        np.concatenate([part.people for part in cases]),
    )


def _nothing(draws: int) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Weights and events of nominal draws none of which was in the event."""
    return np.ones(draws), np.zeros(draws, dtype=bool)


def estimate_of(weight: FloatArray, event: NDArray[np.bool_]) -> Estimate:
    """Mean of w·1_F with its interval.

    Where all weights are 1 the interval is Clopper–Pearson's.  Else it is the one of Student's t on
    the scale of ln p, p̂ exp(± t s/(p̂ √n)), as weights and estimate are skew.  Large weights are
    rare, so the spread s of most samples is too small: one more of the largest is counted in it.

    Args:
        weight: φ/q of every draw, shape (n,).
        event: whether the draw is in the event, shape (n,).

    >>> estimate_of(np.ones(1_000), np.arange(1_000) < 3).probability
    0.003
    """
    n, events = len(weight), int(event.sum())
    if events == 0:
        return Estimate(None, None, 0.0, zero_bound(n), 0.0, None, n, 0)
    values = weight * event
    total = float(values.sum())
    p, largest = total / n, float(values.max()) / total
    size = total**2 / float(np.sum(values**2))
    cv = float(values.std(ddof=1)) / math.sqrt(n) / p
    if np.all(weight == 1):
        return Estimate(p, cv, *clopper_pearson(events, n), size, largest, n, events)
    quantile = float(stats.t.ppf((1 + CONFIDENCE) / 2, max(events - 1, 1)))
    factor = math.exp(quantile * math.hypot(cv, largest))
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
    weighted = bool(proposal.components)
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
