"""A vehicle's line over a crosswalk, by its arc length s in SUMO's lane metres."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from harness.core.encounter import FloatArray

_BEYOND_M = 1000.0
"""Length by which the line goes straight on beyond both ends."""
_SIDES: tuple[Literal["left", "right"], ...] = ("left", "right")
_SAMPLE_M = 0.25
"""Distance of places at which the speed of a free drive is computed."""


class Lane(NamedTuple):
    """A lane.

    Attributes:
        id: its id.
        shape: the points of its centre line, x and y in m; at least two.
        length_m: SUMO's length, which may differ from that of the shape.
        limit_mps: its speed limit.
        width_m: its width; without it SUMO's default.
    """

    id: str
    shape: Sequence[tuple[float, float]]
    length_m: float
    limit_mps: float
    width_m: float = 3.2

    @property
    def drawn_m(self) -> FloatArray:
        """The length of its shape up to each point."""
        parts_m = np.hypot(*np.diff(np.array(self.shape), axis=0).T)
        return np.concatenate([[0.0], np.cumsum(parts_m)])

    @property
    def scale(self) -> float:
        """SUMO's length over that of the shape; 1 for a lane drawn as a point."""
        return self.length_m / (float(self.drawn_m[-1]) or self.length_m)


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Successive lanes as one line; s is 0 at the stop line and negative before it.

    Every lane's shape is scaled linearly to the lane's length, as SUMO does, so that s differs from
    a position on a lane by a constant.  Beyond both ends the line goes straight on.

    Attributes:
        lanes: the lanes in order of travel.
        starts_m: s at the beginning of each, and at the end of the last one, shape (lanes + 1,).
        knots_m: s of each point, shape (points,), never decreasing.
        points: x and y of the points in the network, shape (points, 2).
    """

    lanes: tuple[Lane, ...]
    starts_m: FloatArray
    knots_m: FloatArray
    points: FloatArray

    @classmethod
    def along(cls, lanes: Sequence[Lane], before: int = 1) -> "Path":
        """The path along some lanes.

        Args:
            lanes: successive lanes, including those inside junctions.
            before: the number of them that lie before the stop line.
        """
        ends_m = np.cumsum([lane.length_m for lane in lanes])
        starts_m = np.concatenate([[0.0], ends_m]) - ends_m[before - 1]
        knots = []
        for lane, at_m in zip(lanes, starts_m, strict=False):
            done = lane.drawn_m
            # A lane between two edges that meet without a gap is drawn as a point.
            share = done / done[-1] if done[-1] else np.linspace(0.0, 1.0, len(done))
            knots.append(at_m + share * lane.length_m)
        shapes = [np.array(lane.shape, dtype=float) for lane in lanes]
        knots_m, points = _straight_on(np.concatenate(knots), np.concatenate(shapes))
        for each in (starts_m, knots_m, points):
            each.setflags(write=False)
        return cls(tuple(lanes), starts_m, knots_m, points)

    def position(self, s: ArrayLike) -> FloatArray:
        """x and y of a front bumper at s, shape of s + (2,)."""
        at = np.asarray(s, dtype=float)
        x, y = (np.interp(at, self.knots_m, of) for of in self.points.T)
        return np.stack([x, y], axis=-1)

    def outline(self, s: ArrayLike, length_m: float, width_m: float) -> FloatArray:
        """The corners of a vehicle's body with its front at s, shape of s + (4, 2).

        The body is a rectangle along the chord from s − length to s, as in SUMO.  Its corners are
        front right, front left, rear left, rear right.  It is longer than a lane drawn as a point.
        """
        front = self.position(s)
        chord = front - self.position(np.subtract(s, length_m))
        ahead = chord / np.hypot(chord[..., 0], chord[..., 1])[..., None]
        left = np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1) * (width_m / 2)
        rear = front - length_m * ahead
        return np.stack([front - left, front + left, rear + left, rear - left], axis=-2)

    def free_s(
        self,
        begin_m: float,
        end_m: float,
        gain_mps2: float,
        loss_mps2: float,
        own_mps: Callable[[float], float],
    ) -> float:
        """The time in s that a front needs alone from one s to another, at the limits of its lanes.

        A vehicle slows down for lower limits and curves ahead, and speeds up behind them.

        Args:
            begin_m, end_m: s at the beginning and at the end.
            gain_mps2, loss_mps2: acceleration and deceleration.
            own_mps: a vehicle's own limit on a lane with a speed limit.
        """
        even = np.linspace(begin_m, end_m, math.ceil((end_m - begin_m) / _SAMPLE_M) + 1)
        starts = self.starts_m[:-1]
        s = np.unique(np.concatenate((even, starts[(starts > begin_m) & (starts < end_m)])))
        limits = np.array([own_mps(lane.limit_mps) for lane in self.lanes])
        sides = (np.searchsorted(starts, s, side) - 1 for side in _SIDES)
        most = np.minimum(*(limits[np.maximum(each, 0)] for each in sides))
        # v² changes by at most 2a for each metre.
        gain, loss = 2 * gain_mps2 * s, 2 * loss_mps2 * s
        rising = np.minimum.accumulate(most**2 - gain) + gain
        falling = np.minimum.accumulate((most**2 + loss)[::-1])[::-1] - loss
        speed = np.sqrt(np.minimum(rising, falling))
        return float(np.sum(2 * np.diff(s) / (speed[1:] + speed[:-1])))


def _straight_on(knots_m: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A line with a far point before its beginning, and one beyond its end."""
    steps = np.diff(points, axis=0)
    long = np.flatnonzero(np.hypot(*steps.T) > 0.0)
    first, last = (steps[i] / np.hypot(*steps[i]) for i in (long[0], long[-1]))
    return (
        np.concatenate([[knots_m[0] - _BEYOND_M], knots_m, [knots_m[-1] + _BEYOND_M]]),
        np.concatenate([[points[0] - _BEYOND_M * first], points, [points[-1] + _BEYOND_M * last]]),
    )
