"""The road frame of the crosswalk that a scenario describes, in its network's coordinates.

In the road frame x is along the ego's direction; it is 0 on the crosswalk's centre line.  y is
along the crosswalk, from the near kerb (0), which is on the ego's right, to the far kerb.  The
network's origin is the crosswalk's centre.
"""

import math
from dataclasses import dataclass
from typing import TypeVar

from harness.core.vocabulary import FloatArray

Numbers = TypeVar("Numbers", float, FloatArray)


@dataclass(frozen=True, slots=True)
class RoadFrame:
    """The road frame: its origin in metres east and north, and the unit vector along the road."""

    origin_x_m: float
    origin_y_m: float
    along_x: float
    along_y: float

    @classmethod
    def of(cls, bearing_deg: float, length_m: float) -> "RoadFrame":
        """The frame of a road.

        Args:
            bearing_deg: the ego's direction, clockwise from the network's north.
            length_m: the crosswalk's length from kerb to kerb.
        """
        bearing = math.radians(bearing_deg)
        east, north = math.sin(bearing), math.cos(bearing)
        return cls(north * length_m / 2, -east * length_m / 2, east, north)

    def to_network(self, x_m: Numbers, y_m: Numbers) -> tuple[Numbers, Numbers]:
        """Network coordinates (m) of a point of the road frame (m)."""
        return (
            self.origin_x_m + x_m * self.along_x - y_m * self.along_y,
            self.origin_y_m + x_m * self.along_y + y_m * self.along_x,
        )
