"""Returns weighted draws from a mixture of normal densities around the explored events.

A component draws the normal scores f of the fixed uniforms from a normal density g.  It may also
add one pedestrian to a nominal crowd.  This pedestrian arrives τ after the time T at which the ego
would pass without them, and has marks m (side, quantile, ...); g then draws f, τ and m.  For a
crowd ξ with rate λ, the ratio of the component's density to the nominal density follows from
Mecke's formula (Last & Penrose, Lectures on the Poisson process, theorem 4.1):

    Σ over x = (t, m) in ξ of g(f, t − T(ξ without x), m) / (λ φ(f) φ(m)).

Without a placed pedestrian the ratio is g(f)/φ(f).  The nominal density has the share
``NOMINAL_SHARE`` of the proposal, so no weight exceeds 1/``NOMINAL_SHARE``, even if the
exploration missed a way to the event.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import FloatArray
from harness.studies.risk.interval import Tally
from harness.studies.risk.layout import Layout
from harness.studies.risk.outcomes import Evaluate, Outcomes

NOMINAL_SHARE = 0.1
"""Share of the draws that come from the nominal density."""


class Points(NamedTuple):
    """Arguments ``y`` (k, d) of a component's density, and the indices (k,) of their cases."""

    y: FloatArray
    case: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Cases:
    """States in the coordinates of components.

    ``fixed`` (n, F) are the fixed uniforms.  ``people`` (n, places, m) contains for each pedestrian
    their marks and their arrival, in s after the ego would have passed without them.  It is NaN at
    empty places, and if the ego never passed.
    """

    fixed: FloatArray
    people: FloatArray

    def points(self, *, placed: bool) -> Points:
        """Return the arguments of a component's density.

        If the component places a pedestrian, a case has one point for each pedestrian who may be
        the placed one.  Otherwise it has one point.
        """
        if not placed:
            return Points(self.fixed, np.arange(len(self.fixed)))
        case, place = np.nonzero(~np.isnan(self.people).any(axis=2))
        y = np.concatenate([self.fixed[case], self.people[case, place]], axis=1)
        return Points(y, case)


@dataclass(frozen=True, slots=True)
class Component:
    """A normal density over the fixed uniforms and, if ``placed``, over a placed pedestrian.

    ``mean`` has shape (d,).  ``factor`` (d, d) is the lower Cholesky factor of the covariance.
    d is the number of fixed uniforms, plus m if ``placed``.
    """

    share: float
    placed: bool
    mean: FloatArray
    factor: FloatArray

    def log_ratio(self, layout: Layout, y: FloatArray) -> FloatArray:
        """Return ln(component's density / nominal density) at y (k, d), shape (k,)."""
        scaled = (y - self.mean) @ np.linalg.inv(self.factor).T
        ratio: FloatArray = (_squares(y) - _squares(scaled)) / 2
        ratio -= np.log(np.diag(self.factor)).sum()
        if self.placed:
            # The nominal density of an arrival time is uniform, not normal.
            ratio -= y[:, layout.fixed] ** 2 / 2
            ratio -= math.log(layout.rate_per_s) + math.log(2 * math.pi) / 2
        return ratio


def _squares(y: FloatArray) -> FloatArray:
    squares: FloatArray = np.einsum("ij,ij->i", y, y)
    return squares


@dataclass(frozen=True, slots=True)
class Proposal:
    """A mixture of ``components`` and the nominal density, which has the remaining share."""

    layout: Layout
    components: tuple[Component, ...]

    @property
    def nominal_share(self) -> float:
        """Share of the draws that come from the nominal density."""
        return NOMINAL_SHARE if self.components else 1.0

    def draw(
        self, count: int, evaluate: Evaluate, rng: np.random.Generator, what: str
    ) -> tuple[FloatArray, Outcomes, NDArray[np.bool_]]:
        """Draw independent states and run them.

        A placed pedestrian who would arrive before the trigger or after the window is left out.
        Such a state does not count as an event, because its density is 0.

        Args:
            count: number of states.
            evaluate: runs the states; states with a placed pedestrian run first without them.
            rng: generator for the states.
            what: purpose of the episodes, for the progress bar.

        Returns:
            The states (n, width), their outcomes, and whether each is a nominal draw (n,).
        """
        layout = self.layout
        z = layout.draw(count, rng)
        ends = np.cumsum([self.nominal_share, *(part.share for part in self.components)])
        chosen = np.searchsorted(ends, rng.random(count), side="right")
        chosen = np.minimum(chosen, len(self.components))
        placed = np.zeros(count, dtype=bool)
        who = np.zeros((count, layout.marks))
        for k, part in enumerate(self.components, 1):
            rows = np.flatnonzero(chosen == k)
            y = part.mean + rng.standard_normal((len(rows), len(part.mean))) @ part.factor.T
            z[rows, : layout.fixed] = y[:, : layout.fixed]
            if part.placed:
                placed[rows], who[rows] = True, y[:, layout.fixed :]
        outcomes = evaluate(z, what)
        if not placed.any():
            return z, outcomes, chosen == 0
        score, passed_s = outcomes.score.copy(), outcomes.passed_s.copy()
        score[placed] = np.inf
        arrival_s = passed_s + who[:, 0]
        (rows,) = np.nonzero(placed & (arrival_s > 0) & (arrival_s < layout.window_s))
        z[rows] = layout.joined(z[rows], arrival_s[rows], who[rows, 1:])
        rerun = evaluate(z[rows], f"{what}, with a placed pedestrian", outcomes.numbers[rows])
        score[rows], passed_s[rows] = rerun.score, rerun.passed_s
        return z, Outcomes(score, passed_s, outcomes.numbers), chosen == 0

    def log_weight(self, cases: Cases) -> FloatArray:
        """Return ln(nominal density / proposal density), (n,), at most −ln ``NOMINAL_SHARE``."""
        ratio = np.full(len(cases.fixed), self.nominal_share)
        for part in self.components:
            y, case = cases.points(placed=part.placed)
            terms = part.share * np.exp(part.log_ratio(self.layout, y))
            ratio += np.bincount(case, terms, len(ratio))
        weight: FloatArray = -np.log(ratio)
        return weight


def nominal(layout: Layout) -> Proposal:
    """Return the nominal density alone, for brute force."""
    return Proposal(layout, ())


def cases_of(
    layout: Layout, z: FloatArray, outcomes: Outcomes, evaluate: Evaluate | None = None
) -> tuple[Cases, FloatArray]:
    """Return states in the coordinates of components.

    Each state runs again without each pedestrian who arrives before the ego's passage.  A
    pedestrian who arrives later cannot change the time of the passage, unless the layout is
    ``entangled``.

    Args:
        layout: layout of the states.
        z: states, shape (n, width).
        outcomes: outcomes of the states.
        evaluate: runs the episodes again.  Without it, arrivals count from the actual passage.

    Returns:
        The cases, and the scores (n, places): entry (i, k) is the score of state i without the
        pedestrian at place k, or NaN if that episode was not run.
    """
    arrivals_s = layout.arrivals_s(z)
    passed_s = np.repeat(outcomes.passed_s[:, None], arrivals_s.shape[1], axis=1)
    score = np.full_like(passed_s, np.nan)
    # If the ego never passed, any pedestrian may be the reason.
    later = (arrivals_s > passed_s) & (not layout.entangled)
    row, place = np.nonzero(~np.isnan(arrivals_s) & ~later)
    if evaluate is not None and len(row):
        fewer = layout.without(z[row], place)
        rerun = evaluate(fewer, "without each pedestrian", outcomes.numbers[row])
        passed_s[row, place], score[row, place] = rerun.passed_s, rerun.score[:, 0]
    people = layout.people(z).copy()
    if layout.marks:
        people[:, :, 0] = arrivals_s - passed_s
        people[np.isnan(people[:, :, 0])] = np.nan
    return Cases(z[:, : layout.fixed], people), score


class Draws(NamedTuple):
    """Independent draws from a proposal.

    ``event`` and ``failed`` (n,) are the draws' outcomes.  ``weight`` (n,) is φ/q for draws in the
    event and for failed draws, and 0 for all others; if the proposal is the nominal density, it is
    1 for all draws.  ``cases`` are the draws in the event.  ``nominal`` counts the draws from the
    nominal density.
    """

    z: FloatArray
    numbers: NDArray[np.int64]
    event: NDArray[np.bool_]
    failed: NDArray[np.bool_]
    weight: FloatArray
    cases: Cases
    nominal: Tally


def draws_from(
    proposal: Proposal, evaluate: Evaluate, count: int, rng: np.random.Generator, what: str
) -> Draws:
    """Draw from a proposal, run the episodes and weight them."""
    z, outcomes, nominal = proposal.draw(count, evaluate, rng, what)
    event, failed = outcomes.event, outcomes.failed
    run_again = evaluate if proposal.components else None
    weight = np.zeros(count) if proposal.components else np.ones(count)
    kinds = []
    for kind in (event, failed):
        cases, _ = cases_of(proposal.layout, z[kind], outcomes.where(kind), run_again)
        weight[kind] = np.exp(proposal.log_weight(cases))
        kinds.append(cases)
    tally = Tally(int(nominal.sum()), int(event[nominal].sum()))
    return Draws(z, outcomes.numbers, event, failed, weight, kinds[0], tally)


def keys_of(proposal: Proposal, cases: Cases) -> FloatArray:
    """Return each state's fixed uniforms and the pedestrian who was most likely the placed one.

    Args:
        proposal: the proposal from which the states were drawn.
        cases: the states.

    Returns:
        Shape (n, fixed + m).  The chosen pedestrian has the highest product of a component's share
        and density.  If the proposal is the nominal density, it is the pedestrian whose arrival is
        nearest to the passage.  Without a pedestrian the m numbers are 0.
    """
    layout = proposal.layout
    if not layout.marks:
        return cases.fixed
    y, case = cases.points(placed=True)
    best = np.full(len(y), -np.inf)
    for part in proposal.components:
        if part.placed:
            best = np.maximum(best, np.log(part.share) + part.log_ratio(layout, y))
    if not proposal.components:
        best = -np.abs(y[:, layout.fixed])
    who = np.zeros((len(cases.fixed), layout.marks))
    # Later assignments overwrite earlier ones, so the likeliest pedestrian must come last.
    order = np.argsort(best, kind="stable")
    who[case[order]] = y[order, layout.fixed :]
    return np.concatenate([cases.fixed, who], axis=1)
