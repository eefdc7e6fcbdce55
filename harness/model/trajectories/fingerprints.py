"""Takes recorded tracks and returns fingerprints that do not depend on their names.

A fingerprint is the hash of the track's mean position over the first and over the second half of
its time, in cells of 1 mm. These four numbers do not depend on names, the order of the records, the
origin of the clock or the frame rate. Noise below 1 mm changes each number by at most one cell, so
a search for a track covers its own cell and the neighbouring cells. Positions cannot be recovered
from a hash.
"""

import hashlib
from collections.abc import Iterable
from itertools import product

import numpy as np

from harness.model.trajectories.tracks import Clip, Track

_CELLS_PER_M = 1000.0
_INSTANTS = 200
_DIGITS = 16


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
