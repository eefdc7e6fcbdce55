"""Stage two: estimates the event's probability by importance sampling with independent draws.

p = E_q[1_F φ/q] for any density q that is positive where φ is (Owen, Monte Carlo theory, methods
and examples, ch. 9).  The number of draws is fixed before the first draw.  Draws to which the
proposal was fitted are not counted.  So the estimate is unbiased even if the exploration missed a
way to the event.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from threadpoolctl import threadpool_limits

from harness.core.encounter import FloatArray
from harness.statistics.findings import Note, Rank
from harness.studies.risk.exploring import POINTS, Exploration, explore
from harness.studies.risk.findings import SMALL_SAMPLE
from harness.studies.risk.interval import Estimate, Tally, estimate_of
from harness.studies.risk.layout import Layout
from harness.studies.risk.outcomes import Counted, Evaluate
from harness.studies.risk.proposal import NOMINAL_SHARE, Proposal, draws_from, keys_of, nominal
from harness.studies.risk.refitting import refit

EXPLORATIONS = 3
"""Number of independent explorations; a single one sometimes misses a way to the event."""

_LEAST_DRAWS = 4_000

_RESERVE = 2.5
"""The estimate uses this multiple of the refits' number of draws; large weights appear late."""

_RESERVE_OF_BRUTE_FORCE = 1.25
"""The same factor if all weights are 1, because the event's frequency is then roughly known."""

_AFFORDABLE = 50_000
"""Number of episodes that exploring and refitting need; brute force may use as many."""

_PILOT_EVENTS = (4, 0.25)
"""The pilot ends at this number of events, or at this share of 1/cv² events if that is more."""

_PILOT_MOST = 10_000
"""Maximum number of pilot episodes.  If the pilot is still undecided, exploration follows."""

_PILOT_DOUBT = 0.05
"""The pilot ends without brute force if so few events are less likely than this.

The probability is computed for the smallest event frequency at which brute force is affordable."""

_LARGE_SHARE = 0.1
"""Maximum share of the estimate that one weight or all nominal draws together contribute."""

_CHECK_TAIL = 0.001
"""The brute-force check disagrees if its tail probability is below this."""


@dataclass(frozen=True, slots=True)
class Estimation:
    """The estimate with its draws and diagnostics.

    ``z`` (n, width), ``weights`` (n,), episode ``numbers`` (n,) and ``keys`` (n, k, see
    ``keys_of``) describe the final draws that ended in the event.  ``episodes`` counts all
    episodes; ``events_in_all`` counts the episodes that ended in the event.  ``first_look`` counts
    the draws that decided between brute force and exploration; the estimate does not use them.
    ``failed_weight`` is the probability that failed episodes would add if all ended in the event.
    """

    estimate: Estimate
    explorations: tuple[Exploration, ...]
    proposal: Proposal
    z: FloatArray
    weights: FloatArray
    numbers: NDArray[np.int64]
    keys: FloatArray
    episodes: int
    events_in_all: int
    first_look: Tally
    failed_weight: float
    notes: tuple[Note, ...]


def estimate_probability(
    evaluate: Evaluate,
    layout: Layout,
    rng: np.random.Generator,
    target_cv: float = 0.1,
    most_draws: int = 200_000,
) -> Estimation:
    """Explore, fit a proposal and estimate the probability.

    Args:
        evaluate: runs episodes.
        layout: layout of the states.
        rng: generator for all draws.
        target_cv: target coefficient of variation of the estimate.
        most_draws: maximum number of draws in the last stage.
    """
    # Several threads are slower for small matrices, and the last bits depend on their number.
    with threadpool_limits(1, user_api="blas"):
        return _estimate(Counted(evaluate), layout, rng, target_cv, most_draws)


def _estimate(
    counted: Counted,
    layout: Layout,
    rng: np.random.Generator,
    target_cv: float,
    most_draws: int,
) -> Estimation:
    # The pilot has its own generator, so that its length does not change later draws.
    share, pilot = _pilot(counted, layout, rng.spawn(1)[0], target_cv)
    explorations: list[Exploration] = []
    if share is None:
        explorations = [explore(counted, layout, rng, n) for n in range(EXPLORATIONS)]
    failures = [exploration.failures for exploration in explorations]
    explored = np.concatenate([np.empty((0, layout.width)), *failures])
    if share is not None:
        proposal, squared_cv = nominal(layout), (1 - share) / share
    elif len(explored):
        probability = float(np.mean([exploration.probability for exploration in explorations]))
        proposal, squared_cv = refit(counted, layout, explored, probability, rng)
    else:
        # No state in the event is known, so more nominal draws can only bound the probability.
        proposal, squared_cv = nominal(layout), 0.0
    weighted = bool(proposal.components)
    reserve = _RESERVE if weighted else _RESERVE_OF_BRUTE_FORCE
    needed = math.ceil(reserve * squared_cv / target_cv**2)
    draws = min(max(needed, POINTS if share is not None else _LEAST_DRAWS), most_draws)
    drawn = draws_from(proposal, counted, draws, rng, "estimating")
    event, weights = drawn.event, drawn.weight[drawn.event]
    tally = sum((exploration.nominal for exploration in explorations), pilot + drawn.nominal)
    estimate = estimate_of(drawn.weight, event, tally)
    notes = _doubts(estimate, weights, weighted=weighted)
    if counted.events and not event.any():
        explored_events = counted.events - pilot.events
        notes.append(
            f"None of the {draws:,} draws ended in the event, but {pilot.events:,} of the "
            f"{pilot.draws:,} episodes of the first look and {explored_events:,} of the "
            "exploration did: more draws are needed."
        )
    if len(explored) and not weighted:
        notes.append(
            "The estimate uses brute force: weighted draws around the explored events would have "
            "needed as many episodes, or contained too few events."
        )
    if needed > most_draws:
        notes.append(
            f"{needed:,} draws were needed for a coefficient of variation of {target_cv:g}; "
            f"{most_draws:,} were allowed."
        )
    return Estimation(
        estimate,
        tuple(explorations),
        proposal,
        drawn.z[event],
        weights,
        drawn.numbers[event],
        keys_of(proposal, drawn.cases),
        counted.episodes,
        counted.events,
        pilot,
        float(drawn.weight[drawn.failed].sum() / draws),
        tuple(Note(Rank.FEW_PAIRS, text) for text in notes),
    )


def _pilot(
    evaluate: Evaluate, layout: Layout, rng: np.random.Generator, target_cv: float
) -> tuple[float | None, Tally]:
    """Draw nominal states until it is clear whether brute force alone is affordable.

    Returns:
        The share of events (None if brute force is not affordable) and the draws.
    """
    least = min(1.0, 1 / (_AFFORDABLE * target_cv**2))
    enough = max(_PILOT_EVENTS[0], math.ceil(_PILOT_EVENTS[1] / target_cv**2))
    events = draws = 0
    while events < enough:
        unlikely = stats.binom.cdf(events, draws, least) < _PILOT_DOUBT
        if unlikely or draws >= _PILOT_MOST:
            return None, Tally(draws, events)
        events += int(evaluate(layout.draw(POINTS, rng), "a first look").event.sum())
        draws += POINTS
    return events / draws, Tally(draws, events)


def _doubts(estimate: Estimate, weights: FloatArray, *, weighted: bool) -> list[str]:
    """Return sentences with the doubts about an estimate."""
    # The interval of brute force is exact even for few events.
    if estimate.probability is None or not weighted:
        return []
    doubts = []
    size, largest = estimate.effective_sample_size, estimate.largest_share
    if size < SMALL_SAMPLE:
        doubts.append(f"The interval is too narrow: the effective sample size is only {size:.0f}.")
    if largest is not None and largest > _LARGE_SHARE:
        doubts.append(
            f"The interval is too narrow: one draw makes up {100 * largest:.0f} % of the estimate."
        )
    beyond = float(weights[weights > 0.5 / NOMINAL_SHARE].sum() / weights.sum())
    if beyond > _LARGE_SHARE:
        doubts.append(
            f"{100 * beyond:.0f} % of the estimate comes from events that the exploration missed."
        )
    events, trials = estimate.nominal.events, estimate.nominal.draws
    too_many = stats.binom.sf(events - 1, trials, estimate.ci_high) < _CHECK_TAIL
    too_few = stats.binom.cdf(events, trials, estimate.ci_low) < _CHECK_TAIL
    if too_many or too_few:
        doubts.append(f"Brute force disagrees: {events:,} of {trials:,} nominal draws were events.")
    return doubts
