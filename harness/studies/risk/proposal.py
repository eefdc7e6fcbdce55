"""The density that rare events are drawn from: normal densities around the failures found.

A component draws the fixed uniforms f from a normal density g in normal scores, and beside a
nominal crowd it may place one more: who arrives at a time τ from the moment T at which the ego
passes without them, with marks m (side, quantile, ...), f, τ and m from g.  By Mecke's formula
(Last & Penrose, Lectures on the Poisson process, theorem 4.1) its density over the nominal one is,
for a crowd ξ of rate λ,

    Σ over x = (t, m) in ξ of g(f, t − T(ξ without x), m) / (λ φ(f) φ(m)).

Without a placed one it is g(f)/φ(f), a normal mixture.  The nominal density itself has the share
``NOMINAL_SHARE``: so no weight exceeds its inverse, whatever the exploration missed.
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
    """Points of cases: ``y`` (k, d), and of which ``case`` (k,) each is."""

    y: FloatArray
    case: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Cases:
    """States as components see them.

    ``fixed`` (n, F): the fixed uniforms; ``people`` (n, places, m): of everybody the time from the
    passage without them in s, and the marks; NaN where nobody is or the ego never passed.
    """

    fixed: FloatArray
    people: FloatArray

    def points(self, *, placed: bool) -> Points:
        """What components ask their densities at: every case's fixed uniforms, once for each who
        may have been placed, or once where none is."""
        if not placed:
            return Points(self.fixed, np.arange(len(self.fixed)))
        case, place = np.nonzero(~np.isnan(self.people).any(axis=2))
        y = np.concatenate([self.fixed[case], self.people[case, place]], axis=1)
        return Points(y, case)


@dataclass(frozen=True, slots=True)
class Component:
    """A normal density over the fixed uniforms and, where ``placed``, over one of the crowd.

    ``mean`` (d,), ``factor`` (d, d): lower Cholesky of the covariance; d = fixed, + m if placed.
    """

    share: float
    placed: bool
    mean: FloatArray
    factor: FloatArray

    def log_ratio(self, layout: Layout, y: FloatArray) -> FloatArray:
        """ln of its density over the nominal one at y (k, d)."""
        scaled = (y - self.mean) @ np.linalg.inv(self.factor).T
        ratio: FloatArray = (_squares(y) - _squares(scaled)) / 2
        ratio -= np.log(np.diag(self.factor)).sum()
        if self.placed:
            # Nominally a time is uniform, not normal.
            ratio -= y[:, layout.fixed] ** 2 / 2
            ratio -= math.log(layout.rate_per_s) + math.log(2 * math.pi) / 2
        return ratio


def _squares(y: FloatArray) -> FloatArray:
    squares: FloatArray = np.einsum("ij,ij->i", y, y)
    return squares


@dataclass(frozen=True, slots=True)
class Proposal:
    """Components beside the nominal density, which has the rest of their shares."""

    layout: Layout
    components: tuple[Component, ...]

    @property
    def nominal_share(self) -> float:
        """Of the draws that come from the nominal density."""
        return NOMINAL_SHARE if self.components else 1.0

    def draw(
        self, count: int, evaluate: Evaluate, rng: np.random.Generator, what: str
    ) -> tuple[FloatArray, Outcomes, NDArray[np.bool_]]:
        """Independent states, what became of them, and which came from the nominal density.

        A placed one who would have to come before the trigger or after the window does not come,
        and the state counts as no event: it adds nothing to any density.

        Args:
            count: how many.
            evaluate: runs them, those with a placed one first without.
            rng: draws them.
            what: what they are for.
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
        again = evaluate(z[rows], f"{what}, with one placed", outcomes.numbers[rows])
        score[rows], passed_s[rows] = again.score, again.passed_s
        return z, Outcomes(score, passed_s, outcomes.numbers), chosen == 0

    def log_weight(self, cases: Cases) -> FloatArray:
        """ln of nominal density over this one, shape (n,); at most −ln ``NOMINAL_SHARE``."""
        ratio = np.full(len(cases.fixed), self.nominal_share)
        for part in self.components:
            y, case = cases.points(placed=part.placed)
            terms = part.share * np.exp(part.log_ratio(self.layout, y))
            ratio += np.bincount(case, terms, len(ratio))
        weight: FloatArray = -np.log(ratio)
        return weight


def nominal(layout: Layout) -> Proposal:
    """The nominal density alone: brute force."""
    return Proposal(layout, ())


def cases_of(
    layout: Layout, z: FloatArray, outcomes: Outcomes, evaluate: Evaluate | None = None
) -> tuple[Cases, FloatArray]:
    """States as components see them.

    Each is run again without each who comes before the passage; whoever arrives later cannot change
    when the ego passes, unless the layout says that they are entangled.

    Args:
        layout: of the states.
        z: states, shape (n, width).
        outcomes: what became of them.
        evaluate: runs the episodes again; None: times are from the passage with everybody.

    Returns:
        The cases, and the score of each state without each of its people, shape (n, places); NaN
        where that was not run.
    """
    arrivals_s = layout.arrivals_s(z)
    passed_s = np.repeat(outcomes.passed_s[:, None], arrivals_s.shape[1], axis=1)
    score = np.full_like(passed_s, np.nan)
    # An ego that never passed may have been kept by anybody.
    later = (arrivals_s > passed_s) & (not layout.entangled)
    row, place = np.nonzero(~np.isnan(arrivals_s) & ~later)
    if evaluate is not None and len(row):
        fewer = layout.without(z[row], place)
        alone = evaluate(fewer, "without each of the people", outcomes.numbers[row])
        passed_s[row, place], score[row, place] = alone.passed_s, alone.score[:, 0]
    people = layout.people(z).copy()
    if layout.marks:
        people[:, :, 0] = arrivals_s - passed_s
        people[np.isnan(people[:, :, 0])] = np.nan
    return Cases(z[:, : layout.fixed], people), score


class Draws(NamedTuple):
    """Independent draws from a proposal.

    ``event`` and ``failed`` (n,) are their outcomes; ``weight`` (n,) is that of the draws of either
    kind, and 0 of the others, or 1 of every draw where the proposal is the nominal density.
    ``cases`` are of the event; ``nominal`` counts the draws that came from the nominal density.
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
    """Independent draws from a proposal, with their weights."""
    z, outcomes, nominal = proposal.draw(count, evaluate, rng, what)
    event, failed = outcomes.event, outcomes.failed
    again = evaluate if proposal.components else None
    weight = np.zeros(count) if proposal.components else np.ones(count)
    kinds = []
    for kind in (event, failed):
        cases, _ = cases_of(proposal.layout, z[kind], outcomes.where(kind), again)
        weight[kind] = np.exp(proposal.log_weight(cases))
        kinds.append(cases)
    tally = Tally(int(nominal.sum()), int(event[nominal].sum()))
    return Draws(z, outcomes.numbers, event, failed, weight, kinds[0], tally)


def keys_of(proposal: Proposal, cases: Cases) -> FloatArray:
    """The fixed uniforms of each state, and the pedestrian who was most likely the placed one.

    Args:
        proposal: drew the states.
        cases: the states.

    Returns:
        Shape (n, fixed + m): the likeliest one of the likeliest component, of the nominal density
        the one nearest to the passage; 0 where there is none.
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
    # Of each case the likeliest comes last.
    order = np.argsort(best, kind="stable")
    who[case[order]] = y[order, layout.fixed :]
    return np.concatenate([cases.fixed, who], axis=1)
