"""The plain engine: SUMO's kinematics in a few lines of Python.

It tests strategies, episodes and measures in milliseconds, and tests compare SUMO with it.
It has no driver of its own and detects no collisions.
"""

from collections.abc import Sequence

from harness.core.encounter import Arrival, Side, Vehicle
from harness.core.errors import EngineError

_NO_PEDESTRIANS = (
    'the plain engine has no pedestrians of its own: pedestrians.behaviour = "sumo" needs SUMO'
)


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
        speed_mps: float | None,
        pedestrians: Sequence[tuple[int, float]],  # noqa: ARG002
    ) -> tuple[float, float]:
        """See ``Engine.step``."""
        if speed_mps is None:
            raise EngineError("the plain engine has no driver of its own: this strategy needs SUMO")
        self._x += (self._speed + speed_mps) / 2 * self._step_s
        self._speed = speed_mps
        return self._x, self._speed

    def let_walk(self, index: int, side: Side, speed_mps: float) -> None:  # noqa: ARG002
        """Refused; see ``Engine.let_walk``."""
        raise EngineError(_NO_PEDESTRIANS)

    def place_of(self, index: int) -> tuple[float, float]:  # noqa: ARG002
        """Refused; see ``Engine.place_of``."""
        raise EngineError(_NO_PEDESTRIANS)

    def remove(self, index: int) -> None:
        """See ``Engine.remove``; this engine keeps no pedestrians."""

    def end(self) -> bool | None:
        """None, because this engine detects no collisions."""
        return None

    def close(self) -> None:
        """Nothing to release."""
