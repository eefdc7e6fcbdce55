"""Where and when a vehicle's body is on a crosswalk: its zone of conflict with people."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import shapely
from numpy.typing import NDArray

from harness.core.encounter import Crossing, FloatArray
from harness.site.path import Path
from harness.site.town import Connection, Crosswalk, Town

_PATH_M = 40.0
"""Length of a path before the stop line, longer than a body."""
_SAMPLE_M = 0.2
_MARGIN_M = 10.0
"""Length of the path that is searched before the stop line, and beyond the junction."""
_SHORT_M = 0.5
"""Length of a body that shows the direction of the path."""
_REFINEMENTS = 4
"""Each makes a sample 32 times finer; four end at 0.2 µm."""

_Touches = Callable[[FloatArray], NDArray[np.bool_]]


@dataclass(frozen=True, slots=True)
class Zone:
    """The zone of a vehicle of one size on one path over one crosswalk.

    y is the position along the crosswalk: 0 at the near kerb, which is the one on the side of the
    road on which traffic keeps (the vehicle's right; in a left-hand network its left), and
    ``crosswalk_m`` at the other one.

    Attributes:
        first_m: s of the front at which the body first touches the crosswalk.
        centre_m: s at which it first touches the crosswalk's centre line, on which people walk: a
            corner of an oblique body is there before the middle of its front.  It is set so early
            that ``body_m`` is at least the vehicle's length or half the way from ``first_m`` to
            ``last_m``.  The straight frame's x is s − ``centre_m``.
        last_m: s of the front at which the body last touches the crosswalk.
        from_m, to_m: the interval of y that the body covers on its way.
        lane_m: the width of the lane in the straight frame: it is as much wider than the zone as
            the lane before the junction is wider than the vehicle, as on a straight road.
        crosswalk_m: the crosswalk's length from kerb to kerb.
        limit_mps: the speed limit before the junction.
        reverse: whether y = 0 is the end of the crosswalk's axis.
        split: whether the body touches the crosswalk more than once, or for less than a step.
    """

    first_m: float
    centre_m: float
    last_m: float
    from_m: float
    to_m: float
    lane_m: float
    crosswalk_m: float
    limit_mps: float
    reverse: bool
    split: bool

    @property
    def across_m(self) -> float:
        """Its extent along the way: of a straight road on which its centre line is as far away."""
        return max(2 * (self.centre_m - self.first_m), 0.01)

    @property
    def body_m(self) -> float:
        """The length of a straight road's vehicle that leaves that crosswalk at ``last_m``."""
        return self.last_m - self.centre_m - self.across_m / 2

    @property
    def crossing(self) -> Crossing:
        """The crosswalk's constants for this vehicle, in the straight frame."""
        return Crossing(
            length_m=self.crosswalk_m,
            width_m=self.across_m,
            lane_centre_m=(self.from_m + self.to_m) / 2,
            lane_width_m=self.lane_m,
            speed_limit_mps=self.limit_mps,
        )

    def y_of(self, along_m: float) -> float:
        """y of a position on the crosswalk's axis; the inverse is the same function."""
        return self.crosswalk_m - along_m if self.reverse else along_m


def zone_of(
    path: Path, crosswalk: Crosswalk, length_m: float, width_m: float, step_s: float = 0.1
) -> Zone | None:
    """The zone of a vehicle's body on its path over a crosswalk; None if it does not touch it.

    Args:
        path: the path.
        crosswalk: the crosswalk.
        length_m, width_m: the vehicle's.
        step_s: length of a step; a body that touches for less than a step at the limit may be
            missed by a simulation.
    """
    area, near = crosswalk.area, [each for each in path.stretches if each.end_m > -_MARGIN_M]
    scale = max(1.0, *(each.scale for each in near))

    def touching(what: shapely.Geometry) -> _Touches:
        return lambda s: np.asarray(
            shapely.intersects(shapely.polygons(path.outline(s, length_m, width_m)), what)
        )

    def begins(touches: _Touches) -> float:
        first = int(np.argmax(touches(grid)))
        return _border(touches, grid[max(first - 1, 0)], grid[first])

    end_m = near[-1].start_m + scale * (length_m + _MARGIN_M)
    grid = np.arange(-_MARGIN_M * scale, end_m, _SAMPLE_M)
    touches, reaches = touching(area), touching(crosswalk.axis)
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
    if reverse := _begins_far(path, centre_m, crosswalk):
        from_m, to_m = crosswalk.length_m - to_m, crosswalk.length_m - from_m
    lane = next(each for each in path.stretches if each.end_m > -1e-6)
    return Zone(
        first_m=first_m,
        centre_m=centre_m,
        last_m=last_m,
        from_m=from_m,
        to_m=to_m,
        lane_m=to_m - from_m + max(lane.width_m - width_m, 0.0),
        crosswalk_m=crosswalk.length_m,
        limit_mps=lane.limit_mps,
        reverse=reverse,
        split=last_m - first_m < lane.limit_mps * step_s or bool(np.any(np.diff(hits) > 1)),
    )


def _border(touches: _Touches, outside: float, inside: float) -> float:
    """s between two samples at which the body begins, or ceases, to touch."""
    for _ in range(_REFINEMENTS):
        grid = np.linspace(outside, inside, 33)
        first = int(np.argmax(touches(grid)))
        outside, inside = grid[max(first - 1, 0)], grid[first]
    return float(inside)


def _covered(outlines: FloatArray, crosswalk: Crosswalk) -> tuple[float, float]:
    """The interval of the crosswalk's axis that a body covers from one outline to the next."""
    corners = np.concatenate([outlines[:-1], outlines[1:]], axis=1)
    swept = shapely.convex_hull(shapely.multipoints(corners))
    parts = shapely.intersection(swept, crosswalk.area)
    points = shapely.points(shapely.get_coordinates(parts))
    along = shapely.line_locate_point(crosswalk.axis, points)
    return float(along.min()), float(along.max())


def _begins_far(path: Path, s: float, crosswalk: Crosswalk) -> bool:
    """Whether the axis begins at the kerb opposite to the side on which traffic keeps."""
    right, left, *_ = path.outline(s, _SHORT_M, 1.0)
    axis = np.subtract(crosswalk.axis.coords[-1][:2], crosswalk.axis.coords[0][:2])
    leads_left = bool((left - right) @ axis > 0.0)
    return leads_left == crosswalk.left_hand


class Zones:
    """The zones of the chosen crosswalks, each computed when a vehicle of that size first comes.

    Args:
        town: the network.
        step_s: length of a step.
        chosen: ids of the crosswalks; None: all.
    """

    def __init__(self, town: Town, step_s: float, chosen: Iterable[str] | None = None) -> None:
        self.town, self._step_s = town, step_s
        self._crosswalks: dict[str, list[Crosswalk]] = {}
        chosen = set(town.crosswalks if chosen is None else chosen)
        for name in chosen:
            for connection in town.connections(name):
                self._crosswalks.setdefault(connection.id, []).append(town.crosswalks[name])
        others = [each for name, each in town.crosswalks.items() if name not in chosen]
        zebras = [each.id for each in others if each.prioritized]
        self._minds = {each.id for name in zebras for each in town.connections(name, 0.0)}

    def crosswalks(self, connection: Connection) -> Sequence[Crosswalk]:
        """The chosen crosswalks that a body on this connection may touch."""
        return self._crosswalks.get(connection.id, ())

    def yields(self, connection: Connection) -> bool:
        """Whether SUMO keeps the right of way on a connection.

        It does so except where it would slow down for a chosen crosswalk on which people have
        priority, and no vehicles or people have it elsewhere.
        """
        zebra = any(each.prioritized for each in self.crosswalks(connection))
        return connection.gives_way or connection.id in self._minds or not zebra

    @cache  # noqa: B019 - as long as the simulation
    def path(self, connection: Connection) -> Path:
        """The path of a connection."""
        return self.town.path(connection, _PATH_M)

    @cache  # noqa: B019
    def at(
        self, connection: Connection, crosswalk: Crosswalk, length_m: float, width_m: float
    ) -> Zone | None:
        """The zone of a vehicle of this size; None if it does not touch the crosswalk."""
        return zone_of(self.path(connection), crosswalk, length_m, width_m, self._step_s)
