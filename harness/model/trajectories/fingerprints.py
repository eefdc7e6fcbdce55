"""Which recorded track this is, whatever it and its file are called.

A track is told by its mean place over the first and over the second half of its time, in cells of
1 mm: four numbers that depend on no name, no order of the records, no clock's zero and no frame
rate. Noise of less than 1 mm in every record moves each of them by one cell at most, so a track is
looked for in its own cell and in those beside it. Only hashes of cells are kept: nobody's way can
be read from them.
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
    """The track's hash, 16 hexadecimal digits."""
    return _hash(_cell(track))


def fingerprints_of(clips: Iterable[Clip]) -> frozenset[str]:
    """What a card may call the vehicles of these clips: their own cells and those beside."""
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
