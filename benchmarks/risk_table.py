"""The cases of ``benchmarks.risk`` with a rare fault, tabulated: hundreds of risks in a minute.

An episode of them is a function of side, quantile of the walking speed, look of the first detection
and whether the fault strikes.  Simulated once for each side, look and bin of quantiles, its scores
are looked up.  The truth is a sum over the table.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from benchmarks.risk import (
    CHUNK,
    DETECTION_PROBABILITY,
    LOOKS,
    blind_quantiles,
    looks,
    runner_of,
    scenario_of,
)
from harness.core.encounter import Arm, FloatArray
from harness.core.seeding import Given
from harness.studies.risk.event import parse_event
from harness.studies.risk.layout import Layout
from harness.studies.risk.outcomes import Evaluate, Outcomes

BINS = 100
"""Of the quantiles of the walking speed."""

LAYOUT = Layout(5)
"""Side, quantile, first detection, and what a strategy draws first."""

Struck = Callable[[FloatArray], NDArray[np.bool_]]
"""Which states the fault strikes."""

_SIDES = (0.25, 0.75)


class Tables:
    """Scores of Hard-Yield (side, look, bin, grading), and of one that never brakes."""

    def __init__(self) -> None:
        bins = ((np.arange(BINS) + 0.5) / BINS).tolist()
        chances = looks()
        self.seen = _scores(
            "missed",
            [
                {"side": [side], "quantile": [quantile], "detection": [detection]}
                for side in _SIDES
                for detection, _ in chances
                for quantile in bins
            ],
        ).reshape(2, LOOKS, BINS, -1)
        self.dead = _scores(
            "dead-3",
            [
                {"side": [side], "quantile": [quantile], "av_strategy": [1e-9]}
                for side in _SIDES
                for quantile in bins
            ],
        ).reshape(2, BINS, -1)
        self._chance = np.array([chance for _, chance in chances])

    def dying(self, share: float) -> tuple[Evaluate, float]:
        """Hard-Yield that is dead in a share of all episodes: episodes, and κ."""
        limit = ndtri(share)
        missed, dead = self._missed(), float((self.dead[..., 0] <= 0).mean())
        return self._evaluate(lambda z: z[:, 3] < limit), share * dead + (1 - share) * missed

    def blind(self) -> tuple[Evaluate, float]:
        """Hard-Yield that does not see far-side walkers of 1.1 m/s: episodes, and κ."""
        low, high = blind_quantiles()
        place = int(BINS * (low + high) / 2)
        hit = float(self.dead[1, place, 0] <= 0)
        seen = float(self._chance @ (self.seen[1, :, place, 0] <= 0))
        kappa = self._missed() + 0.5 * (high - low) * (hit - seen)
        between = ndtri(low), ndtri(high)
        return self._evaluate(
            lambda z: (z[:, 0] > 0) & (z[:, 1] >= between[0]) & (z[:, 1] <= between[1])
        ), kappa

    def _missed(self) -> float:
        crashed = (self.seen[..., 0] <= 0).mean(axis=(0, 2))
        return float(self._chance @ crashed)

    def _evaluate(self, struck: Struck) -> Evaluate:
        def evaluate(z: FloatArray, *_options: object) -> Outcomes:
            side = (z[:, 0] > 0).astype(int)
            place = np.minimum((BINS * ndtr(z[:, 1])).astype(int), BINS - 1)
            # 1 − u = Φ(−z), without rounding.
            wait = np.ceil(np.log(ndtr(-z[:, 2])) / np.log1p(-DETECTION_PROBABILITY))
            look = np.clip(wait, 1, LOOKS).astype(int) - 1
            faulty = struck(z)[:, None]
            score = np.where(faulty, self.dead[side, place], self.seen[side, look, place])
            never, nobody = np.full(len(z), np.nan), np.full(len(z), -1)
            return Outcomes(score, np.arange(len(z)), never, never, nobody, score)

        return evaluate


def _scores(case: str, people: list[Given]) -> FloatArray:
    """Scores of a case's episodes, shape (n, gradings)."""
    runner, event = runner_of(scenario_of(case, 0)), parse_event("crashed")
    pairs = [(0, given) for given in people]
    return np.array(
        [
            event.scores(outcome.record)
            for at in range(0, len(pairs), CHUNK)
            for outcome in runner.run_arm_given(Arm.AV, pairs[at : at + CHUNK], lambda _: None)
        ]
    )
