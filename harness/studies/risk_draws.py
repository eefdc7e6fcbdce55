"""Draws of a risk: how they are made and weighted, how their density is learned, and the estimate.

A *unit* is an independent draw.  It begins with a nominal flow ξ and fixed numbers f, from a
mixture q₀ with a share of the nominal density φ, and its episode is run.  The time T at which the
ego passes and its speed s then say where a person would be in its way.  A number of people, K(s) in
the mean, are drawn from a density g(x | f, s) of their arrival after T and their other numbers, and
the episode is run again with each of them.  Without a flow nobody is placed.

Every event is due to one person of the flow (the *culprit*), who is a function of the episode, or
to nobody in it.  So by Mecke's formula (Last & Penrose, Lectures on the Poisson process, theorem
4.1) the events with culprit x = (t, m) have in the units, relative to the nominal density, the
frequency

    q₀(f)/φ(f) (1 + K(s) g(x | f, s)/(λ φ(m))),

where T and s are those of the flow without x.  The weight of an event is the inverse (the balance
heuristic, Veach & Guibas 1995); an event that is due to nobody in the flow has the first factor
alone.  So the mean weight of a unit is the probability, whatever g and q₀ are.

Both are learned in rounds by the cross-entropy method (Rubinstein & Kroese, ch. 2): each is fitted
to the draws of all rounds with the lowest scores.  No round but the last is in the estimate.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy import stats

from harness.core.encounter import FloatArray
from harness.core.seeding import stream
from harness.results.estimators import CONFIDENCE, clopper_pearson
from harness.results.tables import Row
from harness.studies.risk_normals import Normals, fitted, standard_normal
from harness.studies.risk_space import GRADINGS, Space

NOMINAL_SHARE = 0.1
"""Share of the nominal density in the mixture of fixed numbers."""

FIRST_NUMBER, _NUMBERS = 2**40, 2**24
"""Number of the first episode, whose streams differ from those of a run's pairs; and numbers of a
round."""

_FARTHEST = 8.0
"""Standard normal numbers beyond it have a probability of 1e-15, and are not drawn."""

_LOOKS, _MOST_LOOKS = 1_000, 4_000
"""Nominal draws of a round of the first look, and the most of all of them."""

_LOOK_EVENTS = (4, 0.25)
"""The first look ends at this number of events, or at this share of 1/cv² if that is more."""

_ROUND, _ROUND_WITHOUT_FLOW = (100, 40), (1_000, 150)
"""Units of a round of learning, and number of lowest scores of each grading to which a density is
fitted.  Of fewer a fit would lose the less likely of several ways to the event."""

_PLACED, _PLACED_LATER = 4.0, 2.0
"""Mean number of placed people in a unit of the first rounds, and after that."""

_ENOUGH_HITS = 100
"""Number of placed culprits that show at which speeds the ego is in danger."""

_CLIPPED = 0.9
"""Weights above this quantile are reduced to it for a fit, so that no single draw dominates it."""

_RECENT = 2_400
"""Number of latest units by which the cost of an estimate is predicted."""

_FEWEST_EVENTS, _FEW_SCORES = 25.0, 5.0
"""Effective number of events among them below which it cannot be predicted; and of low scores below
which they do not bound the probability."""

_OTHER_WAYS, _NEAREST = 0.2, 6
"""Share of the placed people who look for other ways to the event; and number of lowest scores of
each grading, at similar speeds, that lead there."""

_BINS, _EVERYWHERE = 20, 0.05
"""Number of ranges of the ego's speed with about equally many passages; and the share of the placed
people that is independent of the speed."""

_ALLOWANCE, _ALLOWED_SHARE = 5_000, 0.08
"""Number of episodes that learning may take in any case, and the share of the episodes of brute
force that it may take besides."""

_RESERVE, _RESERVE_OF_BRUTE_FORCE = 2.5, 1.25
"""Multiples of the predicted number of draws: large weights appear late."""

_LEAST_DRAWS = 4_000


NEVER = (math.inf,) * GRADINGS
"""The scores of somebody who does not meet the ego."""


class Episode(NamedTuple):
    """An episode to run: its unit, its number, its random inputs (see ``Space``).

    ``asked`` is the place among the people of the one whose own scores are wanted; −1: everybody
    who is not of the flow; None: nobody.
    """

    unit: int
    number: int
    fixed: FloatArray
    people: FloatArray
    asked: int | None = None


class Outcome(NamedTuple):
    """How an episode ended; see the columns of ``draws``.

    ``culprit`` is the place of the person to whom the event is due; −1 without one.  ``scores`` are
    those of whom ``asked`` names alone.  ``passed_s`` and ``passed_mps`` are the time at which the
    ego's front reached the crosswalk's centre line and its speed then; None if it did not.
    """

    event: bool
    culprit: int = -1
    scores: tuple[float, ...] = NEVER
    passed_s: float | None = None
    passed_mps: float | None = None
    reason: str | None = None
    timed_out: bool = False
    drew_more: bool = False
    uniforms: str | None = None


Run = Callable[[Sequence[Episode]], Sequence[Outcome]]
"""Runs episodes."""


@dataclass(frozen=True)
class Proposal:
    """The densities of the fixed numbers and of the placed people.

    ``fixed`` is mixed with the nominal density; None: that alone.  ``placed`` is the density of f,
    s, t − T and m; None: a placed person is like all others and arrives at any time.  ``counts``
    are the mean numbers of placed people between the speeds ``edges_mps``.
    """

    fixed: Normals | None = None
    placed: Normals | None = None
    edges_mps: FloatArray = field(default_factory=lambda: np.empty(0))
    counts: FloatArray = field(default_factory=lambda: np.zeros(1))

    def count(self, speed: FloatArray) -> FloatArray:
        """K(s), (n,); 0 if the ego did not pass."""
        counts = self.counts[np.searchsorted(self.edges_mps, speed)]
        return np.where(np.isnan(speed), 0.0, counts)

    def rates(self, space: Space, points: FloatArray) -> FloatArray:
        """K(s) g(x | f, s)/(λ φ(m)) at points (n, fixed + 2 + m); 0 at points with NaN."""
        rates, known = np.zeros(len(points)), ~np.isnan(points).any(axis=1)
        y, size = points[known], len(space.fixed) + 1
        if not len(y):
            return rates
        count, who = self.count(y[:, size - 1]), y[:, size:]
        if self.placed is None:
            rates[known] = count / (space.rate_per_s * space.window_s)
        else:
            density = self.placed.given(y[:, :size]).density(who)
            rates[known] = count * density / (space.rate_per_s * standard_normal(who[:, 1:]))
        return rates

    def ratio(self, f: FloatArray) -> FloatArray:
        """q₀(f)/φ(f) at fixed numbers (n, fixed)."""
        if self.fixed is None:
            return np.ones(len(f))
        density = self.fixed.given(f[:, :0]).density(f)
        return NOMINAL_SHARE + (1 - NOMINAL_SHARE) * density / standard_normal(f)


def draw_units(
    proposal: Proposal, space: Space, round_: int, units: Sequence[int], run: Run
) -> list[Row]:
    """Draw units and run their episodes; the rows of ``draws``.

    A unit depends on the seed, its round and its number alone.
    """
    rngs = [stream(space.seed, "risk", unit, round_) for unit in units]
    size, n = len(space.fixed), len(units)
    noise = np.array([rng.standard_normal(size) for rng in rngs]).reshape(n, size)
    uniform = np.array([rng.random(2) for rng in rngs])
    nominal, f = np.ones(n, dtype=bool), noise
    if proposal.fixed is not None:
        nominal = uniform[:, 0] < NOMINAL_SHARE
        drawn = proposal.fixed.given(noise[:, :0]).points(uniform[:, 1], noise)
        f = np.where(nominal[:, None], noise, drawn)
    begun = [
        Episode(unit, FIRST_NUMBER + round_ * _NUMBERS + unit, fixed, space.crowd(rng), -1)
        for unit, fixed, rng in zip(units, f, rngs, strict=True)
    ]
    first = run(begun)
    passed = np.array([(each.passed_s, each.passed_mps) for each in first], dtype=float)
    tried, row, again = _placed(proposal, space, begun, passed, rngs)
    # Without its culprit an event says how often a placed person is drawn there.
    whose = [k for k, outcome in enumerate(first) if outcome.culprit >= 0]
    culprits = [begun[k].people[first[k].culprit] for k in whose]
    without = [np.delete(begun[k].people, first[k].culprit, axis=0) for k in whose]
    fewer = run([begun[k]._replace(people=of) for k, of in zip(whose, without, strict=True)])
    points = np.full((n, size + 2 + len(space.marks)), np.nan)
    points[:, :size] = f
    for k, (arrival_s, *marks), each in zip(whose, culprits, fewer, strict=True):
        if each.passed_s is not None:
            points[k, size:] = each.passed_mps, arrival_s - each.passed_s, *marks
    rates, ratio = proposal.rates(space, tried), proposal.ratio(f)
    weights = 1 / (ratio * (1 + proposal.rates(space, points)))
    rows: list[Row] = [
        {
            **each._asdict(),
            **{"cell": round_, "pair": units[k], "placed": False, "nominal": bool(nominal[k])},
            **{"due": each.event and each.culprit < 0, "point": f[k].tolist()},
            **{"weight": weights[k], "likely": 1 / ratio[k]},
            "episodes": 1 + (each.culprit >= 0),
        }
        for k, each in enumerate(first)
    ]
    for k, each, at, rate, point in zip(row, run(again), again, rates, tried, strict=True):
        hit = each.event and each.culprit == at.asked
        rows.append(
            {
                **each._asdict(),
                **{"cell": round_, "pair": units[k], "placed": True, "nominal": False},
                **{"event": hit, "due": hit, "point": point.tolist(), "episodes": 1},
                **{"weight": 1 / (ratio[k] * (1 + rate)), "likely": 1 / (ratio[k] * rate)},
            }
        )
    return sorted(rows, key=lambda row: (row["pair"], row["placed"]))


def _placed(
    proposal: Proposal,
    space: Space,
    begun: Sequence[Episode],
    passed: FloatArray,
    rngs: Sequence[np.random.Generator],
) -> tuple[FloatArray, list[int], list[Episode]]:
    """The points of the placed people, the unit's place of each, and the episodes with them.

    Who would come outside the window, where K g is no density of arrivals, is not placed.
    """
    counts, size = proposal.count(passed[:, 1]), 1 + len(space.marks)
    many = [int(count + rng.random()) for count, rng in zip(counts, rngs, strict=True)]
    row = np.repeat(np.arange(len(begun)), many)
    drawn = [
        (rng.random(k), rng.standard_normal((k, size))) for rng, k in zip(rngs, many, strict=True)
    ]
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
        place = int(np.searchsorted(begun[k].people[:, 0], arrival))
        joined = np.insert(begun[k].people, place, [arrival, *marks], axis=0)
        again.append(begun[k]._replace(people=joined, asked=place))
    return np.column_stack([known, who])[inside], row[inside].tolist(), again


class Tried(NamedTuple):
    """What was drawn from a learned density: points (n, d), their own scores (n, gradings), whether
    an event was due to them, and the nominal density over theirs (n,)."""

    points: FloatArray
    own: FloatArray
    due: NDArray[np.bool_]
    likely: FloatArray


class Units:
    """The rows of a round as arrays.

    ``value`` and ``failed`` (n,) are the sums of the weights of each unit's events and failures.
    ``first`` and ``placed`` are what was drawn.  ``draws`` and ``events`` count the nominal draws
    that did not fail.  ``weights`` and ``uniforms`` are those of the events.
    """

    def __init__(self, rows: pa.Table) -> None:
        pair, weight = (rows[name].to_numpy() for name in ("pair", "weight"))
        placed, event, nominal = (rows[of].to_numpy() for of in ("placed", "event", "nominal"))
        failed = rows["reason"].is_valid().to_numpy()
        self.count = count = int(np.sum(~placed))
        sums = [np.bincount(pair[of], weight[of], count).astype(float) for of in (event, failed)]
        self.value: FloatArray = sums[0]
        self.failed: FloatArray = sums[1]
        self.weights = weight[event]
        self.uniforms = rows.filter(pa.array(event))["uniforms"].to_pylist()
        self.draws, self.events = (int(np.sum(nominal & of)) for of in (~failed, event))
        self.episodes, self.timed_out, self.drew_more = (
            int(rows[name].to_numpy().sum()) for name in ("episodes", "timed_out", "drew_more")
        )
        self.failures = int(failed.sum())
        self.weighted = bool(placed.any() or nominal.sum() < count)
        self.passed_mps = rows["passed_mps"].to_numpy()[~placed]
        self.first, self.placed = (_tried(rows.filter(pa.array(of))) for of in (~placed, placed))


def _tried(rows: pa.Table) -> Tried:
    points, own = (
        rows[name].combine_chunks().flatten().to_numpy().reshape(len(rows), -1)
        if len(rows)
        else np.empty((0, 0))
        for name in ("point", "scores")
    )
    return Tried(points, own, rows["due"].to_numpy(), rows["likely"].to_numpy())


def _joined(parts: Sequence[Tried]) -> Tried:
    whole = [part for part in parts if len(part.due)]
    return Tried(*map(np.concatenate, zip(*whole, strict=True))) if whole else parts[0]


Draw = Callable[[Proposal, int, int], Units]
"""Draws from a proposal: in which round, and how many units."""


def bound(draws: int, events: int) -> float:
    """The one-sided Clopper–Pearson upper bound from nominal draws, of all ways to the event.

    >>> round(bound(6_000, 0) * 6_000, 2)
    2.99
    """
    return clopper_pearson(events, draws, 2 * CONFIDENCE - 1)[1]


def rounds_of(
    draw: Draw, space: Space, rng: np.random.Generator, target_cv: float, most: int
) -> list[Units]:
    """All rounds of a risk; the last one is the estimate.

    A first look ends with brute force if it is cheap.  Else the densities are learned until more
    rounds would cost more than they save, or too many episodes; then the cheaper of both estimates.

    Args:
        draw: draws units.
        space: the random inputs.
        rng: generator for the clusters of fits.
        target_cv: target coefficient of variation of the estimate.
        most: maximum number of units of the last round.
    """
    learning = _Learning(draw, space, rng)
    nominal, enough = Proposal(), max(_LOOK_EVENTS[0], _LOOK_EVENTS[1] / target_cv**2)
    while learning.events < enough and learning.draws < _MOST_LOOKS:
        learning.draw(nominal, _LOOKS)
        if learning.rounds[0].failures == _LOOKS:
            return learning.rounds
    events, draws, proposal = learning.events, learning.draws, nominal
    if events >= enough:
        needed = _RESERVE_OF_BRUTE_FORCE * (draws / events - 1)
    else:
        learning.learn(target_cv)
        p = learning.probability
        needed = _RESERVE_OF_BRUTE_FORCE * (1 / p - 1) if p else 0.0
        if learning.squared_cv is not None:
            weighted = _RESERVE * learning.squared_cv
            if weighted * learning.cost < needed:
                needed, proposal = weighted, learning.proposal
    least = _LOOKS if events >= enough or proposal.placed is not None else _LEAST_DRAWS
    learning.draw(proposal, min(max(math.ceil(needed / target_cv**2), least), most))
    return learning.rounds


class _Learning:
    """Learns a proposal and predicts what an estimate with it costs.

    ``probability`` is the mean of all rounds of learning.  ``squared_cv`` of a unit's value and
    ``cost``, the episodes of a unit, are those of the latest units; None if they have few events.
    """

    def __init__(self, draw: Draw, space: Space, rng: np.random.Generator) -> None:
        self._draw, self._space, self._rng = draw, space, rng
        self.proposal = Proposal(counts=np.array([_PLACED * bool(space.rate_per_s)]))
        self._count, self._lowest = _ROUND if space.rate_per_s else _ROUND_WITHOUT_FLOW
        self.rounds: list[Units] = []
        self.draws, self.events, self._looked = 0, 0, 0
        self.squared_cv: float | None = None
        self.cost, self.probability = math.nan, 0.0

    def draw(self, proposal: Proposal, count: int) -> None:
        """Draw a round."""
        self.rounds.append(self._draw(proposal, len(self.rounds), count))
        self.draws += self.rounds[-1].draws
        self.events += self.rounds[-1].events

    def learn(self, target_cv: float) -> None:
        """Draw rounds and fit the proposal to them."""
        self._looked, highest = len(self.rounds), 1.0
        while True:
            spent = sum(units.episodes for units in self._learned)
            highest = min(highest, bound(self.draws, self.events), self._high())
            if spent > _ALLOWANCE + _ALLOWED_SHARE / (highest * target_cv**2):
                return
            if _RESERVE * (self.squared_cv or math.inf) * self.cost / target_cv**2 < spent:
                return
            self.draw(self.proposal, self._count)
            self._predict()
            self._fit()

    @property
    def _learned(self) -> list[Units]:
        return self.rounds[self._looked :]

    @property
    def _recent(self) -> list[Units]:
        return self._learned[-max(1, _RECENT // self._learned[0].count) :] if self._learned else []

    def _high(self) -> float:
        """An upper bound of the probability; 1 if the rounds do not show one.

        An event is a score below every level, so it is no likelier than scores below the lowest
        level so far.  The bound is two standard errors above the estimate of the latter.
        """
        flow = bool(self._space.rate_per_s)
        if not self._recent or (flow and self._space.fixed):
            return 1.0
        every, recent = (
            _joined([units.placed if flow else units.first for units in of])
            for of in (self._learned, self._recent)
        )
        bounds, count = [1.0], sum(units.count for units in self._recent)
        for column, whole in zip(recent.own.T, every.own.T, strict=True):
            if len(whole) >= self._lowest:
                level = max(float(np.partition(whole, self._lowest - 1)[self._lowest - 1]), 0.0)
                weights = recent.likely[column <= level]
                if (size := effective(weights)) >= _FEW_SCORES:
                    bounds.append(math.exp(2 / math.sqrt(size)) * float(weights.sum()) / count)
        return min(bounds)

    def _predict(self) -> None:
        self.probability = float(np.concatenate([each.value for each in self._learned]).mean())
        last = np.concatenate([units.value for units in self._recent])
        if effective(last) >= _FEWEST_EVENTS:
            # As in the interval, the largest value counts twice, because large values are rare.
            largest = float(last.max()) / float(last.sum())
            self.squared_cv = float(last.var()) / float(last.mean()) ** 2 + len(last) * largest**2
            self.cost = sum(units.episodes for units in self._recent) / len(last)

    def _fit(self) -> None:
        size = len(self._space.fixed)
        first, placed = (
            _joined([getattr(units, name) for units in self._learned])
            for name in ("first", "placed")
        )
        found = self._fitted(first, np.ones(size, dtype=bool)) if size else None
        if len(placed.due) < self._lowest:  # nobody can be placed, or the ego passes too rarely
            self.proposal = replace(self.proposal, fixed=found)
            return
        # The nominal densities of the ego's speed and of the arrival are not standard normal.
        standard = np.ones(placed.points.shape[1], dtype=bool)
        standard[size : size + 2] = False
        who = self._fitted(placed, standard)
        if who is None:
            return
        speeds = placed.points[:, size]
        if placed.due.any():
            # Near misses at every speed may lead to other ways than those of the culprits so far.
            near = _nearest(placed, speeds)
            alike = np.ones(int(near.sum()))
            who = who.mixed_with(
                fitted(placed.points[near], alike, standard, self._rng), _OTHER_WAYS
            )
        if size:
            marginal = who.first(size)
            found = marginal if found is None else found.mixed_with(marginal, 0.5)
        self.proposal = replace(self.proposal, fixed=found, placed=who)
        if placed.due.sum() >= _ENOUGH_HITS:
            self._allot(speeds[placed.due], placed.likely[placed.due])

    def _fitted(self, tried: Tried, standard: NDArray[np.bool_]) -> Normals | None:
        """The density of those with an event or one of the lowest scores; None without any."""
        chosen = tried.due.copy()
        for column in tried.own.T:
            scores = np.where(tried.due, -np.inf, column)
            lowest = np.argsort(scores, kind="stable")[: self._lowest]
            chosen[lowest[np.isfinite(column[lowest])]] = True
        if not chosen.any():
            return None
        weights = tried.likely[chosen]
        clipped = np.minimum(weights, np.quantile(weights, _CLIPPED))
        return fitted(tried.points[chosen], clipped, standard, self._rng)

    def _allot(self, speeds_mps: FloatArray, weights: FloatArray) -> None:
        """Place more people where the ego passes at speeds at which culprits are likelier.

        The number that minimises the variance for its episodes is proportional to the standard
        deviation of a placed person's weight (Neyman's allocation), which is here taken as the
        square root of the probability of a culprit.
        """
        passed = np.concatenate([units.passed_mps for units in self._learned])
        passed = passed[~np.isnan(passed)]
        edges = np.unique(np.quantile(passed, np.arange(1, _BINS) / _BINS))
        share = np.bincount(np.searchsorted(edges, passed), minlength=len(edges) + 1) / len(passed)
        mass = np.bincount(np.searchsorted(edges, speeds_mps), weights, len(edges) + 1)
        root = np.sqrt(mass / mass.sum() / np.maximum(share, 1 / len(passed)))
        shape = (1 - _EVERYWHERE) * root / float(share @ root) + _EVERYWHERE
        self.proposal = replace(self.proposal, edges_mps=edges, counts=_PLACED_LATER * shape)


def _nearest(tried: Tried, speeds_mps: FloatArray) -> NDArray[np.bool_]:
    """Those with the lowest scores of those that the ego passes at a similar speed."""
    near = np.zeros(len(speeds_mps), dtype=bool)
    (rows,) = np.nonzero(~tried.due)
    for part in np.array_split(rows[np.argsort(speeds_mps[rows], kind="stable")], _BINS):
        for column in tried.own[part].T:
            near[part[np.argsort(column, kind="stable")[:_NEAREST]]] = True
    return near


def effective(value: FloatArray) -> float:
    """Kish's effective number, (Σv)²/Σv²; 0 if all values are 0."""
    squares = float(np.sum(value**2))
    return float(value.sum()) ** 2 / squares if squares else 0.0


def interval(value: FloatArray, weighted: bool) -> tuple[float, float, float]:
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
    quantile = float(stats.t.ppf((1 + CONFIDENCE) / 2, max(effective(value) - 1, 1)))
    factor = math.exp(quantile * math.hypot(cv, float(value.max()) / float(value.sum())))
    return cv, p / factor, min(1.0, p * factor)
