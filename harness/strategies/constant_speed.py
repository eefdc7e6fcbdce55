"""The control case: no yielding at all."""

from harness.core.vocabulary import Observation
from harness.strategies.manoeuvres import resume


class ConstantSpeed:
    """Drives at v0 and never yields; the control case, which must crash if nobody else yields."""

    def decide(self, observation: Observation, /) -> float:
        """0, or the acceleration back to v0 if a vehicle ahead has slowed it (a simulation)."""
        return resume(observation)
