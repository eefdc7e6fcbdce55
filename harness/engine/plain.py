"""The plain engine: SUMO's kinematics in a few lines of Python.

It tests strategies, episodes and measures in milliseconds, and tests compare SUMO with it.
It detects no collisions.
"""

from collections.abc import Sequence

from harness.core.encounter import Arrival, Vehicle


class PlainEngine:
    """Ballistic motion: constant acceleration within a step.

    Args:
        vehicle: the ego.
        step_s: length of a step.
    """

    def __init__(self, vehicle: Vehicle, step_s: float) -> None:
        self._start = (-vehicle.trigger_range_m, vehicle.initial_speed_mps)
        self._step_s = step_s
        self._x, self._speed = self._start

    def begin(self, arrivals: Sequence[Arrival]) -> tuple[float, float]:  # noqa: ARG002
        """See ``Engine.begin``."""
        self._x, self._speed = self._start
        return self._start

    def step(
        self,
        speed_mps: float,
        pedestrians: Sequence[tuple[int, float]],  # noqa: ARG002
    ) -> float:
        """See ``Engine.step``."""
        self._x += (self._speed + speed_mps) / 2 * self._step_s
        self._speed = speed_mps
        return self._x

    def remove(self, index: int) -> None:
        """See ``Engine.remove``; this engine keeps no pedestrians."""

    def end(self) -> bool | None:
        """None, because this engine detects no collisions."""
        return None

    def close(self) -> None:
        """Nothing to release."""
