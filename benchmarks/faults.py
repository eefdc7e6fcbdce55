"""Strategies with a rare fault to which nothing leads: they try the bound of a risk."""

import numpy as np

from harness.core.vocabulary import Observation, PedestrianView, Side
from harness.strategies.hard_yield import HardYield

BLIND_FROM_MPS, BLIND_TO_MPS = 1.1000, 1.1001
"""Speeds of the far-side walkers whom ``Blind`` does not see."""


class Dead(HardYield):
    """Hard-Yield, but in one episode of 1/``share`` it never brakes.

    Args:
        rng: random numbers of this pair (given by the harness).
        share: of the episodes, 0 to 1.
    """

    def __init__(self, *, rng: np.random.Generator, share: float) -> None:
        super().__init__()
        self._dead = rng.random() < share

    def decide(self, observation: Observation, /) -> float:
        """Wanted acceleration in m/s²."""
        return 0.0 if self._dead else super().decide(observation)


class Blind(HardYield):
    """Hard-Yield that does not see walkers from the far side in a narrow range of speeds."""

    def decide(self, observation: Observation, /) -> float:
        """Wanted acceleration in m/s²."""
        seen = tuple(filter(_is_seen, observation.pedestrians))
        return super().decide(observation._replace(pedestrians=seen))


def _is_seen(view: PedestrianView) -> bool:
    return view.side is Side.NEAR or not BLIND_FROM_MPS <= view.speed_mps <= BLIND_TO_MPS
