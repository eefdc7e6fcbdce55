"""The control case: no yielding at all."""

from harness.core.encounter import Observation
from harness.strategies.driving import resume


class ConstantSpeed:
    """Drives at v0 whatever happens; must crash when geometry says so."""

    def decide(self, observation: Observation, /) -> float:
        """Back to v0 where the vehicle before has slowed it, as in hours of traffic; else 0."""
        return resume(observation)
