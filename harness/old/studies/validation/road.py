"""Takes recorded tracks and returns the straightened road and the pedestrians' courses."""

from dataclasses import dataclass

import numpy as np

from harness.core.encounter import FloatArray, Leg, Side
from harness.model.trajectories.paths import TravelPath
from harness.model.trajectories.tracks import Track

KERB_M = 4.5
"""Distance in m from the vehicle's path to each kerb, for a 9 m crosswalk as in the paper."""

FOOTPATH_M = 1.5
"""A pedestrian becomes present at this distance before the kerb, as in SUMO's own model."""

LEG_S = 0.1
"""Shortest leg of a walk in s.  Records at shorter intervals are thinned."""

VELOCITY_S = 0.5
"""Before and after the record a pedestrian keeps their mean velocity over this time in s."""

_EXTENSION_M = 60.0


@dataclass(frozen=True, eq=False)
class Road:
    """A path as a chain of straight pieces, extended straight at both ends."""

    start_m: FloatArray
    piece_m: FloatArray
    length_m: FloatArray
    arc_m: FloatArray

    def coordinates(self, position_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return distances in m along the path and to its left, (n,) each, of positions (n, 2)."""
        away = position_m[:, None, :] - self.start_m[None]
        share = np.clip((away * self.piece_m).sum(axis=2) / self.length_m**2, 0.0, 1.0)
        foot = away - share[:, :, None] * self.piece_m
        squared = (foot**2).sum(axis=2)
        nearest = squared.argmin(axis=1)
        row = np.arange(len(position_m))
        left = (
            self.piece_m[nearest, 0] * away[row, nearest, 1]
            - self.piece_m[nearest, 1] * away[row, nearest, 0]
        )
        offset = np.copysign(np.sqrt(squared[row, nearest]), left)
        return self.arc_m[nearest] + share[row, nearest] * self.length_m[nearest], offset


def road_about(path: TravelPath, arc_m: float, reach_m: float, chord_m: float) -> Road:
    """Return the part of a path within ``reach_m`` of a place on it, as a road.

    Farther pieces are left out, because the path may return to the place.

    Args:
        path: path of the vehicle's centre.
        arc_m: path length of the place.
        reach_m: length of the path before and after the place.
        chord_m: length of the chords that give the directions of the extensions.
    """
    corners = path.arc_m[np.abs(path.arc_m - arc_m) < reach_m]
    first, last = max(0.0, arc_m - reach_m), min(float(path.arc_m[-1]), arc_m + reach_m)
    arcs = np.unique(np.concatenate([[first], corners, [last]]))
    points = np.array([path.at(arc) for arc in arcs.tolist()])
    # A corner very close to an end would give a piece without a direction.
    kept = np.concatenate([[True], np.diff(arcs) > 1e-6])
    arcs, points = arcs[kept], points[kept]
    ahead = path.direction(last - chord_m / 2, chord_m / 2)
    behind = path.direction(first + chord_m / 2, chord_m / 2)
    points = np.vstack(
        [points[:1] - _EXTENSION_M * behind, points, points[-1:] + _EXTENSION_M * ahead]
    )
    pieces = np.diff(points, axis=0)
    lengths = np.hypot(*pieces.T)
    return Road(points[:-1], pieces, lengths, arcs[0] - _EXTENSION_M + np.cumsum(lengths) - lengths)


@dataclass(frozen=True, eq=False)
class Course:
    """A pedestrian's positions in the road's frame, extended before and after the record.

    Attributes:
        side: the kerb from which they come.
        time_s: (n,) increasing times from the passage's start; the first is 0 or negative.
        x_m, y_m: (n,) positions along and across the road.
        recorded_s: first and last time of the record.
    """

    side: Side
    time_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    recorded_s: tuple[float, float]

    @property
    def progress_m(self) -> FloatArray:
        """Distance in m from their kerb in walking direction, (n,); negative on the footpath."""
        return self.y_m if self.side is Side.NEAR else 2 * KERB_M - self.y_m

    def reaches_s(self, progress_m: float, since_s: float = -np.inf) -> float:
        """Return the first time in s from ``since_s`` on with this progress; infinite if never."""
        progress = self.progress_m
        if since_s > self.time_s[0]:
            here = np.interp(since_s, self.time_s, progress)
            later = self.time_s > since_s
            times = np.concatenate([[since_s], self.time_s[later]])
            progress = np.concatenate([[here], progress[later]])
        else:
            times = self.time_s
        past = np.flatnonzero(progress >= progress_m)
        if len(past) == 0:
            return float("inf")
        at = int(past[0])
        if at == 0:
            return float(times[0])
        share = (progress_m - progress[at - 1]) / (progress[at] - progress[at - 1])
        return float(times[at - 1] + share * (times[at] - times[at - 1]))

    def x_at(self, time_s: float) -> float:
        """Return the position along the road in m at a time."""
        return float(np.interp(time_s, self.time_s, self.x_m))

    def legs(self, until_s: float) -> tuple[Leg, ...]:
        """Return their walk from the footpath, or from their place at t = 0, to the other kerb.

        It is empty if they are past the other kerb at t = 0 or not present before ``until_s``.
        """
        begin = self.reaches_s(-FOOTPATH_M, since_s=0.0)
        end = min(self.reaches_s(2 * KERB_M, since_s=0.0), until_s)
        if begin >= end:
            return ()
        inner = self.time_s[(self.time_s > begin + 1e-9) & (self.time_s < end - 1e-9)]
        times = np.concatenate([[begin], inner, [end]])
        x, y = (np.interp(times, self.time_s, values) for values in (self.x_m, self.y_m))
        # A leg has no end, so the last leg also leads over the kerb.
        step = np.diff(times)
        columns = np.column_stack(
            (times[:-1], x[:-1], y[:-1], np.diff(x) / step, np.diff(y) / step, 0.0 * step)
        )
        return tuple(Leg(*row) for row in columns.tolist())


def course_of(
    track: Track, road: Road, origin_m: float, start_s: float, until_s: float, side: Side, flip: int
) -> Course:
    """Return a pedestrian's course in a passage.

    Args:
        track: their recorded track.
        road: the vehicle's road.
        origin_m: path length of x = 0.
        start_s: start of the passage on the clip's clock.
        until_s: end of the course, from the start of the passage.
        side: the kerb from which they come.
        flip: −1 if the clip's y axis points down, else 1.
    """
    kept = _thinned(track.time_s)
    time_s = rounded(track.time_s[kept] - start_s)
    arc, left = road.coordinates(track.position_m[kept])
    x, y = rounded(arc - origin_m), rounded(KERB_M + flip * left)
    times, xs, ys = [time_s], [x], [y]
    if time_s[0] > 0:
        vx, vy = _velocity(time_s, x, y, last=False)
        times.insert(0, np.array([0.0]))
        xs.insert(0, x[:1] - vx * time_s[0])
        ys.insert(0, y[:1] - vy * time_s[0])
    if time_s[-1] < until_s:
        vx, vy = _velocity(time_s, x, y, last=True)
        times.append(np.array([until_s]))
        xs.append(x[-1:] + vx * (until_s - time_s[-1]))
        ys.append(y[-1:] + vy * (until_s - time_s[-1]))
    recorded = float(time_s[0]), float(time_s[-1])
    return Course(side, np.concatenate(times), np.concatenate(xs), np.concatenate(ys), recorded)


def rounded(values: FloatArray) -> FloatArray:
    """Round values to 1e-9, so that results do not depend on the last bits."""
    result: FloatArray = np.round(values, 9)
    return result


def _thinned(time_s: FloatArray) -> list[int]:
    """Return indices of records at least ``LEG_S`` apart, including the first and the last."""
    kept = [0]
    for index, time in enumerate(time_s.tolist()):
        if time - time_s[kept[-1]] >= LEG_S - 1e-6:
            kept.append(index)
    if kept[-1] != len(time_s) - 1:
        kept = [*kept[: max(1, len(kept) - 1)], len(time_s) - 1]
    return kept


def _velocity(
    time_s: FloatArray, x_m: FloatArray, y_m: FloatArray, *, last: bool
) -> tuple[float, float]:
    """Return the mean velocity in m/s along and across the road at a record's start or end."""
    if last:
        begin, end = max(0, int(np.searchsorted(time_s, time_s[-1] - VELOCITY_S - 1e-9))), -1
        begin = min(begin, len(time_s) - 2)
    else:
        begin = 0
        end = max(1, int(np.searchsorted(time_s, time_s[0] + VELOCITY_S + 1e-9)) - 1)
    elapsed = time_s[end] - time_s[begin]
    return float((x_m[end] - x_m[begin]) / elapsed), float((y_m[end] - y_m[begin]) / elapsed)
