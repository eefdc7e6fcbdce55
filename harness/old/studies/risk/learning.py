"""Learns where a placed pedestrian is in danger: the cross-entropy method in rounds.

Each round draws units from the density of the last one.  The next density is fitted to the placed
pedestrians of all rounds whose own scores are lowest, weighted by their nominal density (Rubinstein
& Kroese, The cross-entropy method, ch. 2).  The draws are independent, so no chain of similar
states can take the place of a way to the event.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import FloatArray
from harness.old.studies.risk.exploring import Exploration
from harness.old.studies.risk.interval import Tally
from harness.old.studies.risk.layout import Layout
from harness.old.studies.risk.normals import Normals, fitted
from harness.old.studies.risk.outcomes import Counted
from harness.old.studies.risk.placing import Placing, Units

_UNITS = 100
"""Number of units in a round."""

_PLACED = 4.0
"""Mean number of placed pedestrians in a unit of the first rounds."""

_PLACED_LATER = 2.0
"""The same number after that."""

_LOWEST = 40
"""Number of lowest scores of each grading to which a density is fitted."""

_ENOUGH_HITS = 100
"""Number of placed culprits that show in which flows the ego is in danger."""

_CLIPPED = 0.9
"""Weights above this quantile are reduced to it for a fit, so that no single draw dominates it."""

_LAST_ROUNDS = 24
"""Number of rounds from which the cost of an estimate is predicted."""

_FEWEST_EVENTS = 25.0
"""Effective number of events in these rounds below which the cost cannot be predicted."""

_FEW_SCORES = 5.0
"""Effective number of low scores below which they do not bound the probability."""

_OTHER_WAYS = 0.2
"""Share of the placed pedestrians who look for other ways to the event."""

_NEAREST = 6
"""Number of lowest scores of each grading, at similar speeds, that lead there."""

_BINS = 20
"""Number of ranges of the ego's speed with about equally many passages."""

_EVERYWHERE = 0.05
"""Share of the placed pedestrians that is independent of the speed."""

_ALLOWANCE = 8_000
"""Number of episodes that learning may take in any case ..."""

_ALLOWED_SHARE = 0.08
"""... and the share of the episodes of brute force that it may take besides."""


class Learning:
    """Learns a ``Placing`` and predicts what an estimate with it costs.

    Args:
        evaluate: runs and counts episodes.
        layout: layout of the states, with a crowd.
        rng: generator for all draws.

    ``proposal`` is the newest one.  ``tally`` counts the nominal draws.  ``probability`` is the
    mean of all rounds.  ``squared_cv`` of a unit's value and ``cost``, the episodes of a unit, are
    predicted by the last rounds; None if they have too few events.
    """

    def __init__(self, evaluate: Counted, layout: Layout, rng: np.random.Generator) -> None:
        self._evaluate, self._layout, self._rng = evaluate, layout, rng
        everywhere = np.array([_PLACED])
        self.proposal = Placing(layout, None, None, np.empty(0), everywhere)
        self.tally = Tally(0, 0)
        self.squared_cv: float | None = None
        self.cost, self.probability = math.nan, 0.0
        self._rounds: list[tuple[Units, int]] = []
        self._levels: list[FloatArray] = []

    def learn(self, target_cv: float, pilot: Tally, reserve: float) -> None:
        """Draw rounds until more of them would cost more than they save, or too many episodes.

        Args:
            target_cv: target coefficient of variation of the estimate.
            pilot: nominal draws from before.
            reserve: multiple of the predicted draws that the estimate uses.
        """
        begun, highest = self._evaluate.episodes, 1.0
        while True:
            spent = self._evaluate.episodes - begun
            highest = min(highest, (self.tally + pilot).high, self._high())
            if spent > _ALLOWANCE + _ALLOWED_SHARE / (highest * target_cv**2):
                return
            if self.squared_cv is not None:
                estimate = reserve * self.squared_cv * self.cost / target_cv**2
                if estimate < spent:
                    return
            self._round()

    def explorations(self) -> tuple[Exploration, ...]:
        """Return the scores of each grading that the rounds reached."""
        if not self._levels:
            return ()
        nearest = np.minimum.accumulate(np.array(self._levels))
        return tuple(
            Exploration(
                np.empty((0, self._layout.width)),
                tuple(float(level) for level in column if math.isfinite(level)),
                0.0,
                Tally(0, 0),
                float(column[-1]),
            )
            for column in nearest.T
        )

    def _round(self) -> None:
        before = self._evaluate.episodes
        what = f"learning, round {len(self._rounds) + 1}"
        units = self.proposal.draw(_UNITS, self._evaluate, self._rng, what)
        self._rounds.append((units, self._evaluate.episodes - before))
        self.tally += units.nominal
        self._predict()
        self._fit()

    def _high(self) -> float:
        """Return an upper bound of the probability; 1 if the rounds do not show one.

        An event that is due to somebody in the crowd is a score below every level, so it is no
        likelier than scores below the lowest level so far.  The bound is two standard errors above
        the estimate of the latter.
        """
        if self._layout.fixed or not self._levels:
            return 1.0
        last = [units for units, _ in self._rounds[-_LAST_ROUNDS:]]
        own, likely = (
            np.concatenate([getattr(units, name) for units in last]) for name in ("own", "likely")
        )
        bounds = [1.0]
        for column, level in zip(own.T, self._levels[-1], strict=True):
            weights = likely[column <= max(level, 0.0)]
            if _effective(weights) >= _FEW_SCORES:
                high = math.exp(2 / math.sqrt(_effective(weights)))
                bounds.append(high * float(weights.sum()) / (_UNITS * len(last)))
        return min(bounds)

    def _values(self, rounds: int) -> FloatArray:
        """Return the values of the units of the last rounds."""
        return np.concatenate([np.empty(0), *(units.value for units, _ in self._rounds[-rounds:])])

    def _predict(self) -> None:
        self.probability = float(self._values(len(self._rounds)).mean())
        last = self._values(_LAST_ROUNDS)
        if _effective(last) >= _FEWEST_EVENTS:
            # As in the interval, the largest value counts twice, because large values are rare.
            largest = float(last.max()) / float(last.sum())
            self.squared_cv = float(last.var()) / float(last.mean()) ** 2 + len(last) * largest**2
            episodes = sum(episodes for _, episodes in self._rounds[-_LAST_ROUNDS:])
            self.cost = episodes / len(last)

    def _fit(self) -> None:
        tried, own, hit, likely = (
            np.concatenate(parts)
            for parts in zip(
                *((units.tried, units.own, units.hit, units.likely) for units, _ in self._rounds),
                strict=True,
            )
        )
        if len(own) < _LOWEST:  # the ego passes too rarely for placing anybody
            return
        own = np.where(np.isnan(own), np.inf, own)
        own[~hit & (own[:, 0] <= 0)] = math.ulp(0.0)
        chosen = _lowest(own, hit)
        self._levels.append(np.partition(own, _LOWEST - 1, axis=0)[_LOWEST - 1])
        if not chosen.any():
            return
        # The nominal densities of the ego's speed and of the arrival are not standard normal.
        standard = np.ones(tried.shape[1], dtype=bool)
        standard[self._layout.fixed : self._layout.fixed + 2] = False
        placed = fitted(tried[chosen], _clipped(likely[chosen]), standard, self._rng)
        if hit.any():
            # Near misses at every speed may lead to other ways than those of the culprits so far.
            near = _nearest(own, hit, tried[:, self._layout.fixed])
            ways = fitted(tried[near], np.ones(int(near.sum())), standard, self._rng)
            placed = placed.mixed_with(ways, _OTHER_WAYS)
        fixed = self._fixed(placed) if self._layout.fixed else None
        self.proposal = replace(self.proposal, fixed=fixed, placed=placed)
        if hit.sum() >= _ENOUGH_HITS:
            self._count(tried[hit, self._layout.fixed], likely[hit])

    def _fixed(self, placed: Normals) -> Normals:
        """Return the density of the fixed uniforms: for culprits among all others, and placed."""
        rounds = [units for units, _ in self._rounds]
        points = np.concatenate([units.fixed for units in rounds])
        own = np.concatenate([units.first.own for units in rounds])
        weights = np.concatenate([units.fixed_weight for units in rounds])
        mine = np.concatenate([units.first.event & (units.first.culprit < 0) for units in rounds])
        own = np.where(np.isnan(own), np.inf, own)
        chosen = _lowest(own, mine)
        marginal = placed.first(self._layout.fixed)
        if not chosen.any():
            return marginal
        standard = np.ones(points.shape[1], dtype=bool)
        own_density = fitted(points[chosen], _clipped(weights[chosen]), standard, self._rng)
        return own_density.mixed_with(marginal, 0.5)

    def _count(self, speeds_mps: FloatArray, weights: FloatArray) -> None:
        """Place more pedestrians where the ego passes at speeds at which culprits are likelier.

        The number that minimises the variance for its episodes is proportional to the standard
        deviation of a placed pedestrian's weight (Neyman's allocation), which is here taken as the
        square root of the probability of a culprit.
        """
        passed = np.concatenate([units.first.passed_mps for units, _ in self._rounds])
        passed = passed[~np.isnan(passed)]
        edges = np.unique(np.quantile(passed, np.arange(1, _BINS) / _BINS))
        share = np.bincount(np.searchsorted(edges, passed), minlength=len(edges) + 1) / len(passed)
        mass = np.bincount(np.searchsorted(edges, speeds_mps), weights, len(edges) + 1)
        root = np.sqrt(mass / mass.sum() / np.maximum(share, 1 / len(passed)))
        shape = (1 - _EVERYWHERE) * root / float(share @ root) + _EVERYWHERE
        self.proposal = replace(self.proposal, edges_mps=edges, counts=_PLACED_LATER * shape)


def _lowest(own: FloatArray, hit: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which rows are culprits or have one of the lowest scores of a grading."""
    chosen = hit.copy()
    for column in own.T:
        scores = np.where(hit, -np.inf, column)
        lowest = np.argsort(scores, kind="stable")[:_LOWEST]
        chosen[lowest[np.isfinite(column[lowest])]] = True
    return chosen


def _nearest(own: FloatArray, hit: NDArray[np.bool_], speeds_mps: FloatArray) -> NDArray[np.bool_]:
    """Return which rows have the lowest scores of those that the ego passes at a similar speed."""
    near = np.zeros(len(own), dtype=bool)
    (rows,) = np.nonzero(~hit)
    for part in np.array_split(rows[np.argsort(speeds_mps[rows], kind="stable")], _BINS):
        for column in own[part].T:
            near[part[np.argsort(column, kind="stable")[:_NEAREST]]] = True
    return near


def _clipped(weights: FloatArray) -> FloatArray:
    return np.minimum(weights, np.quantile(weights, _CLIPPED))


def _effective(value: FloatArray) -> float:
    """Return Kish's effective number, (Σv)²/Σv²; 0 if all values are 0."""
    squares = float(np.sum(value**2))
    return float(value.sum()) ** 2 / squares if squares else 0.0
