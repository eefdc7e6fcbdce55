"""Stage two: estimates the event's probability by importance sampling with independent draws.

p = E_q[1_F φ/q] for any density q that is positive where φ is (Owen, Monte Carlo theory, methods
and examples, ch. 9).  With a crowd, a draw is a unit of ``placing``.  The number of draws is fixed
before the first draw.  Draws to which the proposal was fitted are not counted.  So the estimate is
unbiased even if the exploration missed a way to the event.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from threadpoolctl import threadpool_limits

from harness.core.encounter import FloatArray
from harness.old.statistics.findings import Note, Rank
from harness.old.studies.risk.exploring import POINTS, Exploration, explore
from harness.old.studies.risk.findings import SMALL_SAMPLE
from harness.old.studies.risk.interval import Estimate, Tally, estimate_of
from harness.old.studies.risk.layout import Layout
from harness.old.studies.risk.learning import Learning
from harness.old.studies.risk.outcomes import Counted, Evaluate
from harness.old.studies.risk.placing import Placing
from harness.old.studies.risk.proposal import NOMINAL_SHARE, Proposal, draws_from, nominal
from harness.old.studies.risk.refitting import refit

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

    ``z`` (n, width), ``weights`` (n,), episode ``numbers`` (n,) and ``keys`` (n, k) describe the
    final draws that ended in the event.  A key is the fixed uniforms and, with a crowd, the arrival
    and the other uniforms of the culprit; 0 without one.  ``weighted`` is False for brute force.
    ``episodes`` counts all episodes, ``episodes_to_estimate`` those of the final draws;
    ``events_in_all`` counts the episodes that ended in the event.
    ``first_look`` counts the draws that decided between brute force and exploration; the estimate
    does not use them.  ``failed_weight`` is the probability that failed episodes would add if all
    ended in the event.
    """

    estimate: Estimate
    explorations: tuple[Exploration, ...]
    weighted: bool
    z: FloatArray
    weights: FloatArray
    numbers: NDArray[np.int64]
    keys: FloatArray
    episodes: int
    episodes_to_estimate: int
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
    if share is not None:
        prepared = _Prepared(nominal(layout), (1 - share) / share, (), Tally(0, 0), POINTS)
    elif layout.marks:
        prepared = _learned(counted, layout, rng, target_cv, pilot)
    else:
        prepared = _explored(counted, layout, rng)
    weighted = prepared.weighted
    reserve = _RESERVE if weighted else _RESERVE_OF_BRUTE_FORCE
    needed = math.ceil(reserve * prepared.squared_cv / target_cv**2)
    draws = min(max(needed, prepared.least), most_draws)
    before, explored = counted.events, counted.episodes
    drawn = _drawn(prepared.proposal, counted, draws, rng)
    tally = pilot + prepared.nominal + drawn.nominal
    estimate = estimate_of(drawn.value, tally, weighted=weighted)
    notes = _doubts(estimate, drawn, weighted=weighted)
    if before and estimate.events == 0:
        notes.append(
            f"None of the {draws:,} draws ended in the event, but {pilot.events:,} of the "
            f"{pilot.draws:,} episodes of the first look and {before - pilot.events:,} of the "
            "exploration did: more draws are needed."
        )
    if share is None and not weighted and before == pilot.events and estimate.events:
        notes.append("The estimate uses brute force: the exploration found no event.")
    if share is None and not weighted and before > pilot.events:
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
        prepared.explorations,
        weighted,
        drawn.z,
        drawn.weight,
        drawn.numbers,
        drawn.keys,
        counted.episodes,
        counted.episodes - explored,
        counted.events,
        pilot,
        drawn.failed / draws,
        tuple(Note(Rank.FEW_PAIRS, text) for text in notes),
    )


class _Prepared(NamedTuple):
    """A proposal, the squared coefficient of variation of a draw, and the least number of draws.

    ``nominal`` counts the nominal draws of the explorations.
    """

    proposal: Proposal | Placing
    squared_cv: float
    explorations: tuple[Exploration, ...]
    nominal: Tally
    least: int

    @property
    def weighted(self) -> bool:
        """Whether the draws are weighted."""
        return isinstance(self.proposal, Placing) or bool(self.proposal.components)


def _explored(counted: Counted, layout: Layout, rng: np.random.Generator) -> _Prepared:
    explorations = tuple(explore(counted, layout, rng, n) for n in range(EXPLORATIONS))
    tally = sum((exploration.nominal for exploration in explorations), Tally(0, 0))
    explored = np.concatenate([exploration.failures for exploration in explorations])
    if not len(explored):
        # No state in the event is known, so more nominal draws can only bound the probability.
        return _Prepared(nominal(layout), 0.0, explorations, tally, _LEAST_DRAWS)
    probability = float(np.mean([exploration.probability for exploration in explorations]))
    proposal, squared_cv = refit(counted, layout, explored, probability, rng)
    return _Prepared(proposal, squared_cv, explorations, tally, _LEAST_DRAWS)


def _learned(
    counted: Counted, layout: Layout, rng: np.random.Generator, target_cv: float, pilot: Tally
) -> _Prepared:
    learning = Learning(counted, layout, rng)
    learning.learn(target_cv, pilot, _RESERVE)
    levels, tally = learning.explorations(), learning.tally
    if learning.squared_cv is None:
        # Too few events are known, so nominal draws bound the probability, or are as good.
        squared_cv = 1 / learning.probability - 1 if learning.probability else 0.0
        return _Prepared(nominal(layout), squared_cv, levels, tally, _LEAST_DRAWS)
    brute_force = 1 / learning.probability - 1
    if _RESERVE * learning.squared_cv * learning.cost > _RESERVE_OF_BRUTE_FORCE * brute_force:
        return _Prepared(nominal(layout), brute_force, levels, tally, POINTS)
    return _Prepared(learning.proposal, learning.squared_cv, levels, tally, POINTS)


class _Drawn(NamedTuple):
    """The draws of the estimate.

    ``value`` (n,) are the values of all draws.  ``z``, ``weight``, ``numbers``, ``keys`` and
    ``missed``, whether the proposal reaches it less often than chance, describe the events.
    ``failed`` is the sum of the weights of the failed episodes.
    """

    value: FloatArray
    z: FloatArray
    weight: FloatArray
    numbers: NDArray[np.int64]
    keys: FloatArray
    missed: NDArray[np.bool_]
    nominal: Tally
    failed: float


def _drawn(
    proposal: Proposal | Placing, counted: Counted, count: int, rng: np.random.Generator
) -> _Drawn:
    layout = proposal.layout
    speed = layout.fixed  # the place of the passing speed among the numbers of a point
    if isinstance(proposal, Placing):
        units = proposal.draw(count, counted, rng, "estimating")
        keys = np.nan_to_num(np.delete(units.points, speed, axis=1))
        return _Drawn(
            units.value,
            units.z,
            units.weight,
            units.numbers,
            keys,
            units.missed,
            units.nominal,
            float(units.failed.sum()),
        )
    draws = draws_from(proposal, counted, count, rng, "estimating")
    event = draws.event
    weight, outcomes = draws.weight[event], draws.outcomes
    return _Drawn(
        draws.weight * event,
        draws.z[event],
        weight,
        outcomes.numbers[event],
        _keys(layout, draws.z[event], outcomes.culprit[event], outcomes.passed_s[event]),
        weight > 0.5 / NOMINAL_SHARE,
        draws.nominal,
        float(draws.weight[outcomes.failed].sum()),
    )


def _keys(
    layout: Layout, z: FloatArray, culprit: NDArray[np.int64], passed_s: FloatArray
) -> FloatArray:
    """Return the keys of events by brute force, in which arrivals count from the actual passage."""
    fixed = z[:, : layout.fixed]
    if not layout.marks:
        return fixed
    rows = np.arange(len(z))
    who = layout.people(z)[rows, culprit].copy()
    who[:, 0] = layout.arrivals_s(z)[rows, culprit] - passed_s
    who[culprit < 0] = 0.0
    return np.concatenate([fixed, np.nan_to_num(who)], axis=1)


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


def _doubts(estimate: Estimate, drawn: _Drawn, *, weighted: bool) -> list[str]:
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
    beyond = float(drawn.weight[drawn.missed].sum() / drawn.weight.sum())
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
