"""Draws of a risk: how they are made and weighted, how their density is learned, and the estimate.

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

Both are learned in rounds by the cross-entropy method (Rubinstein & Kroese, ch. 2): each is fitted
to the draws of all rounds with the lowest scores.  No round but the last is in the estimate.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy import stats

from harness.core.encounter import FloatArray
from harness.core.seeding import stream
from harness.results.estimators import CONFIDENCE, clopper_pearson
from harness.results.tables import Row
from harness.studies.risk.risk_normals import NormalMixture, fitted, standard_normal
from harness.studies.risk.risk_space import NEVER, Space

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

_PLACED = 3.0
"""Mean number of placed people in a unit."""

_CLIPPED = 0.9
"""Weights above this quantile are reduced to it for a fit, so that no single draw dominates it."""

_RECENT = 2_400
"""Number of latest units by which the cost of an estimate is predicted."""

_FEWEST_EVENTS, _FEW_SCORES = 25.0, 5.0
"""Effective number of events among them below which it cannot be predicted; and of low scores below
which they do not bound the probability."""

_OTHER_WAYS, _NEAREST, _BINS = 0.2, 6, 20
"""Share of the placed people who look for other ways to the event; number of lowest scores of each
grading at similar speeds that lead there; and number of ranges of speeds."""

_ALLOWANCE, _ALLOWED_SHARE = 5_000, 0.08
"""Number of episodes that learning may take in any case, and the share of the episodes of brute
force that it may take besides."""

_RESERVE, _RESERVE_OF_BRUTE_FORCE = 2.5, 1.25
"""Multiples of the predicted number of draws: large weights appear late."""

_LEAST_DRAWS = 4_000


class DrawInputs(NamedTuple):
    """An episode to run: its unit, its number, its random inputs (see ``Space``).

    ``asked`` is the place among the people of the one whose own scores are wanted; −1: everybody
    who is not of the flow.
    """

    unit: int
    number: int
    fixed: FloatArray
    people: FloatArray
    asked: int = -1

    def place(self, rank: int) -> int:
        """The place among the people of somebody of a rank in the flow; −1 if not of them."""
        return rank if 0 <= rank < len(self.people) else -1


class DrawOutcome(NamedTuple):
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
    uniforms: str | None = None


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
    whose = [k for k, outcome in enumerate(first) if outcome.culprit >= 0]
    without = [np.delete(begun[k].people, first[k].culprit, axis=0) for k in whose]
    fewer = run([begun[k]._replace(people=of) for k, of in zip(whose, without, strict=True)])
    points = np.full((n, size + 2 + len(space.marks)), np.nan)
    points[:, :size] = f
    for k, each in zip(whose, fewer, strict=True):
        if each.passed_s is not None:
            arrival_s, *marks = begun[k].people[first[k].culprit]
            points[k, size:] = each.passed_mps, arrival_s - each.passed_s, *marks
    rates, ratio = proposal.rates(space, tried), proposal.ratio(f)
    weights = 1 / (ratio * (1 + proposal.rates(space, points)))
    rows: list[Row] = []
    for k, each in enumerate(first):
        due, episodes = each.event and each.culprit < 0, 1 + (each.culprit >= 0)
        own = {"placed": False, "nominal": nominal[k], "due": due, "episodes": episodes}
        own |= {"weight": weights[k], "likely": 1 / ratio[k], "point": f[k].tolist()}
        rows.append({**each._asdict(), "cell": round_, "pair": units[k], **own})
    for k, each, at, rate, point in zip(row, run(again), again, rates, tried, strict=True):
        hit = each.event and each.culprit == at.asked
        own = {"placed": True, "nominal": False, "event": hit, "due": hit, "episodes": 1}
        own |= {"weight": 1 / (ratio[k] * (1 + rate)), "likely": 1 / (ratio[k] * rate)}
        own |= {"cell": round_, "pair": units[k], "point": point.tolist()}
        rows.append({**each._asdict(), **own})
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
        again.append(begun[k]._replace(people=joined, asked=place))
    return np.column_stack([known, who])[inside], row[inside].tolist(), again


class Units:
    """The rows of a round, and what is summed over them.

    ``value`` and ``failed`` (n,) are the sums of the weights of each unit's events and failures.
    ``draws`` and ``events`` count the nominal draws that did not fail.  ``weights`` and
    ``uniforms`` are those of the events.
    """

    def __init__(self, rows: pa.Table) -> None:
        self.rows = rows
        pair, weight, placed, event, nominal = (
            rows[of].to_numpy() for of in ("pair", "weight", "placed", "event", "nominal")
        )
        failed = rows["reason"].is_valid().to_numpy()
        self.count = count = int(np.sum(~placed))
        self.value, self.failed = (
            np.bincount(pair[of], weight[of], count).astype(float) for of in (event, failed)
        )
        self.weights = weight[event]
        self.uniforms = rows.filter(pa.array(event))["uniforms"].to_pylist()
        self.draws, self.events = (int(np.sum(nominal & of)) for of in (~failed, event))
        self.episodes, self.timed_out_episodes = (
            int(np.sum(rows[of].to_numpy())) for of in ("episodes", "timed_out")
        )
        self.failures = int(failed.sum())
        self.weighted = bool(placed.any() or nominal.sum() < count)


class _Tried(NamedTuple):
    """What was drawn from a learned density.

    Points (n, d), their own scores (n, gradings), whether an event was due to them, and the nominal
    density over theirs (n,).
    """

    points: FloatArray
    own: FloatArray
    due: NDArray[np.bool_]
    likely: FloatArray


def _tried(rounds: Sequence[Units], placed: bool) -> _Tried:
    """The placed people of some rounds, or the fixed numbers of their first episodes."""
    rows = pa.concat_tables([units.rows for units in rounds])
    rows = rows.filter(pa.array(rows["placed"].to_numpy() == placed)).combine_chunks()
    n = len(rows)
    points, own = (
        np.array(rows[name].combine_chunks().flatten()).reshape(n, -1 if n else 0)
        for name in ("point", "scores")
    )
    return _Tried(points, own, rows["due"].to_numpy(), rows["likely"].to_numpy())


Draw = Callable[[Proposal, int, int], Units]
"""Draws from a proposal: in which round, and how many units."""


def bound(rounds: Sequence[Units]) -> tuple[float | None, int, int]:
    """The one-sided Clopper–Pearson bound of all ways to the event, from nominal draws alone.

    It comes with the nominal draws and the events among them; None without a draw.
    """
    draws, events = (sum(getattr(units, of) for units in rounds) for of in ("draws", "events"))
    high = clopper_pearson(events, draws, 2 * CONFIDENCE - 1)[1] if draws else None
    return high, draws, events


def rounds_of(
    draw: Draw, space: Space, rng: np.random.Generator, target_cv: float, most: int
) -> list[Units]:
    """All rounds of a risk; the last one is the estimate.

    A first look ends with brute force if it is cheap.  Else densities are learned.

    Args:
        draw: draws units.
        space: the random inputs.
        rng: generator for the clusters of fits.
        target_cv: target coefficient of variation of the estimate.
        most: maximum number of units of the last round.
    """
    rounds, events, draws = list[Units](), 0, 0
    enough = max(_LOOK_EVENTS[0], _LOOK_EVENTS[1] / target_cv**2)
    while events < enough and draws < _MOST_LOOKS:
        rounds.append(draw(Proposal(), len(rounds), _LOOKS))
        if rounds[0].failures == _LOOKS:
            return rounds
        _, draws, events = bound(rounds)
    proposal, least = Proposal(), _LOOKS
    needed = _RESERVE_OF_BRUTE_FORCE * (draws / events - 1) / target_cv**2 if events else 0.0
    if events < enough:
        proposal, needed = _learn(draw, space, rng, target_cv, rounds)
        least = _LEAST_DRAWS if proposal.placed is None else _LOOKS
    rounds.append(draw(proposal, len(rounds), min(max(math.ceil(needed), least), most)))
    return rounds


def _learn(
    draw: Draw, space: Space, rng: np.random.Generator, target_cv: float, rounds: list[Units]
) -> tuple[Proposal, float]:
    """Add rounds until more would cost more than they save, or take too many episodes.

    Returns:
        The proposal of the estimate, nominal if brute force is cheaper, and its number of draws.
    """
    flow, looked, highest = bool(space.rate_per_s), len(rounds), 1.0
    count, lowest = _ROUND if flow else _ROUND_WITHOUT_FLOW
    proposal, needed, each = Proposal(many=_PLACED * flow), math.inf, 1.0
    while True:
        learned = rounds[looked:]
        spent = sum(units.episodes for units in learned)
        if recent := learned[-(_RECENT // count) :]:
            value = np.concatenate([units.value for units in recent])
            if effective(value) >= _FEWEST_EVENTS:
                # As in the interval, the largest value counts twice, because large ones are rare.
                largest, n = float(value.max() / value.sum()), len(value)
                squared_cv = float(value.var() / value.mean() ** 2) + n * largest**2
                needed = _RESERVE * squared_cv / target_cv**2
                each = sum(units.episodes for units in recent) / n
            if not (flow and space.fixed):
                highest = min(highest, _high(_tried(recent, flow), lowest, len(value)))
        if (high := bound(rounds)[0]) is not None:
            highest = min(highest, high)
        if spent > min(needed * each, _ALLOWANCE + _ALLOWED_SHARE / (highest * target_cv**2)):
            p = float(np.concatenate([units.value for units in learned]).mean())
            by_brute_force = _RESERVE_OF_BRUTE_FORCE * (1 / p - 1) / target_cv**2 if p else 0.0
            cheaper = needed * each < by_brute_force
            return (proposal, needed) if cheaper else (Proposal(), by_brute_force)
        rounds.append(draw(proposal, len(rounds), count))
        proposal = _fit(proposal, rounds[looked:], space, lowest, rng)


def _high(tried: _Tried, lowest: int, units: int) -> float:
    """An upper bound of the probability; 1 if the draws of some units do not show one.

    An event has a score below every level, so it is no likelier than scores below the lowest ones.
    The bound is two standard errors above the estimate of the latter.
    """
    bounds = [1.0]
    for column in tried.own.T if len(tried.own) >= lowest else ():
        weights = tried.likely[column <= max(np.partition(column, lowest - 1)[lowest - 1], 0.0)]
        if (size := effective(weights)) >= _FEW_SCORES:
            bounds.append(math.exp(2 / math.sqrt(size)) * float(weights.sum()) / units)
    return min(bounds)


def _fit(
    proposal: Proposal, rounds: Sequence[Units], space: Space, lowest: int, rng: np.random.Generator
) -> Proposal:
    """The next proposal, fitted to the draws of all rounds."""
    size, first, tried = len(space.fixed), _tried(rounds, False), _tried(rounds, True)
    # Only the sign of a side's number matters: its size is drawn anew, or fits would narrow it.
    names = np.array([*space.fixed, "speed", "arrival", *space.marks])
    for points in (first.points, tried.points):
        if len(points):
            of = names[: points.shape[1]] == "side"
            points[:, of] = np.copysign(rng.standard_normal(points[:, of].shape), points[:, of])
    fixed = _fitted(first, np.ones(size, dtype=bool), lowest, rng) if size else None
    if len(tried.due) < lowest:  # nobody can be placed, or the ego passes too rarely
        return proposal._replace(fixed=fixed)
    # The nominal densities of the ego's speed and of the arrival are not standard normal.
    standard = np.ones(tried.points.shape[1], dtype=bool)
    standard[size : size + 2] = False
    placed = _fitted(tried, standard, lowest, rng)
    if placed is not None and tried.due.any():
        # Near misses at every speed may lead to other ways than those of the culprits so far.
        near, (rows,) = np.zeros(len(tried.due), dtype=bool), np.nonzero(~tried.due)
        by_speed = rows[np.argsort(tried.points[rows, size], kind="stable")]
        for part in np.array_split(by_speed, _BINS):
            for column in tried.own[part].T:
                near[part[np.argsort(column, kind="stable")[:_NEAREST]]] = True
        ways = fitted(tried.points[near], np.ones(int(near.sum())), standard, rng)
        placed = placed.mixed_with(ways, _OTHER_WAYS)
    if placed is not None and size:
        locations, scales = placed.locations[:, :size], placed.scales[:, :size, :size]
        marginal = NormalMixture(placed.weights, locations, scales)
        fixed = marginal if fixed is None else fixed.mixed_with(marginal, 0.5)
    return proposal._replace(fixed=fixed, placed=placed)


def _fitted(
    tried: _Tried, standard: NDArray[np.bool_], lowest: int, rng: np.random.Generator
) -> NormalMixture | None:
    """The density of those with an event or one of the lowest scores; None without any."""
    chosen = tried.due.copy()
    for column in tried.own.T:
        order = np.argsort(np.where(tried.due, -np.inf, column), kind="stable")[:lowest]
        chosen[order[np.isfinite(column[order])]] = True
    if not chosen.any():
        return None
    weights = tried.likely[chosen]
    clipped = np.minimum(weights, np.quantile(weights, _CLIPPED))
    return fitted(tried.points[chosen], clipped, standard, rng)


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
