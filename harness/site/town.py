"""Every crosswalk of a network, and the connections of lanes whose vehicles pass it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Literal

import shapely

from harness.core.freezing import Frozen
from harness.site.path import FrontPath, Lane

Manoeuvre = Literal["straight", "left", "right", "turn"]

SIGNAL = "a traffic light controls it"
RAIL = "a railway leads over it"
NO_VEHICLES = "no vehicle's connection leads over it"
"""Why no strategy can be run at a crosswalk."""

_PATH_M = 40.0
"""Length of a path before the stop line, longer than a body."""
_NEAR_M = 6.0
"""A body touches only crosswalks that are this near to its front's line."""


@dataclass(frozen=True, slots=True, eq=False)
class Connection:
    """A connection of two lanes at a junction.

    Attributes:
        from_lane: the lane before the junction.
        via: the lanes inside the junction, in order of travel.
        to_lane: the lane beyond it.
        manoeuvre: the direction that SUMO gives it.
        gives_way: whether it has to yield to another connection for vehicles; crosswalks that it
            has to yield to do not count.
        line: the line of the front inside the junction.
        limit_mps: the speed limit before the junction.
        refused: why no strategy can drive on it, or None.
    """

    from_lane: str
    via: tuple[str, ...]
    to_lane: str
    manoeuvre: Manoeuvre
    gives_way: bool
    line: shapely.LineString
    limit_mps: float
    refused: str | None = None

    @property
    def id(self) -> str:
        """Ids of the first and the last lane, e.g. ``a_0>b_0``."""
        return f"{self.from_lane}>{self.to_lane}"


@dataclass(frozen=True, eq=False)
class Crosswalk(Frozen):
    """A crosswalk.

    Attributes:
        id: id of the crossing's edge, e.g. ``:J7_c0``.
        axis: its centre line, from the end to which ``along_m`` = 0 belongs.
        width_m: its extent along the road.
        left_hand: whether traffic keeps left.
        prioritized: whether vehicles have to give way to people.
        signalled: whether a traffic light controls the people on it.
        roads: ids of the edges that it crosses.
        areas: by the ids of the walking areas at its ends, whether it is at the axis's beginning.
        junction: the connections for vehicles at its junction.
    """

    id: str
    axis: shapely.LineString
    width_m: float
    left_hand: bool = False
    prioritized: bool = False
    signalled: bool = False
    roads: Sequence[str] = ()
    areas: Mapping[str, bool] = field(default_factory=dict)
    junction: Sequence[Connection] = ()

    @cached_property
    def length_m(self) -> float:
        """Length of the axis, from kerb to kerb."""
        return float(self.axis.length)

    @cached_property
    def line(self) -> FrontPath:
        """The axis; s is 0 at its beginning."""
        lane = Lane(self.id, (*self.axis.coords,), self.length_m, math.inf, self.width_m)
        return FrontPath.along([lane], 0)

    @cached_property
    def area(self) -> shapely.Polygon:
        """The area in which people walk."""
        return self.axis.buffer(self.width_m / 2, cap_style="flat")

    @cached_property
    def connections(self) -> tuple[Connection, ...]:
        """The connections for vehicles on which a long body may touch it."""
        return tuple(each for each in self.junction if self.area.dwithin(each.line, _NEAR_M))

    @property
    def over(self) -> Sequence[Connection]:
        """The connections whose line leads over it."""
        return [each for each in self.junction if each.line.intersects(self.area)]

    @property
    def refused(self) -> str | None:
        """Why no strategy can drive over it, or None."""
        reasons = {each.refused for each in self.over} or {NO_VEHICLES}
        if self.signalled:
            reasons.add(SIGNAL)
        return next((each for each in (SIGNAL, RAIL, NO_VEHICLES) if each in reasons), None)

    @property
    def limits_mps(self) -> Sequence[float]:
        """The speed limits of the lanes before it, the lowest first."""
        return sorted({each.limit_mps for each in self.connections})


@dataclass(frozen=True, eq=False)
class Town(Frozen):
    """A network's crosswalks, connections and lanes.

    Attributes:
        crosswalks: by id, in the file's order.
        connections: those for vehicles, by their first and last lane, also where there is no
            crosswalk.
        lanes: all lanes, by id.
    """

    crosswalks: Mapping[str, Crosswalk]
    connections: Mapping[tuple[str, str], Connection]
    lanes: Mapping[str, Lane]

    @cached_property
    def path(self) -> Callable[[Connection], FrontPath]:
        """The path of a connection, which begins 40 m before the stop line, or a little earlier.

        It begins later, with the connection's first lane or upstream of it, where several lanes or
        none lead to the next one.  A path is made once.
        """
        return cache(self._path)

    def _path(self, connection: Connection) -> FrontPath:
        before = [self.lanes[connection.from_lane]]
        while sum(lane.length_m for lane in before) < _PATH_M:
            ways = [each for each in self.connections.values() if each.to_lane == before[0].id]
            if len(ways) != 1 or self.lanes[ways[0].from_lane] in before:
                break
            before = [*(self.lanes[name] for name in (ways[0].from_lane, *ways[0].via)), *before]
        beyond = [self.lanes[name] for name in (*connection.via, connection.to_lane)]
        return FrontPath.along([*before, *beyond], len(before))
