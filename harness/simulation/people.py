"""The people at one crosswalk: SUMO's as they are, and the harness's, who decide by the scenario.

Every place is a distance along the crosswalk's axis: 0 at its beginning, ``length_m`` at its end.
Times are SUMO's.
"""

import math
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Protocol

import numpy as np
import shapely

from harness.core.encounter import Arrival, FloatArray, Leg, PedestrianView, Side, Walk
from harness.encounter.approaching import Approaching
from harness.encounter.cell_constants import CellConstants
from harness.encounter.crowd import Crowd
from harness.encounter.walkers import ChooseSpeed, Walker
from harness.engine.session import Session
from harness.measures.motion.walking import cleared_s
from harness.site.town import Crosswalk, Footpath
from harness.site.zone import Zone

WAITING_M = 1.0
"""A person who stands within this distance of the kerb waits there."""
STANDING_MPS = 0.1
"""SUMO's threshold for waiting."""
KERB_M = 0.02
"""A person nearer to a kerb than this is at it: SUMO may hold people 1 cm away from a kerb."""
HELD_M = 0.05
"""The harness's people are moved in SUMO only this far from both kerbs."""
OWN = "own"
"""The ids of the harness's people begin so; a crossing's id, which follows, begins with ``:``."""
WALKER_TYPE = "DEFAULT_PEDTYPE"
"""SUMO's type of the harness's people."""

_STEPS_TO_COME = 2
"""Steps after which an added person may be moved."""
_LONG = 1e6


class Axis:
    """A crosswalk's centre line in plain numbers, which are faster than shapely's points."""

    def __init__(self, crosswalk: Crosswalk) -> None:
        points = [complex(*point[:2]) for point in crosswalk.axis.coords]
        self.length_m = crosswalk.length_m
        self._pieces: list[tuple[complex, complex, float, float]] = []
        at_m = 0.0
        for a, b in pairwise(points):
            if a != b:
                self._pieces.append((a, (b - a) / abs(b - a), abs(b - a), at_m))
                at_m += abs(b - a)

    def along_m(self, x: float, y: float) -> float:
        """The place of a point: of its foot on the nearest piece, beyond the ends too."""
        at, last = complex(x, y), len(self._pieces) - 1
        best_m, place_m = math.inf, 0.0
        for number, (start, ahead, length_m, from_m) in enumerate(self._pieces):
            off = (at - start) * ahead.conjugate()
            low = off.real if number == 0 else max(off.real, 0.0)
            inside_m = low if number == last else min(low, length_m)
            away_m = math.hypot(off.real - inside_m, off.imag)
            if away_m < best_m:
                best_m, place_m = away_m, from_m + inside_m
        return place_m

    def point(self, along_m: float) -> tuple[float, float]:
        """x and y of a place on the axis."""
        pieces = (piece for piece in self._pieces if along_m <= piece[2] + piece[3])
        start, ahead, _, from_m = next(pieces, self._pieces[-1])
        at = start + (along_m - from_m) * ahead
        return at.real, at.imag


@dataclass(frozen=True, slots=True)
class Walked:
    """One person's way over the crosswalk.

    Attributes:
        id: SUMO's id, or the one that a person of the harness has there.
        own: whether the harness moved them.
        walk: in the axis's frame, where y = 0 is the axis's beginning and ``near`` the kerb there;
            its times are SUMO's.
        cleared_s: when they reached the other kerb; None if they did not.
        let_go: whether they went before the first vehicle that kept them waiting; None if none did,
            or if SUMO decided.
        time_s, places: where SUMO had them, shapes (n,) and (n, 2); None for the harness's people,
            who keep to the axis.
    """

    id: str
    own: bool
    walk: Walk
    cleared_s: float | None
    let_go: bool | None = None
    time_s: FloatArray | None = None
    places: FloatArray | None = None


class OwnPeople:
    """The harness's people at one crosswalk; in SUMO they are from kerb to kerb only.

    Args:
        session: SUMO.
        crosswalk: its id.
        axis: its axis.
        footpaths: at the axis's beginning and at its end.
        arrivals: everybody, by time since ``begin_s``.
        choose_speed: their walking speeds.
        rules: how they decide; its crossing is in the axis's frame.
        lanes: the vehicles that they look at.
    """

    def __init__(
        self,
        session: Session,
        crosswalk: str,
        axis: Axis,
        footpaths: tuple[Footpath, Footpath],
        arrivals: Sequence[Arrival],
        choose_speed: ChooseSpeed,
        rules: CellConstants,
        lanes: Sequence["SeenLane"],
    ) -> None:
        self._session, self._crosswalk, self._axis = session, crosswalk, axis
        self._footpaths, self._rules = footpaths, rules
        self.crowd = Crowd(arrivals, lanes, choose_speed, rules, self._leave)
        self.moved: dict[int, int] = {}
        """Those whom SUMO has, each with the step from which they may be moved."""
        self._steps = 0

    def name_of(self, index: int) -> str:
        """SUMO's id of one of them."""
        return f"{OWN}{self._crosswalk}-{index}"

    def place(self, then_s: float) -> None:
        """Have SUMO move everybody between the kerbs to where they are at a step's end."""
        self._steps += 1
        places = dict(self.crowd.walk_until(then_s))
        for walker in self.crowd.walkers:
            if walker.start_s is None:
                continue
            index = walker.index
            if index not in self.moved:
                # Moving somebody who is not there yet ends SUMO's process.
                self.moved[index] = self._steps + _STEPS_TO_COME
                self._add(walker)
            elif self._steps >= self.moved[index]:
                along_m = min(max(places[index], HELD_M), self._axis.length_m - HELD_M)
                self._session.move_person(self.name_of(index), *self._axis.point(along_m))

    def _add(self, walker: Walker) -> None:
        near = walker.side is Side.NEAR
        start, goal = self._footpaths if near else self._footpaths[::-1]
        name = self.name_of(walker.index)
        self._session.add_person(name, start.edge, start.inside_m, WALKER_TYPE)
        way = [start.edge, *start.areas, self._crosswalk, *reversed(goal.areas), goal.edge]
        self._session.people.walk(name, way, goal.inside_m)

    def _leave(self, index: int) -> None:
        if self.moved.pop(index, None) is not None:
            self._session.people.remove(self.name_of(index))

    def walked(self, begin_s: float) -> Iterator[Walked]:
        """Everybody who came; their times are 0 at SUMO's ``begin_s``."""
        end_s = self._session.time_s
        for walker in self.crowd.came:
            walk = moved(walker.walk, -begin_s)
            done_s = cleared_s(walk, self._rules.crossing)
            yield Walked(
                self.name_of(walker.index),
                True,
                walk,
                done_s if done_s is not None and done_s <= end_s else None,
                self.crowd.let_go.get(walker.index),
            )


class Coming(Approaching, Protocol):
    """A vehicle that people may see; x is 0 at the crosswalk's centre."""

    @property
    def passed_at_m(self) -> float:
        """x at which its rear leaves the crosswalk."""

    @property
    def begun(self) -> bool:
        """Whether it has passed R0."""


class SeenLane:
    """The vehicles of one connection as the harness's people see them.

    Args:
        zone: the zone of a car on that connection.
        lane_width_m: the width of its lane.
    """

    def __init__(self, zone: Zone, lane_width_m: float) -> None:
        self.centre_m = zone.y_of((zone.from_m + zone.to_m) / 2)
        half_m, length_m = lane_width_m / 2, zone.crosswalk_m
        low, high = self.centre_m - half_m, self.centre_m + half_m
        self.edges_m = (max(low, 0.0), min(high, length_m))
        self.coming: list[Coming] = []
        """The vehicles, the first one first."""

    def ahead(self, elapsed_s: float) -> Iterator[tuple[float, float, Coming]]:
        """See ``LaneAhead.ahead``."""
        for each in self.coming:
            gain = each.acceleration_mps2
            x_m = each.x_m + each.speed_mps * elapsed_s + gain * elapsed_s**2 / 2
            if x_m < each.passed_at_m:
                yield x_m, each.speed_mps + gain * elapsed_s, each
                if not each.begun:
                    return

    def first(self, elapsed_s: float) -> tuple[float, float, Coming] | None:
        """See ``LaneAhead.first``."""
        return next(self.ahead(elapsed_s), None)


@dataclass(slots=True, eq=False)
class Seen:
    """Somebody whom SUMO moves, from the walking area before the crosswalk to the one beyond."""

    id: str
    index: int
    first_m: float
    time_s: "array[float]" = field(default_factory=lambda: array("d"))
    x: "array[float]" = field(default_factory=lambda: array("d"))
    y: "array[float]" = field(default_factory=lambda: array("d"))
    on: list[bool] = field(default_factory=list)


class PeopleAt:
    """Everybody at one crosswalk.

    Args:
        session: SUMO.
        crosswalk: the crosswalk.
        areas: ids of the walking areas at its ends.
        first: the index of the first of SUMO's people; the harness's have smaller ones.

    Attributes:
        own: the harness's people, if they cross here.
        types: SUMO's types of everybody who came.
    """

    def __init__(
        self, session: Session, crosswalk: Crosswalk, areas: Sequence[str], first: int
    ) -> None:
        self.crosswalk, self.axis = crosswalk, Axis(crosswalk)
        self.edges = (crosswalk.id, *areas)
        self.own: OwnPeople | None = None
        self.types: set[str] = set()
        self._people, self._first = session.people, first
        self._present: dict[str, Seen] = {}
        self._came: list[Seen] = []
        self._noted_s = -math.inf
        self._views: dict[int, tuple[PedestrianView, ...]] = {}

    def note(self, time_s: float, there: Mapping[str, Sequence[str]]) -> None:
        """Note where SUMO's people are at the end of a step; ``there`` has them by edge."""
        if time_s == self._noted_s:
            return
        self._noted_s = time_s
        self._views.clear()
        crossing, *areas = self.edges
        known = {name: True for name in there.get(crossing, ()) if not name.startswith(OWN + ":")}
        for name in (name for area in areas for name in there.get(area, ())):
            if name in known or name.startswith(OWN + ":"):
                continue
            present = self._present.get(name)
            # The first place beyond the crosswalk shows when they reached the kerb.
            if (present and present.on[-1]) or self._people.next_edge(name) == crossing:
                known[name] = False
        for name, on in known.items():
            place, person = self._people.position(name), self._present.get(name)
            if person is None:
                person = Seen(name, self._first + len(self._came), self.axis.along_m(*place))
                self._present[name] = person
                self._came.append(person)
                self.types.add(self._people.type(name))
            person.time_s.append(time_s)
            person.x.append(place[0])
            person.y.append(place[1])
            person.on.append(on)
        if len(known) < len(self._present):
            self._present = {name: self._present[name] for name in known}

    @property
    def names(self) -> set[str]:
        """Ids of everybody who is here."""
        own = () if self.own is None else map(self.own.name_of, self.own.moved)
        return {*self._present, *own}

    def id_of(self, index: int) -> str:
        """The id of somebody, by the index that drivers see."""
        if index >= self._first:
            return self._came[index - self._first].id
        assert self.own is not None
        return self.own.name_of(index)

    def views(self, zone: Zone) -> tuple[PedestrianView, ...]:
        """Everybody as the driver of a vehicle with that zone would see them."""
        seen = self._views.get(id(zone))
        if seen is None:
            seen = tuple(self._view(person, zone) for person in self._present.values())
            if self.own is not None:
                walkers = self.own.crowd.walkers
                seen += tuple(_turned(walker.view(), zone) for walker in walkers)
            self._views[id(zone)] = seen
        return seen

    def places(self) -> list[tuple[float, float]]:
        """x and y of everybody, in the order of ``views``."""
        placed = [(person.x[-1], person.y[-1]) for person in self._present.values()]
        if self.own is not None:
            length_m = self.axis.length_m
            for view in (walker.view() for walker in self.own.crowd.walkers):
                near = view.side is Side.NEAR
                placed.append(
                    self.axis.point(length_m - view.remaining_m if near else view.remaining_m)
                )
        return placed

    def _view(self, person: Seen, zone: Zone) -> PedestrianView:
        """One of SUMO's people.

        Whoever has not come to the crossing's edge has not stepped off, and is shown at the kerb if
        SUMO draws them beyond it: its curves on walking areas cut corners by up to 1 m, and end in
        a jump back.  Within 1 m of the kerb, people slower than 0.1 m/s wait; others who come walk.
        """
        speed_mps, stepped_off = self._people.speed_mps(person.id), person.on[-1]
        crossing, length_m = zone.crossing, zone.crosswalk_m
        y_m = zone.y_of(self.axis.along_m(person.x[-1], person.y[-1]))
        side = zone.side_at(person.first_m)
        progress_m = y_m if side is Side.NEAR else length_m - y_m
        progress_m = min(progress_m, length_m if stepped_off else 0.0)
        if not stepped_off and progress_m >= -WAITING_M and speed_mps < STANDING_MPS:
            speed_mps = 0.0
        return PedestrianView(
            person.index,
            side,
            crossing.to_lane_m(side) - progress_m,
            length_m - progress_m,
            max(0.0, speed_mps),
            stepped_off and 0.0 <= progress_m < length_m,
        )

    def walked(self, begin_s: float) -> list[Walked]:
        """Everybody who stepped off or waited, the harness's first; see ``OwnPeople.walked``."""
        own = [] if self.own is None else [*self.own.walked(begin_s)]
        walked = (walked_of(person, self.axis) for person in self._came)
        return own + [each for each in walked if each is not None]


def walked_of(person: Seen, axis: Axis, rounding_m: float = 0.0) -> Walked | None:
    """The way of one of SUMO's people; None for those who only passed beside the kerb.

    Args:
        person: where they were at each step.
        axis: the crosswalk's.
        rounding_m: the largest error of a place: a walk that is even within it is even.
    """
    time_s, places = np.array(person.time_s), np.column_stack((person.x, person.y))
    along_m = np.array([axis.along_m(x, y) for x, y in places.tolist()])
    on = np.flatnonzero(person.on)
    near = person.first_m < axis.length_m / 2
    side = Side.NEAR if near else Side.FAR
    ahead_m = along_m if near else axis.length_m - along_m
    points = _between_kerbs(np.column_stack((time_s, ahead_m)), on, axis.length_m)
    moved_m = np.hypot(*np.diff(places, axis=0).T)
    if len(points) < 2:
        waits = _waits_from(time_s, ahead_m, moved_m, len(time_s))
        if len(on) or waits is None:
            return None
        arrival = Arrival(person.index, waits, side, math.nan)
        return Walked(person.id, False, Walk(arrival), None, None, time_s, places)
    if rounding_m:
        # In seconds this long, the distance from a straight line is that at the same time.
        even = shapely.LineString(points * [_LONG, 1.0]).simplify(2 * rounding_m)
        points = np.array(even.coords) / [_LONG, 1.0]
    start_s, end_s = float(points[0, 0]), float(points[-1, 0])
    waits = _waits_from(time_s, ahead_m, moved_m, int(on[0]))
    # There is no quantile; NaN distinguishes them from timed pedestrians.
    arrival = Arrival(
        person.index, start_s if waits is None else min(waits, start_s), side, math.nan
    )
    walked_m = float(points[-1, 1] - points[0, 1])
    legs = _legs(points, near, axis.length_m)
    walk = Walk(arrival, start_s, max(walked_m / (end_s - start_s), 1e-3), legs=legs)
    done = points[-1, 1] >= axis.length_m - KERB_M
    return Walked(person.id, False, walk, end_s if done else None, None, time_s, places)


def _turned(view: PedestrianView, zone: Zone) -> PedestrianView:
    """A view in the axis's frame, as the driver of a vehicle with that zone sees it."""
    side = view.side.other if zone.reverse else view.side
    progress_m = zone.crosswalk_m - view.remaining_m
    lateral_m = zone.crossing.to_lane_m(side) - progress_m
    return view._replace(side=side, lateral_m=lateral_m)


def moved(walk: Walk, since_s: float, length_m: float | None = None) -> Walk:
    """A walk with other times and, with ``length_m``, seen from the other kerb.

    Args:
        walk: the walk.
        since_s: its times are counted from this time.
        length_m: the crosswalk's length; None to keep the direction.
    """
    arrival = walk.arrival._replace(arrival_s=walk.arrival.arrival_s - since_s)
    legs = walk.legs
    if legs is not None:
        legs = tuple(leg._replace(time_s=leg.time_s - since_s) for leg in legs)
    if length_m is not None:
        arrival = arrival._replace(side=arrival.side.other)
        legs = legs and tuple(
            Leg(time_s, x, length_m - y, x_mps, 0.0 - y_mps, 0.0 - y_mps2)
            for time_s, x, y, x_mps, y_mps, y_mps2 in legs
        )
    start_s = None if walk.start_s is None else walk.start_s - since_s
    return replace(walk, arrival=arrival, start_s=start_s, legs=legs)


def _waits_from(
    time_s: FloatArray, ahead_m: FloatArray, moved_m: FloatArray, first: int
) -> float | None:
    """When they began to stand within 1 m of the kerb, before record ``first``; None if never."""
    waits = None
    for number in range(first - 1, 0, -1):
        if ahead_m[number] < -WAITING_M:
            break
        if moved_m[number - 1] < STANDING_MPS * (time_s[number] - time_s[number - 1]):
            waits = float(time_s[number - 1])
    return waits


def _between_kerbs(track: FloatArray, on: np.ndarray, length_m: float) -> FloatArray:
    """The rows (time, way ahead) of a walk from 0 to ``length_m``, cut at both kerbs.

    A person crosses a kerb at the speed of the nearest step between the kerbs, because they may
    have waited in the step before or may turn in the step after it.  If the kerb would then fall
    into another step, the point is taken from the straight line to the record beyond the kerb.
    """
    if not len(on):
        return track[:0]
    inside = (track[:, 1] >= KERB_M) & (track[:, 1] <= length_m - KERB_M)
    inside[: on[0]] = inside[on[-1] + 1 :] = False
    rows = np.flatnonzero(inside)
    if not len(rows):
        ends = track[max(on[0] - 1, 0)], track[min(on[-1] + 1, len(track) - 1)]
        if ends[0][1] > KERB_M or ends[1][1] < length_m - KERB_M:
            return track[:0]
        # The step is long: no record lies between the kerbs.
        return np.array([_cut(*ends, 0.0), _cut(*ends, length_m)])
    low, high = int(rows[0]), int(rows[-1])
    points = [track[low : high + 1]]
    start = _kerb(track, low, -1, 0.0, high)
    end = _kerb(track, high, 1, length_m, low)
    if start is not None:
        points.insert(0, start[None])
    if end is not None:
        points.append(end[None])
    joined = np.concatenate(points)
    return joined[np.concatenate(([True], np.diff(joined[:, 0]) > 1e-9))]


def _kerb(track: FloatArray, near: int, way: int, at_m: float, far: int) -> FloatArray | None:
    """The point at which a kerb is crossed; None if the records do not reach it.

    Args:
        track: rows (time, way ahead).
        near: the record between the kerbs that is nearest to this one.
        way: -1 for the kerb that they come from, 1 for the other one.
        at_m: the kerb.
        far: the record between the kerbs that is farthest from it.
    """
    beyond = near + way
    if not 0 <= beyond < len(track) or way * (track[beyond, 1] - at_m) < -KERB_M:
        return None
    if near != far:
        steady = _cut(track[near - way], track[near], at_m, beyond=True)
        if 0 <= way * (steady[0] - track[near, 0]) <= way * (track[beyond, 0] - track[near, 0]):
            return steady
    return _cut(track[near], track[beyond], at_m)


def _cut(before: FloatArray, after: FloatArray, at_m: float, *, beyond: bool = False) -> FloatArray:
    """The point of a straight step at which a place is reached; with ``beyond`` also after it."""
    rise = float(after[1] - before[1])
    share = (at_m - float(before[1])) / rise if rise else 0.0
    point: FloatArray = before + (share if beyond else min(max(share, 0.0), 1.0)) * (after - before)
    point[1] = at_m
    return point


def _legs(points: FloatArray, near: bool, length_m: float) -> tuple[Leg, ...]:
    """The legs of a walk; the last one stands at the other kerb, where the walk is over."""
    legs: list[Leg] = []
    for (time_s, ahead_m), (until_s, to_m) in pairwise(points.tolist()):
        forward_mps = (to_m - ahead_m) / (until_s - time_s)
        y_m, y_mps = (ahead_m, forward_mps) if near else (length_m - ahead_m, 0.0 - forward_mps)
        if not legs or abs(legs[-1].y_mps - y_mps) > 1e-9:
            legs.append(Leg(time_s, 0.0, y_m, 0.0, y_mps, 0.0))
    end_s, ahead_m = points[-1].tolist()
    legs.append(Leg(end_s, 0.0, ahead_m if near else length_m - ahead_m, 0.0, 0.0, 0.0))
    return tuple(legs)
