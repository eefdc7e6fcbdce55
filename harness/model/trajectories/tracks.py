"""Tracks of vehicles and pedestrians that were recorded together."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from harness.core.encounter import FloatArray


def read_only(values: FloatArray) -> FloatArray:
    """A float copy that cannot be written to."""
    copy = np.array(values, dtype=np.float64)
    copy.setflags(write=False)
    return copy


@dataclass(frozen=True, eq=False)
class Track:
    """One object's positions.

    Attributes:
        time_s: (n,) strictly increasing, on the clip's clock.
        position_m: (n, 2) x and y in the clip's metric axes.
    """

    time_s: FloatArray
    position_m: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_s", read_only(self.time_s))
        object.__setattr__(self, "position_m", read_only(self.position_m))


@dataclass(frozen=True, eq=False)
class VehicleTrack(Track):
    """A vehicle's positions and where its bumpers are along its path.

    Attributes:
        length_m: bumper to bumper.
        front_offset_m: distance from the recorded point to the front bumper; half the length if the
            centre is recorded, 0 if the bumper is.
    """

    length_m: float
    front_offset_m: float


@dataclass(frozen=True, eq=False)
class Clip:
    """Tracks recorded together, as in one video clip.

    Attributes:
        source: the data set's name.
        name: the clip's name, unique within the source.
        vehicles, pedestrians: tracks by identifier, in a fixed order.
        y_down: whether y points down if x points right, as in images.
    """

    source: str
    name: str
    vehicles: Mapping[str, VehicleTrack]
    pedestrians: Mapping[str, Track]
    y_down: bool = False
