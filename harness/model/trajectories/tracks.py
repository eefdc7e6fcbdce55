"""Holds the records that every reader of trajectories returns.

A clip has the tracks of vehicles and pedestrians that were recorded together. If a sensor on the
vehicle measured the pairs, the clip also has sightings. The model's variables then come from the
sightings instead of the crossings of paths.
"""

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
class Sighting:
    """The variables of one pair, measured by a sensor on the vehicle.

    Attributes:
        vehicle, pedestrian: keys of the clip's tracks.
        time_s: (n,) strictly increasing.
        range_m: (n,) R from the front bumper.
        lateral_m: (n,) L, negative after the pedestrian passed the vehicle's line.
        vehicle_speed_mps: (n,).
        pedestrian_speed_mps: one speed for the whole sighting.
        crossing_angle_deg: angle between the two directions of motion, 0–180.
    """

    vehicle: str
    pedestrian: str
    time_s: FloatArray
    range_m: FloatArray
    lateral_m: FloatArray
    vehicle_speed_mps: FloatArray
    pedestrian_speed_mps: float
    crossing_angle_deg: float

    def __post_init__(self) -> None:
        for name in ("time_s", "range_m", "lateral_m", "vehicle_speed_mps"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class Clip:
    """Tracks recorded together: one video clip, or one trip of an instrumented vehicle.

    Attributes:
        source: the data set's name.
        name: the clip's name, unique within the source.
        vehicles, pedestrians: tracks by identifier, in a fixed order.
        sightings: the pairs that a sensor measured; None if pairs are found from the paths.
        y_down: whether y points down if x points right, as in images; maps must flip this axis.
        site: the place, if a source has several places; clips of one site share axes and a map.
    """

    source: str
    name: str
    vehicles: Mapping[str, VehicleTrack]
    pedestrians: Mapping[str, Track]
    sightings: tuple[Sighting, ...] | None = None
    y_down: bool = False
    site: str = ""
