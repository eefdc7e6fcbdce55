"""The vehicles of a lane as pedestrians at the crosswalk see them."""

from collections.abc import Iterator
from typing import Protocol

from harness.core.encounter import Vehicle


class Approaching(Protocol):
    """A vehicle that approaches the crosswalk, in its state at the beginning of the step."""

    @property
    def x_m(self) -> float:
        """Position of the front bumper along the road."""

    @property
    def speed_mps(self) -> float:
        """Its speed."""

    @property
    def acceleration_mps2(self) -> float:
        """Its acceleration."""

    @property
    def passed(self) -> bool:
        """Whether its rear has left the crosswalk."""

    @property
    def vehicle(self) -> Vehicle:
        """Its constants."""


class LaneAhead(Protocol):
    """A lane as pedestrians see it: y of its centre, and of its two edges."""

    centre_m: float
    edges_m: tuple[float, float]

    def ahead(self, elapsed_s: float) -> Iterator[tuple[float, float, Approaching]]:
        """x, speed and object of the vehicles not yet past, ``elapsed_s`` into the step, in order.

        It ends with the first vehicle that no strategy drives yet.
        """
        ...

    def first(self, elapsed_s: float) -> tuple[float, float, Approaching] | None:
        """The first of the vehicles that are not yet past."""
        ...
