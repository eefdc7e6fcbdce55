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


class PathLane(NamedTuple):
    """A lane that a path is to follow.

    Attributes:
        lane: its id.
        shape: the points of its centre line, x and y in m; at least two.
        length_m: SUMO's length, which may differ from that of the shape.
        limit_mps: its speed limit.
        width_m: its width; without it SUMO's default.
    """

    lane: str
    shape: Sequence[tuple[float, float]]
    length_m: float
    limit_mps: float
    width_m: float = 3.2


class Stretch(NamedTuple):
    """A lane on a path.

    Attributes:
        lane: its id.
        start_m, end_m: s at its beginning and at its end.
        limit_mps: its speed limit.
        scale: SUMO's length of the lane over that of its shape.
        width_m: its width.
    """

    lane: str
    start_m: float
    end_m: float
    limit_mps: float
    scale: float
    width_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Successive lanes as one line; s is 0 at the stop line and negative before it.

    Every lane's shape is scaled linearly to the lane's length, as SUMO does, so that s differs from
    a position on a lane by a constant.  Beyond both ends the line goes straight on.

    Attributes:
        stretches: the lanes in order of travel.
        knots_m: s of each point, shape (points,), never decreasing.
        points: x and y of the points in the network, shape (points, 2).
    """

    stretches: tuple[Stretch, ...]
    knots_m: FloatArray
    points: FloatArray

    @classmethod
    def along(cls, lanes: Sequence[PathLane], before: int = 1) -> "Path":
        """The path along some lanes.

        Args:
            lanes: successive lanes, including those inside junctions.
            before: the number of them that lie before the stop line.
        """
        at_m = -sum(lane.length_m for lane in lanes[:before])
        stretches, knots, points = [], [], []
        for lane in lanes:
            shape = np.asarray(lane.shape, dtype=float)[:, :2]
            done = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(shape, axis=0).T))])
            # A lane between two edges that meet without a gap is drawn as a point.
            share = done / done[-1] if done[-1] else np.linspace(0.0, 1.0, len(done))
            knots.append(at_m + share * lane.length_m)
            points.append(shape)
            scale = lane.length_m / float(done[-1]) if done[-1] else 1.0
            end_m = at_m + lane.length_m
            stretches.append(Stretch(lane.lane, at_m, end_m, lane.limit_mps, scale, lane.width_m))
            at_m = end_m
        knots_m, line = _straight_on(np.concatenate(knots), np.concatenate(points))
        knots_m.setflags(write=False)
        line.setflags(write=False)
        return cls(tuple(stretches), knots_m, line)

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
        starts = [each.start_m for each in self.stretches]
        s = np.unique(np.concatenate((even, [at for at in starts if begin_m < at < end_m])))
        limits = np.array([own_mps(each.limit_mps) for each in self.stretches])
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
