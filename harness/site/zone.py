"""Where a vehicle's body is on a crosswalk: its zone."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely

from harness.core.vocabulary import BoolArray, Crossing, FloatArray
from harness.site.path import FrontPath
from harness.site.town import Crosswalk

_SAMPLE_M = 0.2
"""Distance of the places at which it is first asked whether the body touches the crosswalk."""
_MARGIN_M = 10.0
"""Length of the path that is searched before the stop line, and beyond the junction."""
_SHORT_M, _AT_LINE_M = 0.5, 1e-6
"""Length of the path that shows its direction; the lane before s = 0 may end the second distance
before it, by rounding."""
_STEP_S = 0.1
"""Step of a simulation that has to see the vehicle on the crosswalk."""
_LEAST_WIDTH_M = 0.01
"""Extent along the road of a crosswalk that a body only grazes."""
_REFINEMENTS = 4
"""Each makes a sample 32 times finer; four end at 0.2 µm."""

_Touches = Callable[[FloatArray], BoolArray]


@dataclass(frozen=True, slots=True, eq=False)
class Zone:
    """The zone of a vehicle of one size on one path over one crosswalk.

    y is the position along the crosswalk: 0 at the near kerb, which is the one on the side of the
    road on which traffic keeps (the vehicle's right; in a left-hand network its left), and
    ``crossing.length_m`` at the other one.

    Attributes:
        first_m: s of the front at which the body first touches the crosswalk.
        centre_m: s at which it first touches the crosswalk's centre line, on which people walk: a
            corner of an oblique body is there before the middle of its front.  It is set so early
            that ``body_m`` is at least the vehicle's length or half the way from ``first_m`` to
            ``last_m``.  The straight frame's x is s − ``centre_m``.
        last_m: s of the front at which the body last touches the crosswalk.
        width_m: the extent of the interval of y that the body covers on its way, around
            ``crossing.lane_centre_m``.
        crossing: the crosswalk's constants for this vehicle, in the straight frame.  The lane is as
            much wider than the zone as the lane before the junction is wider than the vehicle.
        reverse: whether y = 0 is the end of the crosswalk's axis.
        split: whether the body touches the crosswalk more than once, or for so short that a
            simulation in steps of 0.1 s may miss it at the speed limit.
    """

    first_m: float
    centre_m: float
    last_m: float
    width_m: float
    crossing: Crossing
    reverse: bool
    split: bool

    @property
    def body_m(self) -> float:
        """The length of a straight road's vehicle that leaves that crosswalk at ``last_m``."""
        return self.last_m - self.centre_m - self.crossing.width_m / 2

    def y_of(self, along_m: float) -> float:
        """y of a position on the crosswalk's axis; the inverse is the same function."""
        return self.crossing.length_m - along_m if self.reverse else along_m


@lru_cache(10_000)
def zone_of(path: FrontPath, crosswalk: Crosswalk, length_m: float, width_m: float) -> Zone | None:
    """The zone of a vehicle's body on its path over a crosswalk; None if it does not touch it.

    Args:
        path: the path.
        crosswalk: the crosswalk.
        length_m, width_m: the vehicle's.
    """
    before = path.lanes[int(np.argmax(path.starts_m[1:] > -_AT_LINE_M))]
    drawn_m = np.abs(np.diff(path.points))
    near = (path.knots_m[1:] > -_MARGIN_M) & (drawn_m > 0.0)
    # The line is as long as it is drawn beyond its ends.
    scale = float((np.diff(path.knots_m)[near] / drawn_m[near]).max())

    def touching(what: shapely.Geometry) -> _Touches:
        return lambda s: np.asarray(
            shapely.intersects(shapely.polygons(path.outline(s, length_m, width_m)), what)
        )

    def begins(touches: _Touches) -> float:
        first = int(np.argmax(touches(grid)))
        return _border(touches, grid[max(first - 1, 0)], grid[first])

    end_m = path.starts_m[-2] + scale * (length_m + _MARGIN_M)
    grid = np.arange(-_MARGIN_M * scale, end_m, _SAMPLE_M)
    touches, reaches = touching(crosswalk.area), touching(crosswalk.axis)
    hits = np.flatnonzero(touches(grid))
    if not hits.size:
        return None
    first_m = begins(touches)
    last_m = _border(touches, grid[min(hits[-1] + 1, len(grid) - 1)], grid[hits[-1]])
    # A grazing body may not come to the centre line.
    centre_m = begins(reaches) if reaches(grid).any() else (first_m + last_m) / 2
    # Otherwise a straight road's vehicle would have no length where one turns round on it.
    centre_m = min(centre_m, (first_m + last_m - min(length_m, (last_m - first_m) / 2)) / 2)
    s = np.concatenate([[first_m], grid[hits], [last_m]])
    from_m, to_m = _covered(path.outline(s, length_m, width_m), crosswalk)
    reverse = _begins_far(path, centre_m, crosswalk)
    lane_centre_m = (from_m + to_m) / 2
    crossing = Crossing(
        length_m=crosswalk.length_m,
        # A straight road on which its centre line is as far away.
        width_m=max(2 * (centre_m - first_m), _LEAST_WIDTH_M),
        lane_centre_m=crosswalk.length_m - lane_centre_m if reverse else lane_centre_m,
        lane_width_m=to_m - from_m + max(before.width_m - width_m, 0.0),
        speed_limit_mps=before.limit_mps,
    )
    short = last_m - first_m < before.limit_mps * _STEP_S
    split = short or bool(np.any(np.diff(hits) > 1))
    return Zone(first_m, centre_m, last_m, to_m - from_m, crossing, reverse, split)


def _border(touches: _Touches, outside_m: float, inside_m: float) -> float:
    """s between two samples at which the body begins, or ceases, to touch."""
    for _ in range(_REFINEMENTS):
        grid_m = np.linspace(outside_m, inside_m, 33)
        first = int(np.argmax(touches(grid_m)))
        outside_m, inside_m = grid_m[max(first - 1, 0)], grid_m[first]
    return float(inside_m)


def _covered(outlines: FloatArray, crosswalk: Crosswalk) -> tuple[float, float]:
    """The interval of the crosswalk's axis that a body covers from one outline to the next."""
    corners = np.concatenate([outlines[:-1], outlines[1:]], axis=1)
    swept = shapely.convex_hull(shapely.multipoints(corners))
    parts = shapely.intersection(swept, crosswalk.area)
    points = shapely.points(shapely.get_coordinates(parts))
    along = shapely.line_locate_point(crosswalk.axis, points)
    return float(along.min()), float(along.max())


def _begins_far(path: FrontPath, s: float, crosswalk: Crosswalk) -> bool:
    """Whether the axis begins at the kerb opposite to the side on which traffic keeps."""
    begin, *_, end = (complex(*point[:2]) for point in crosswalk.axis.coords)
    ahead = path.position(s) - path.position(s - _SHORT_M)
    return bool(((end - begin) / ahead).imag > 0.0) == crosswalk.left_hand
