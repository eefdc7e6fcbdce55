"""SUMO's own driver model."""

from harness.core.encounter import Observation


class SumoDriver:
    """Lets SUMO's own car-following and junction model drive the ego at every step.

    It drives at most at v0, accelerates with a0 and brakes up to the vehicle's maximum.
    ``crossing.pedestrian_priority`` decides who has priority at the crosswalk.  The plain engine
    has no such driver and reports an error.  docs/sumo.md describes how it reacts to pedestrians.
    """

    def decide(self, observation: Observation, /) -> None:  # noqa: ARG002
        """None, which lets SUMO drive."""
        return
