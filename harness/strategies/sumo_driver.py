"""SUMO's own driver: what a SUMO user has today."""

from harness.core.encounter import Observation


class SumoDriver:
    """Hands the ego to SUMO's own car-following and junction model at every step.

    It drives at most at v0, speeds up with a0 and brakes up to the vehicle's maximum; who has
    priority at the crosswalk is ``crossing.pedestrian_priority``.  SUMO alone can do that: on the
    plain engine it is an error.  How it reacts to pedestrians: docs/sumo.md.
    """

    def decide(self, observation: Observation, /) -> None:  # noqa: ARG002
        """None: SUMO drives."""
        return
