"""The draws of a risk: how they are made and weighted, and what they estimate.

A *unit* is an independent draw.  It begins with a nominal flow ξ and fixed numbers f, from a
mixture q₀ with a share of the nominal density φ, and its episode is run.  The time T at which the
ego passes and its speed s then say where a person would be in its way.  A number of people, in the
mean K, are drawn from a density g(x | f, s) of their arrival after T and their other numbers, and
the episode is run again with each of them.  Without a flow nobody is placed.

Every event is due to one person of the flow (the *culprit*), who is a function of the episode, or
to nobody in it.  So by Mecke's formula (Last & Penrose, Lectures on the Poisson process, theorem
4.1) the events with culprit x = (t, m) have in the units, relative to the nominal density, the
frequency

    q₀(f)/φ(f) (1 + K g(x | f, s)/(λ φ(m))),

where T and s are those of the flow without x.  The weight of an event is the inverse (the balance
heuristic, Veach & Guibas 1995); an event that is due to nobody in the flow has the first factor
alone.  So the mean weight of a unit is the probability, whatever g and q₀ are.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from scipy import special

from harness.core.freezing import Frozen
from harness.core.seeding import Given, stream
from harness.core.vocabulary import FloatArray
from harness.model.mixture.normals import effective
from harness.results.estimators import CONFIDENCE, clopper_pearson
from harness.results.tables import Row
from harness.studies.risk.densities import NormalMixture, standard_normal
from harness.studies.risk.space import NEVER, Space

NOMINAL_SHARE = 0.1
"""Share of the nominal density in the mixture of fixed numbers."""

FIRST_NUMBER, _NUMBERS = 2**40, 2**24
"""Number of the first episode, whose streams differ from those of a run's pairs; and numbers of a
round."""

_FARTHEST = 8.0
"""Standard normal numbers beyond it have a probability of 1e-15, and are not drawn."""


@dataclass(frozen=True)
class DrawInputs(Frozen):
    """An episode to run: its unit, its number, its random inputs (see ``Space``).

    ``asked`` is the place among the people of the one whose own scores are wanted; None: everybody
    who is not of the flow.
    """

    unit: int
    number: int
    fixed: FloatArray
    people: FloatArray
    asked: int | None = None

    def given(self, space: Space) -> Given:
        """The uniforms by purpose; see ``Space.given``."""
        return space.given(self.fixed, self.people, self.number)

    def place(self, rank: int) -> int | None:
        """The place among the people of somebody of a rank in the flow; None if not of them."""
        return rank if 0 <= rank < len(self.people) else None


class DrawOutcome(NamedTuple):
    """How an episode ended; see the columns of ``draws``.

    ``culprit`` is the place of the person to whom the event is due; None without one.  ``scores``
    are those of whom ``asked`` names alone.  ``passed_s`` and ``passed_mps`` are the time at which
    the ego's front reached the crosswalk's centre line and its speed then; None if it did not.
    """

    event: bool
    culprit: int | None = None
    scores: tuple[float, ...] = NEVER
    passed_s: float | None = None
    passed_mps: float | None = None
    reason: str | None = None
    timed_out: bool = False
    uniforms: str | None = None

    @property
    def row(self) -> Row:
        """Its columns of ``draws``."""
        return {k: v for k, v in self._asdict().items() if k not in ("culprit", "passed_s")}


RunDraws = Callable[[Sequence[DrawInputs]], Sequence[DrawOutcome]]
"""Runs episodes."""


class Proposal(NamedTuple):
    """The densities of the fixed numbers and of the placed people.

    ``fixed`` is mixed with the nominal density; None: that alone.  ``placed`` is the density of f,
    s, t − T and m; None: a placed person is like all others and arrives at any time.  ``many`` is
    their mean number K where the ego passes.
    """

    fixed: NormalMixture | None = None
    placed: NormalMixture | None = None
    many: float = 0.0

    def rates(self, space: Space, points: FloatArray) -> FloatArray:
        """K g(x | f, s)/(λ φ(m)) at points (n, fixed + 2 + m); 0 at points with NaN."""
        rates, known = np.zeros(len(points)), ~np.isnan(points).any(axis=1)
        y, size = points[known], len(space.fixed) + 1
        if self.placed is not None and len(y):
            density = self.placed.given(y[:, :size]).density(y[:, size:])
            nominal = space.rate_per_s * standard_normal(y[:, size + 1 :])
            rates[known] = self.many * density / nominal
        elif self.many:
            rates[known] = self.many / (space.rate_per_s * space.window_s)
        return rates

    def ratio(self, f: FloatArray) -> FloatArray:
        """q₀(f)/φ(f) at fixed numbers (n, fixed)."""
        if self.fixed is None:
            return np.ones(len(f))
        density = self.fixed.given(f[:, :0]).density(f)
        return NOMINAL_SHARE + (1 - NOMINAL_SHARE) * density / standard_normal(f)


def draw_units(
    proposal: Proposal, space: Space, round_: int, units: Sequence[int], run: RunDraws
) -> list[Row]:
    """Draw units and run their episodes; the rows of ``draws``.

    A unit depends on the seed, its round and its number alone.

    Args:
        proposal: the densities from which units are drawn.
        space: the risk's event and random numbers.
        round_: number of the round.
        units: numbers of the units within the round.
        run: runs the episodes of some draws.
    """
    rngs = [stream(space.seed, "risk", unit, round_) for unit in units]
    size, n = len(space.fixed), len(units)
    f = np.array([rng.standard_normal(size) for rng in rngs]).reshape(n, size)
    nominal, uniform = np.ones(n, dtype=bool), np.array([rng.random(2) for rng in rngs])
    if proposal.fixed is not None:
        nominal = uniform[:, 0] < NOMINAL_SHARE
        drawn = proposal.fixed.given(f[:, :0]).points(uniform[:, 1], f)
        f = np.where(nominal[:, None], f, drawn)
    begun = [
        DrawInputs(unit, FIRST_NUMBER + round_ * _NUMBERS + unit, fixed, space.crowd(rng))
        for unit, fixed, rng in zip(units, f, rngs, strict=True)
    ]
    first = run(begun)
    passed = np.array([(each.passed_s, each.passed_mps) for each in first], dtype=float)
    tried, row, again = _placed(proposal, space, begun, passed, rngs)
    # Without its culprit an event says how often a placed person is drawn there.
    whose = {k: outcome.culprit for k, outcome in enumerate(first) if outcome.culprit is not None}
    without = [np.delete(begun[k].people, at, axis=0) for k, at in whose.items()]
    fewer = run([replace(begun[k], people=of) for k, of in zip(whose, without, strict=True)])
    points = np.full((n, size + 2 + len(space.marks)), np.nan)
    points[:, :size] = f
    for (k, at), each in zip(whose.items(), fewer, strict=True):
        if each.passed_s is not None:
            arrival_s, *marks = begun[k].people[at]
            points[k, size:] = each.passed_mps, arrival_s - each.passed_s, *marks
    rates, ratio = proposal.rates(space, tried), proposal.ratio(f)
    weights = 1 / (ratio * (1 + proposal.rates(space, points)))
    rows: list[Row] = []
    for k, each in enumerate(first):
        due, episodes = each.event and each.culprit is None, 1 + (each.culprit is not None)
        own = {"placed": False, "nominal": nominal[k], "due": due, "episodes": episodes}
        own |= {"weight": weights[k], "likely": 1 / ratio[k], "point": f[k].tolist()}
        rows.append({**each.row, "cell": round_, "pair": units[k], **own})
    for k, each, asked, rate, point in zip(row, run(again), again, rates, tried, strict=True):
        hit = each.event and each.culprit == asked.asked
        own = {"placed": True, "nominal": False, "event": hit, "due": hit, "episodes": 1}
        own |= {"weight": 1 / (ratio[k] * (1 + rate)), "likely": 1 / (ratio[k] * rate)}
        own |= {"cell": round_, "pair": units[k], "point": point.tolist()}
        rows.append({**each.row, **own})
    return sorted(rows, key=lambda row: (row["pair"], row["placed"]))


def _placed(
    proposal: Proposal,
    space: Space,
    begun: Sequence[DrawInputs],
    passed: FloatArray,
    rngs: Sequence[np.random.Generator],
) -> tuple[FloatArray, list[int], list[DrawInputs]]:
    """The points of the placed people, the unit's place of each, and the episodes with them.

    Who would come outside the window, where no flow is sampled, is not placed.
    """
    passes, size = ~np.isnan(passed[:, 0]), 1 + len(space.marks)
    many = [int(proposal.many * of + rng.random()) for of, rng in zip(passes, rngs, strict=True)]
    row = np.repeat(np.arange(len(begun)), many)
    sizes = zip(rngs, many, strict=True)
    drawn = [(rng.random(k), rng.standard_normal((k, size))) for rng, k in sizes]
    uniform, who = map(np.concatenate, zip(*drawn, strict=True))
    passed_s, passed_mps = passed[row].T
    known = np.column_stack([np.array([each.fixed for each in begun])[row], passed_mps])
    if proposal.placed is not None and len(row):
        who = proposal.placed.given(known).points(uniform, who)
    else:
        who[:, 0] = space.window_s * uniform - passed_s
    arrival_s = passed_s + who[:, 0]
    inside = (arrival_s > 0) & (arrival_s < space.window_s)
    inside &= (np.abs(who[:, 1:]) < _FARTHEST).all(axis=1)
    again = []
    for k, arrival, marks in zip(row[inside], arrival_s[inside], who[inside, 1:], strict=True):
        people = begun[k].people
        place = int(np.searchsorted(people[:, 0], arrival))
        joined = np.concatenate([people[:place], [[arrival, *marks]], people[place:]])
        again.append(replace(begun[k], people=joined, asked=place))
    return np.column_stack([known, who])[inside], row[inside].tolist(), again


@dataclass(frozen=True)
class Units(Frozen):
    """The rows of a round, and what is summed over its ``count`` units.

    Attributes:
        rows: the rows.
        count: the number of units, n.
        value, failed: the sums of the weights of each unit's events and failures, shape (n,).
        weights, uniforms: those of the events.
        draws, events: the nominal draws that did not fail, and the events among them.
        episodes, timed_out_episodes, failures: numbers of episodes.
        weighted: whether any draw is weighted.
    """

    rows: pa.Table
    count: int
    value: FloatArray
    failed: FloatArray
    weights: FloatArray
    uniforms: tuple[str | None, ...]
    draws: int
    events: int
    episodes: int
    timed_out_episodes: int
    failures: int
    weighted: bool

    @classmethod
    def of(cls, rows: pa.Table) -> "Units":
        """The units of a round's rows."""
        pair, weight, placed, event, nominal, episodes, late = (
            rows[name].to_numpy() for name in
            ("pair", "weight", "placed", "event", "nominal", "episodes", "timed_out")
        )  # fmt: skip
        failed = rows["reason"].is_valid().to_numpy()
        count = int(np.sum(~placed))
        value, lost = (
            np.bincount(pair[some], weight[some], count).astype(float) for some in (event, failed)
        )
        uniforms = tuple(rows.filter(pa.array(event))["uniforms"].to_pylist())
        draws, events = (int(np.sum(nominal & some)) for some in (~failed, event))
        weighted = bool(placed.any() or nominal.sum() < count)
        numbers = draws, events, int(episodes.sum()), int(late.sum()), int(failed.sum())
        return cls(rows, count, value, lost, weight[event], uniforms, *numbers, weighted)


def bound(rounds: Sequence[Units]) -> tuple[float | None, int, int]:
    """The one-sided Clopper–Pearson bound of all ways to the event, from nominal draws alone.

    It comes with the nominal draws and the events among them; None without a draw.
    """
    draws, events = (sum(getattr(units, name) for units in rounds) for name in ("draws", "events"))
    high = clopper_pearson(events, draws, 2 * CONFIDENCE - 1)[1] if draws else None
    return high, draws, events


def interval_of_mean(value: FloatArray, weighted: bool) -> tuple[float, float, float]:
    """The coefficient of variation of the mean of some units' values, and its 95 % interval.

    Without weights the interval is Clopper–Pearson's.  Otherwise it is Student's t of ln p,
    p exp(± t s/(p √n)), because weights and estimate are skewed.  Its degrees of freedom follow
    from the effective sample size, because an estimate from one dominant draw is very uncertain.
    Large weights are rare, so s is too small in most samples; it includes the largest weight twice.

    Args:
        value: the sum of the weights of each unit's events, (n,), not all 0.
        weighted: whether any draw is weighted.
    """
    n, p = len(value), float(value.mean())
    cv = float(value.std(ddof=1)) / math.sqrt(n) / p
    if not weighted:
        return cv, *clopper_pearson(int(np.count_nonzero(value)), n, CONFIDENCE)
    quantile = float(special.stdtrit(max(effective(value) - 1, 1), (1 + CONFIDENCE) / 2))
    factor = math.exp(quantile * math.hypot(cv, float(value.max()) / float(value.sum())))
    return cv, p / factor, min(1.0, p * factor)
