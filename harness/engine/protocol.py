"""The interface of an engine that an episode needs."""

from collections.abc import Sequence
from typing import Protocol

from harness.core.vocabulary import Arrival


class Engine(Protocol):
    """An engine moves one ego and sets pedestrians to given positions.

    One engine serves any number of episodes, one after another: ``begin``, ``step`` until the
    episode is over, ``end``.  It is bound to one crosswalk, one vehicle and one step length.
    ``closed`` says whether ``close`` was called.
    """

    closed: bool

    def begin(self, arrivals: Sequence[Arrival]) -> tuple[float, float]:
        """Insert the ego at the trigger.

        Args:
            arrivals: all pedestrians who may arrive during the episode, by arrival time.

        Returns:
            The ego's state (x of the front bumper in m, speed in m/s) at t = 0.
        """

    def step(self, speed_mps: float, pedestrians: Sequence[tuple[int, float]]) -> float:
        """Advance one step under constant acceleration.

        Args:
            speed_mps: the ego's speed at the end of the step.
            pedestrians: (index, y in m at the end of the step) of all pedestrians who have arrived
                and not left; waiting pedestrians are included.

        Returns:
            The ego's x at the end of the step.
        """

    def remove(self, index: int) -> None:
        """Remove a pedestrian who has reached the other kerb."""

    def end(self) -> bool | None:
        """Clear the road.

        Returns:
            Whether the engine itself detected that the ego hit a pedestrian; None if it detects no
            collisions.
        """

    def close(self) -> None:
        """Release the simulation; the engine cannot be used afterwards."""
