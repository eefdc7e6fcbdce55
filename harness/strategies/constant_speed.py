"""The control case: no yielding at all."""

from harness.core.vocabulary import Observation
from harness.strategies.manoeuvres import towards_v0


class ConstantSpeed:
    """Drives at v0 and never yields; the control case, which must crash if nobody else yields."""

    KEEPS_START_SPEED = True
    """In place of a recorded driver its v0 is the speed at the start."""

    def decide(self, observation: Observation, /) -> float:
        """0, or the acceleration back to v0 if a vehicle ahead has slowed it (a simulation)."""
        return towards_v0(observation)
