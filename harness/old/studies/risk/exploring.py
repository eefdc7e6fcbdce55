"""Stage one: locates the event by subset simulation in normal space (Au & Beck 2001).

Each level has a lower score, until the event is reached.  In each level, chains move by the
preconditioned Crank–Nicolson step, component by component (Papaioannou et al. 2015, adaptive
conditional sampling).  The result is a set of points in the event, which only the proposal uses.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import FloatArray
from harness.old.studies.risk.interval import Tally
from harness.old.studies.risk.layout import Layout
from harness.old.studies.risk.outcomes import Evaluate

POINTS = 1_000
"""Number of episodes in a level."""

_LEVEL_SHARE = 0.1
"""Share of a level's points from which the next level starts."""

_MOST_LEVELS = 24
"""Maximum number of levels.  With a tenth per level, they reach any relevant probability."""

_STANDSTILL = 3
"""The exploration ends after this number of levels without a lower score."""

_LOWER = 1e-3
"""Relative decrease that counts as a lower score, because a score may converge endlessly."""

_PARTS = (0.1, 0.3, 0.6)
"""Shares of the uniforms that a move redraws."""

_ANEW = 0.2
"""Share of the moves that redraw a part of the uniforms; the others shift all uniforms a little."""

_ACCEPTED = 0.4
"""Target acceptance rate of the small moves, to which the step is adapted."""

_LEAST_STEP = 0.02
"""Smallest step.  The largest step is 1, an independent draw."""


Graded = Callable[[FloatArray, str], FloatArray]
"""Returns the scores, shape (n,), of states that are run for a purpose."""


@dataclass(frozen=True, slots=True)
class Exploration:
    """The result of one exploration.

    ``failures`` (n, width) are the states in the event; n may be 0.  ``levels`` are the thresholds.
    ``probability`` is the estimate by subset simulation.  ``nominal`` counts the first ``POINTS``
    episodes, which are nominal draws.  ``nearest`` is the lowest score.
    """

    failures: FloatArray
    levels: tuple[float, ...]
    probability: float
    nominal: Tally
    nearest: float


def explore(
    evaluate: Evaluate, layout: Layout, rng: np.random.Generator, grading: int = 0
) -> Exploration:
    """Lower the score until the event is reached or no lower score is found.

    Args:
        evaluate: runs episodes.
        layout: layout of the states.
        rng: draws the starting points and the moves.
        grading: index of the score to lower, modulo the number of scores.
    """

    def graded(z: FloatArray, what: str) -> FloatArray:
        scores = evaluate(z, what).score
        score = scores[:, grading % scores.shape[1]]
        return np.where(np.isnan(score), np.inf, score)

    z = layout.draw(POINTS, rng)
    score = graded(z, "exploring")
    nominal, nearest = Tally(POINTS, int(np.sum(score <= 0))), float(score.min())
    levels: list[float] = []
    probability, standstill = 1.0, 0
    moves = _Moves(graded, rng)
    while standstill < _STANDSTILL and len(levels) < _MOST_LEVELS:
        level, inside = _next_level(score)
        if not inside.any():
            break
        levels.append(level)
        probability *= float(inside.mean())
        what = f"exploring, level {len(levels)}"
        z, score = moves(z[inside], score[inside], level, what)
        if level == 0:
            states = [moves(z[n::4], score[n::4], 0.0, "in the event")[0] for n in range(3)]
            return Exploration(np.concatenate(states), tuple(levels), probability, nominal, nearest)
        standstill = standstill + 1 if score.min() > (1 - _LOWER) * nearest else 0
        nearest = min(nearest, float(score.min()))
    return Exploration(z[:0], tuple(levels), 0.0, nominal, nearest)


def _next_level(score: FloatArray) -> tuple[float, NDArray[np.bool_]]:
    """Return the next threshold, at least 0, and which points are at or below it.

    If the threshold would be the highest score, the next lower score replaces it; 0 if there is
    none.
    """
    level = float(np.sort(score)[int(_LEVEL_SHARE * len(score)) - 1])
    if level == score.max():
        below = score[score < level]
        level = float(below.max()) if len(below) else -math.inf
    level = max(level, 0.0)
    return level, score <= level


class _Moves:
    """Chains from seeds, with a step that is adapted during an exploration.

    Most moves shift all uniforms a little, by a step adapted to the acceptance rate.  The other
    moves redraw a random part of the uniforms, so that chains separate.  Otherwise all points
    would descend from a few seeds, and a way to the event could be lost.
    """

    def __init__(self, graded: Graded, rng: np.random.Generator) -> None:
        self._graded, self._rng = graded, rng
        self._scale = 0.5

    def __call__(
        self, seeds: FloatArray, scores: FloatArray, level: float, what: str
    ) -> tuple[FloatArray, FloatArray]:
        """Move every seed until ``POINTS`` points are at or below the level."""
        rng, z, score = self._rng, seeds, scores
        points, kept = [z], [score]
        for _ in range(1, -(-POINTS // len(seeds))):
            chains = (len(z), 1)
            redrawn = rng.random(chains) < _ANEW
            share = np.where(redrawn, rng.choice(_PARTS, chains), 1.0)
            part = rng.random(z.shape) < share
            step = np.minimum(1.0, self._scale * np.exp(rng.uniform(-1.0, 1.0, chains)))
            size = np.where(redrawn, 1.0, step)
            drawn = np.sqrt(1 - size**2) * z + size * rng.standard_normal(z.shape)
            moved = np.where(part, drawn, z)
            result = self._graded(moved, what)
            accepted = result <= level
            small = accepted[~redrawn[:, 0]]
            if len(small):
                scale = self._scale * math.exp(float(small.mean()) - _ACCEPTED)
                self._scale = min(1.0, max(_LEAST_STEP, scale))
            z, score = np.where(accepted[:, None], moved, z), np.where(accepted, result, score)
            points.append(z)
            kept.append(score)
        return np.concatenate(points)[-POINTS:], np.concatenate(kept)[-POINTS:]
