"""SUMO's own driver model."""

from harness.core.vocabulary import Observation


class SumoDriver:
    """Lets SUMO's own car-following and junction model drive at every step of a simulation.

    It is refused without ``[simulation]``.
    """

    def decide(self, observation: Observation, /) -> float:
        """Not asked: where this name stands, SUMO drives."""
        raise NotImplementedError
