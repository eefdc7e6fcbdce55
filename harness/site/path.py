"""A line by its arc length s in SUMO's lane metres: a vehicle's way, or a crosswalk's axis."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.core.freezing import Frozen
from harness.core.vocabulary import FloatArray

Places = NDArray[np.complex128]
"""Places or directions in the network's plane, x + iy."""

_BEYOND_M = 1000.0
"""Length by which the line goes straight on beyond both ends."""
_SAMPLE_M = 0.25
"""Distance of places at which the speed of a free drive is computed."""


class Lane(NamedTuple):
    """A lane.

    Attributes:
        id: its id.
        shape: the points of its centre line, x and y in m; at least two.
        length_m: SUMO's length, which may differ from that of the shape.
        limit_mps: its speed limit; infinite for a crosswalk, which has none.
        width_m: its width.
    """

    id: str
    shape: Sequence[tuple[float, float]]
    length_m: float
    limit_mps: float
    width_m: float


@dataclass(frozen=True, eq=False)
class FrontPath(Frozen):
    """Successive lanes as one line; s is 0 at the stop line and negative before it.

    Every lane's shape is scaled linearly to the lane's length, as SUMO does, so that s differs from
    a position on a lane by a constant.  Beyond both ends the line goes straight on.  Places and
    directions in the network's plane are complex numbers x + iy.

    Attributes:
        lanes: the lanes in order of travel.
        starts_m: s at the beginning of each, and at the end of the last one, shape (lanes + 1,).
        knots_m: s of each point, shape (points,), never decreasing.
        points: the points, shape (points,).
    """

    lanes: tuple[Lane, ...]
    starts_m: FloatArray
    knots_m: FloatArray
    points: Places

    @classmethod
    def along(cls, lanes: Sequence[Lane], before: int = 1) -> "FrontPath":
        """The path along some lanes.

        Args:
            lanes: successive lanes, including those inside junctions.
            before: the number of them that lie before the stop line.
        """
        starts_m = np.concatenate([[0.0], np.cumsum([lane.length_m for lane in lanes])])
        starts_m -= starts_m[before]
        knots, shapes = [], []
        for lane, at_m in zip(lanes, starts_m, strict=False):
            shape = np.array(lane.shape) @ [1, 1j]
            done = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(shape)))])
            # A lane between two edges that meet without a gap is drawn as a point.
            share = done / done[-1] if done[-1] else np.linspace(0.0, 1.0, len(done))
            knots.append(at_m + share * lane.length_m)
            shapes.append(shape)
        points = np.concatenate(shapes)
        steps = np.diff(points)
        first, last = steps[steps != 0][[0, -1]]
        begin, end = first / abs(first) * _BEYOND_M, last / abs(last) * _BEYOND_M
        points = np.concatenate([points[:1] - begin, points, points[-1:] + end])
        knots_m = np.concatenate([[starts_m[0] - _BEYOND_M], *knots, [starts_m[-1] + _BEYOND_M]])
        return cls(tuple(lanes), starts_m, knots_m, points)

    def position(self, s: ArrayLike) -> Places:
        """The place of a front bumper at s, shape of s."""
        place: Places = np.interp(np.asarray(s, dtype=float), self.knots_m, self.points)
        return place

    def place(self, s_m: float) -> complex:
        """``position`` of one s within the lanes, without arrays."""
        begin_m, _, start, ahead = next(each for each in self._pieces if s_m <= each[1])
        return start + (s_m - begin_m) * ahead

    def heading(self, s: ArrayLike) -> Places:
        """The direction at s, of length 1, shape of s."""
        piece = np.clip(np.searchsorted(self.knots_m, s), 1, len(self.knots_m) - 1)
        ahead = self.points[piece] - self.points[piece - 1]
        return ahead / np.abs(ahead)

    def outline(self, s: ArrayLike, length_m: float, width_m: float) -> FloatArray:
        """x and y of the corners of a vehicle's body with its front at s, shape of s + (4, 2).

        The body is a rectangle along the chord from s − length to s, as in SUMO.  Its corners are
        front right, front left, rear left, rear right.  It is longer than a lane drawn as a point.
        """
        front = self.position(s)
        chord = front - self.position(np.subtract(s, length_m))
        ahead = chord / np.abs(chord)
        left, rear = 1j * ahead * width_m / 2, front - length_m * ahead
        corners = np.stack([front - left, front + left, rear + left, rear - left], axis=-1)
        return np.stack([corners.real, corners.imag], axis=-1)

    @cached_property
    def _pieces(self) -> Sequence[tuple[float, float, complex, complex]]:
        """s at the beginning and at the end of each straight piece, its first point and d/ds."""
        knots = pairwise(zip(self.knots_m.tolist(), self.points.tolist(), strict=True))
        return [
            (a_m, b_m, a, (b - a) / (b_m - a_m))
            for (a_m, a), (b_m, b) in knots
            if a_m < b_m and a != b
        ]

    def foot(self, at: complex) -> tuple[float, float]:
        """s of the place of the line that is nearest to a point, and how far it is to the left."""
        best = (math.inf, 0.0, 0.0)
        for begin_m, end_m, start, ahead in self._pieces:
            off = (at - start) / ahead
            inside_m = min(max(off.real, 0.0), end_m - begin_m)
            scale = abs(ahead)
            best = min(best, (abs(off - inside_m) * scale, begin_m + inside_m, off.imag * scale))
        return best[1:]

    def free_drive_s(
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
        # Where a lane begins, the lower limit counts.
        before, behind = (np.searchsorted(starts, s, side) - 1 for side in ("left", "right"))
        most = np.minimum(limits[np.maximum(before, 0)], limits[np.maximum(behind, 0)])
        # v² changes by at most 2a for each metre.
        gain, loss = 2 * gain_mps2 * s, 2 * loss_mps2 * s
        rising = np.minimum.accumulate(most**2 - gain) + gain
        falling = np.minimum.accumulate((most**2 + loss)[::-1])[::-1] - loss
        speed = np.sqrt(np.minimum(rising, falling))
        return float(np.sum(2 * np.diff(s) / (speed[1:] + speed[:-1])))
