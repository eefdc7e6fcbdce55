"""How the densities of a risk's draws are learned.

They are learned in rounds by the cross-entropy method (Rubinstein & Kroese, ch. 2): each is fitted
to the draws of all rounds with the lowest scores.  No round but the last is in the estimate.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa

from harness.core.freezing import Frozen
from harness.core.vocabulary import BoolArray, FloatArray
from harness.model.mixture.normals import effective
from harness.studies.risk.densities import NormalMixture, fitted
from harness.studies.risk.draws import Proposal, Units, bound
from harness.studies.risk.space import Space

_LOOKS = 1_000
"""Nominal draws of a round of the first look."""

_MOST_LOOKS = 4_000
"""Nominal draws after which the first look ends at the latest."""

_LOOK_EVENTS = (4, 0.25)
"""The first look ends at this number of events, or at this share of 1/cv² if that is more."""

_ROUND, _ROUND_WITHOUT_FLOW = (100, 40), (1_000, 150)
"""Units of a round of learning, and number of lowest scores of each grading to which a density is
fitted, with a flow of people and without.  Of fewer a fit would lose the less likely of several
ways to the event."""

_PLACED = 3.0
"""Mean number of placed people in a unit."""

_CLIPPED = 0.9
"""Weights above this quantile are reduced to it for a fit, so that no single draw dominates it."""

_RECENT = 2_400
"""Number of latest units by which the cost of an estimate is predicted."""

_FEWEST_EVENTS = 25.0
"""Effective number of events among these units below which the cost cannot be predicted."""

_FEW_SCORES = 5.0
"""Effective number of low scores below which they do not bound the probability."""

_OTHER_WAYS = 0.2
"""Share of the placed people who look for other ways to the event."""

_NEAREST = 6
"""Number of lowest scores of each grading, in a range of speeds, that lead to other ways."""

_BINS = 20
"""Number of ranges of speeds, with equally many draws."""

_ALLOWANCE = 5_000
"""Number of episodes that learning may take in any case."""

_ALLOWED_SHARE = 0.08
"""Share of the episodes of brute force that learning may take besides."""

_RESERVE, _RESERVE_OF_BRUTE_FORCE = 2.5, 1.25
"""Multiples of the predicted number of draws, weighted and by brute force: large weights appear
late."""

_LEAST_DRAWS = 4_000
"""Least number of draws of an estimate whose people are not placed."""


@dataclass(frozen=True)
class _Tried(Frozen):
    """What was drawn from a learned density.

    Points (n, d), their own scores (n, gradings), whether an event was due to them, and the nominal
    density over theirs (n,).
    """

    points: FloatArray
    own: FloatArray
    due: BoolArray
    likely: FloatArray


def _tried(rounds: Sequence[Units], *, placed: bool) -> _Tried:
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
    flow, looked = bool(space.rate_per_s), len(rounds)
    count, lowest = _ROUND if flow else _ROUND_WITHOUT_FLOW
    proposal = Proposal(many=_PLACED * flow)
    needed, highest, each = math.inf, 1.0, 1.0
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
                highest = min(highest, _high(_tried(recent, placed=flow), lowest, len(value)))
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
    if len(tried.own) < lowest:
        return 1.0
    for column in tried.own.T:
        weights = tried.likely[column <= max(np.partition(column, lowest - 1)[lowest - 1], 0.0)]
        if (size := effective(weights)) >= _FEW_SCORES:
            bounds.append(math.exp(2 / math.sqrt(size)) * float(weights.sum()) / units)
    return min(bounds)


def _fit(
    proposal: Proposal, rounds: Sequence[Units], space: Space, lowest: int, rng: np.random.Generator
) -> Proposal:
    """The next proposal, fitted to the draws of all rounds."""
    size, first, tried = len(space.fixed), _tried(rounds, placed=False), _tried(rounds, placed=True)
    # Only the sign of a side's number matters: its size is drawn anew, or fits would narrow it.
    side = np.array([*space.fixed, "speed", "arrival", *space.marks]) == "side"
    first, tried = (_with_other_sides(each, side, rng) for each in (first, tried))
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


def _with_other_sides(tried: _Tried, side: BoolArray, rng: np.random.Generator) -> _Tried:
    """The same draws, with new sizes of the numbers that stand for a side."""
    points = tried.points.copy()
    side = side[: points.shape[1]]
    points[:, side] = np.copysign(rng.standard_normal(points[:, side].shape), points[:, side])
    return replace(tried, points=points)


def _fitted(
    tried: _Tried, standard: BoolArray, lowest: int, rng: np.random.Generator
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
