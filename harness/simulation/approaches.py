"""Vehicles that come near a crosswalk; lanes, curves and SUMO's right of way ahead of them."""

import math
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence

from harness.core.vocabulary import Arm
from harness.engine.ids import edge_of, is_inside_junction
from harness.engine.protocol import Running
from harness.simulation.cars import LOOK_S, SIGHT_M, Car, Facts, LanesAhead, Link, Meeting, Passage
from harness.simulation.setup import Setup
from harness.site.town import Connection, Crosswalk, Town
from harness.site.zone import zone_of

_MARGIN_M = 15.0
"""The front of a body that touches a crosswalk is this much nearer to its stop line at most."""
_MOST_MPS = 70.0
"""No vehicle is faster."""


class Approaches:
    """The edges from which vehicles may come near a chosen crosswalk.

    Args:
        setup: has the network and the crosswalks.
        session: SUMO.

    Attributes:
        before: the edges at whose ends the connections over each crosswalk begin.
        every: the number of steps between two looks.
    """

    def __init__(self, setup: Setup, session: Running) -> None:
        self._setup, self._session, self._vehicles = setup, session, session.vehicles
        sight_m = SIGHT_M if setup.own_people else 0.0
        near_m = max(setup.scenario.ego.trigger_range_m, sight_m) + _MARGIN_M
        self._reach_m = near_m + _MOST_MPS * max(LOOK_S, session.step_s)
        self.every = max(1, round(LOOK_S / session.step_s))
        self.before = {
            name: sorted({edge_of(each.from_lane) for each in crosswalk.connections})
            for name, crosswalk in setup.crosswalks.items()
        }
        self._over = defaultdict[Connection, list[Crosswalk]](list)
        for crosswalk in setup.crosswalks.values():
            for connection in crosswalk.connections:
                self._over[connection].append(crosswalk)
        others = (at for name, at in setup.town.crosswalks.items() if name not in setup.crosswalks)
        zebras = (each for each in others if each.prioritized)
        self._minds = {connection for each in zebras for connection in each.over}
        ends = [edge for edges in self.before.values() for edge in edges]
        watched = sorted(_upstream(setup.town, ends, self._reach_m))
        self._on_edge: dict[str, Sequence[str]] = dict.fromkeys(watched, ())

    def found(self, step: int, departed: Sequence[str]) -> Iterator[str]:
        """Those who departed on watched edges, and who came onto them since the last look."""
        for name in departed:
            if edge_of(self._vehicles.lane(name)) in self._on_edge:
                yield name
        if step % self.every:
            return
        for edge, before in self._on_edge.items():
            names = self._session.last.vehicles_on(edge)
            if names != before:
                self._on_edge[edge] = names
                yield from (name for name in names if name not in before)

    def car(self, name: str, automated: bool, driver: Arm) -> Car:
        """A vehicle that has been found."""
        kind, factor = self._session.built(name), self._vehicles.speed_factor(name)
        vehicle, type_id = self._setup.vehicle(kind, driver), self._vehicles.type(name)
        return Car(name, Facts(type_id, automated, vehicle, factor, kind.max_speed_mps))

    def coming(self, car: Car) -> list[Passage] | None:
        """The passages ahead of a vehicle; None if it is on the same lane, or in a junction.

        Its limits and connections ahead are those from now on.
        """
        lane, town, body = self._vehicles.lane(car.name), self._setup.town, car.facts.vehicle
        if lane == car.lane:
            return None
        car.lane = lane
        if is_inside_junction(lane) or not lane:
            return None
        car.ahead = self._ahead(car, car.odometer_m - self._vehicles.lane_position_m(car.name))
        found = []
        for link in car.ahead.links:
            for crosswalk in self._over.get(link.connection, ()):
                path = town.path(link.connection)
                zone = zone_of(path, crosswalk, body.length_m, body.width_m)
                if zone is not None:
                    at = Meeting.of(crosswalk, link.connection, zone, link.begin_m)
                    found.append(Passage(car, at, body))
        return found

    def _ahead(self, car: Car, at_m: float) -> LanesAhead:
        """The limits and connections ahead of a vehicle whose lane began at ``at_m``."""
        town, last = self._setup.town, ""
        limits, links = list[tuple[float, float]](), list[Link]()
        until_m = at_m + town.lanes[car.lane].length_m
        for name in self._session.lanes_ahead(car.name, car.lane):
            lanes: tuple[str, ...] = (name,)
            if last:
                way = town.connections.get((last, name))
                if way is None or at_m > until_m + self._reach_m:
                    break
                inside_m = sum(town.lanes[each].length_m for each in way.via)
                links.append(Link(at_m, at_m + inside_m, way, self._yields(way)))
                lanes = (*way.via, name)
            for each in lanes:
                limits.append((at_m, car.facts.limit_mps(town.lanes[each].limit_mps)))
                at_m += town.lanes[each].length_m
            last = name
        return LanesAhead(tuple(limits), min(limit for _, limit in limits), tuple(links))

    def _yields(self, way: Connection) -> bool:
        """Whether SUMO keeps the right of way on a connection.

        It does so except where it would slow down for a chosen crosswalk on which people have
        priority, and no vehicles or people have it elsewhere.
        """
        zebra = any(each.prioritized for each in self._over.get(way, ()))
        return way.gives_way or way in self._minds or not zebra


def _upstream(town: Town, ends: Sequence[str], reach_m: float) -> Collection[str]:
    """The edges from which a vehicle comes to the end of one of some edges within a distance."""
    before = defaultdict[str, list[Connection]](list)
    for each in town.connections.values():
        before[edge_of(each.to_lane)].append(each)
    away_m = dict.fromkeys(ends, 0.0)
    edges = [*away_m]
    while edges:
        edge = edges.pop()
        for each in before[edge]:
            name = edge_of(each.from_lane)
            through_m = away_m[edge] + town.lanes[each.to_lane].length_m
            if through_m <= reach_m and through_m < away_m.get(name, math.inf):
                away_m[name] = through_m
                edges.append(name)
    return away_m
