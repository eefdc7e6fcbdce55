"""The interface that an episode asks of an engine."""

from collections.abc import Sequence
from typing import Protocol

from harness.core.encounter import Arrival, Side


class Engine(Protocol):
    """Moves one ego and holds pedestrians where they are told to be.

    One engine serves any number of episodes, one after another: ``begin``, ``step`` until the
    episode is over, ``end``.  It is bound to one crosswalk, one vehicle and one step length.
    """

    def begin(self, arrivals: Sequence[Arrival]) -> tuple[float, float]:
        """Insert the ego at the trigger.

        Args:
            arrivals: everyone who may come during the episode and is to be held, by arrival
                time.

        Returns:
            The ego's state (x of the front bumper in m, speed in m/s) at t = 0.
        """
        ...

    def step(
        self, speed_mps: float | None, pedestrians: Sequence[tuple[int, float]]
    ) -> tuple[float, float]:
        """Advance one step under constant acceleration.

        Args:
            speed_mps: the ego's speed at the end of the step; None lets the engine's own driver
                decide.
            pedestrians: (index, y in m at the end of the step) of everyone who has arrived and
                not left, waiting ones included.

        Returns:
            The ego's state (x, speed) at the end of the step.
        """
        ...

    def let_walk(self, index: int, side: Side, speed_mps: float) -> None:
        """Let a pedestrian come from that side and walk by the engine's own model.

        From the next step on, wanting that speed; they are not among those whom ``begin`` named.

        Raises:
            EngineError: the engine has no pedestrians of its own.
        """
        ...

    def place_of(self, index: int) -> tuple[float, float]:
        """(x, y) in m of someone who walks by the engine's own model."""
        ...

    def remove(self, index: int) -> None:
        """Take away a pedestrian who has reached the other kerb."""
        ...

    def end(self) -> bool | None:
        """Clear the road.

        Returns:
            Whether the engine itself saw the ego hit a pedestrian; None where it cannot tell.
        """
        ...

    def close(self) -> None:
        """Release the simulation; the engine cannot be used afterwards."""
        ...
