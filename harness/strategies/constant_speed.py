"""The control case: no yielding at all."""

from harness.encounter import Observation


class ConstantSpeed:
    """Keeps its speed whatever happens; must crash when geometry says so."""

    def decide(self, observation: Observation, /) -> float:  # noqa: ARG002
        """No acceleration, ever."""
        return 0.0
