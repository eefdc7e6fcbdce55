"""Tracks of vehicles and pedestrians that were recorded together, their fingerprints and paths.

A fingerprint is the hash of the track's mean position over the first and over the second half of
its time, in cells of 1 mm.  These four numbers do not depend on names, the order of the records,
the origin of the clock or the frame rate.  Noise below 1 mm changes each number by at most one
cell, so a search for a track covers its own cell and the neighbouring cells.  Positions cannot be
recovered from a hash.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from harness.core.freezing import Frozen
from harness.core.vocabulary import ROUNDING, FloatArray

_CELLS_PER_M = 1000.0
"""A fingerprint is of cells of 1 mm."""
_INSTANTS = 200
"""Number of instants over which the two mean positions are taken."""
_DIGITS = 16
"""Hexadecimal digits of a fingerprint."""


@dataclass(frozen=True, eq=False)
class Track(Frozen):
    """One object's positions.

    Attributes:
        time_s: (n,) strictly increasing, on the clip's clock.
        position_m: (n, 2) x and y in the clip's metric axes.
    """

    time_s: FloatArray
    position_m: FloatArray

    def __post_init__(self) -> None:
        """Make the arrays read-only, and floats."""
        for name in ("time_s", "position_m"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=np.float64))
        super().__post_init__()


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
class Clip(Frozen):
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


@dataclass(frozen=True, eq=False)
class TravelPath(Frozen):
    """A path as a chain of straight pieces; the last piece is its straight extension.

    Attributes:
        points: (m, 2) corner points, m ≥ 2.
        arc_m: (m,) path length up to each corner.
        record: (m − 1,) index of the track record of each corner before the extension.
    """

    points: FloatArray
    arc_m: FloatArray
    record: NDArray[np.intp]

    def at(self, arc_m: float) -> FloatArray:
        """(2,) the point at a path length, which is clipped to the path."""
        return np.array([np.interp(arc_m, self.arc_m, axis) for axis in self.points.T])

    def direction(self, arc_m: float, half_chord_m: float) -> FloatArray:
        """(2,) unit direction of motion at a path length, from a chord of the path.

        If the path returns on itself, so that the chord has no length, the piece of the path there
        gives the direction.
        """
        chord = self.at(arc_m + half_chord_m) - self.at(arc_m - half_chord_m)
        if np.hypot(*chord) <= ROUNDING * half_chord_m:
            piece = int(np.searchsorted(self.arc_m, arc_m, side="right")) - 1
            piece = min(max(piece, 0), len(self.points) - 2)
            chord = self.points[piece + 1] - self.points[piece]
        return np.asarray(chord / np.hypot(*chord))


def travel_m(position_m: FloatArray) -> float:
    """The largest distance of an object from its first position."""
    return float(np.hypot(*(position_m - position_m[0]).T).max())


def thinned(position_m: FloatArray, step_m: float) -> NDArray[np.intp]:
    """Indices of records at least a step apart, so that recording jitter adds no path length."""
    kept = [0]
    x, y = position_m[:, 0].tolist(), position_m[:, 1].tolist()
    x0, y0, least = x[0], y[0], step_m * step_m
    for index in range(1, len(x)):
        if (x[index] - x0) ** 2 + (y[index] - y0) ** 2 >= least:
            kept.append(index)
            x0, y0 = x[index], y[index]
    return np.array(kept, dtype=np.intp)


def build_path(
    position_m: FloatArray, step_m: float, chord_m: float, extension_m: float
) -> TravelPath | None:
    """The path through an object's records, extended straight ahead.

    Args:
        position_m: (n, 2) positions in order of time.
        step_m: corners are at least this far apart.
        chord_m: the extension keeps the direction of the last ``chord_m`` of the path.
        extension_m: length of the extension beyond the last record.

    Returns:
        The path; it is *undefined* (None) if the object never moves a step away.
    """
    kept = thinned(position_m, step_m)
    if len(kept) < 2:
        return None
    corners = position_m[kept]
    last = corners[-1]
    away = np.hypot(*(corners - last).T)
    far = np.flatnonzero(away >= chord_m)
    start = corners[far[-1]] if len(far) else corners[0]
    if np.hypot(*(last - start)) == 0.0:  # a short closed loop: use its last piece
        start = corners[-2]
    ahead = (last - start) / np.hypot(*(last - start))
    # The last record lies up to a step beyond the last corner; the extension starts there.
    beyond = max(0.0, float((position_m[-1] - last) @ ahead))
    points = np.vstack([corners, last + ahead * (beyond + max(extension_m, 1e-3))])
    pieces = np.hypot(*np.diff(points, axis=0).T)
    return TravelPath(points, np.concatenate([[0.0], np.cumsum(pieces)]), kept)


def arc_of_records(path: TravelPath, position_m: FloatArray) -> FloatArray:
    """(n,) path length of every record of the path's own track.

    A record is projected onto the nearest of the pieces that are next to it in time.  It therefore
    stays on its own branch if the path returns near itself.
    """
    pieces = np.diff(path.points, axis=0)
    lengths = np.diff(path.arc_m)
    here = np.searchsorted(path.record, np.arange(len(position_m)), side="right") - 1
    best = np.full(len(position_m), np.inf)
    arc = np.zeros(len(position_m))
    for offset in range(-2, 3):
        piece = np.clip(here + offset, 0, len(pieces) - 1)
        start, along = path.points[piece], pieces[piece]
        share = ((position_m - start) * along).sum(axis=1) / lengths[piece] ** 2
        share = np.clip(share, 0.0, 1.0)
        away = np.hypot(*(position_m - start - share[:, None] * along).T)
        nearer = away < best
        best = np.where(nearer, away, best)
        arc = np.where(nearer, path.arc_m[piece] + share * lengths[piece], arc)
    return arc


def first_crossing(path: TravelPath, other: TravelPath) -> tuple[float, float] | None:
    """The first point along ``path`` at which it crosses ``other``.

    Returns:
        Path lengths on ``path`` and on ``other``; None if they have no common point.  Pieces that
        overlap are parallel and do not count.
    """
    a, b = np.diff(path.points, axis=0), np.diff(other.points, axis=0)
    gap = other.points[None, :-1] - path.points[:-1, None]
    cross = a[:, None, 0] * b[None, :, 1] - a[:, None, 1] * b[None, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        on_path = (gap[..., 0] * b[None, :, 1] - gap[..., 1] * b[None, :, 0]) / cross
        on_other = (gap[..., 0] * a[:, None, 1] - gap[..., 1] * a[:, None, 0]) / cross
        meets = (on_path >= 0) & (on_path <= 1) & (on_other >= 0) & (on_other <= 1)
    i, j = np.nonzero(meets)
    if len(i) == 0:
        return None
    arc_path = path.arc_m[i] + on_path[i, j] * np.diff(path.arc_m)[i]
    arc_other = other.arc_m[j] + on_other[i, j] * np.diff(other.arc_m)[j]
    first = int(np.lexsort((arc_other, arc_path))[0])
    return float(arc_path[first]), float(arc_other[first])
