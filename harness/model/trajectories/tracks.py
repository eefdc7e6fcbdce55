"""Tracks of vehicles and pedestrians that were recorded together, and their fingerprints.

A fingerprint is the hash of the track's mean position over the first and over the second half of
its time, in cells of 1 mm. These four numbers do not depend on names, the order of the records, the
origin of the clock or the frame rate. Noise below 1 mm changes each number by at most one cell, so
a search for a track covers its own cell and the neighbouring cells. Positions cannot be recovered
from a hash.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from harness.core.encounter import FloatArray

_CELLS_PER_M = 1000.0
_INSTANTS = 200
_DIGITS = 16


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


def fingerprint(track: Track) -> str:
    """The hash of a track's two mean positions, as cells of 1 mm; 16 hexadecimal digits."""
    return _hash(_cell(track))


def fingerprints_of(clips: Iterable[Clip]) -> frozenset[str]:
    """The fingerprints of the vehicles' own and neighbouring cells, for a search in a card."""
    return frozenset(
        _hash(cell)
        for clip in clips
        for track in clip.vehicles.values()
        for cell in product(*((at - 1, at, at + 1) for at in _cell(track)))
    )


def _cell(track: Track) -> list[int]:
    begin, end = track.time_s[[0, -1]]
    at = begin + (np.arange(_INSTANTS) + 0.5) / _INSTANTS * (end - begin)
    means = [
        np.interp(half, track.time_s, track.position_m[:, axis]).mean()
        for half in np.split(at, 2)
        for axis in (0, 1)
    ]
    return [int(mean) for mean in np.rint(np.array(means) * _CELLS_PER_M)]


def _hash(cell: Iterable[int]) -> str:
    return hashlib.sha256(",".join(map(str, cell)).encode()).hexdigest()[:_DIGITS]
