"""Finds the vehicles that come near a chosen crosswalk, and what lies ahead of them."""

import math
from collections.abc import Iterable, Sequence

from harness.core.encounter import Arm
from harness.engine.session import Session
from harness.simulation.cars import Car, Passage
from harness.simulation.setup import Setup

_SIGHT_M = 200.0
"""The harness's people see vehicles that are this near."""
_MARGIN_M = 15.0
"""The front of a body that touches a crosswalk is this much nearer to its stop line at most."""
_MOST_MPS = 70.0
"""No vehicle is faster."""
_LOOK_S = 1.0
"""Time between two looks at the watched edges; they reach so far that nobody is missed."""


class Approaches:
    """The edges from which vehicles may come near a chosen crosswalk.

    Args:
        setup: has the network and the crosswalks.
        session: SUMO.

    Attributes:
        before: the edges at whose ends the connections over each crosswalk begin.
    """

    def __init__(self, setup: Setup, session: Session) -> None:
        self._setup, self._session, self._vehicles = setup, session, session.vehicles
        self._step_s = session.step_s
        self._near_m = max(setup.scenario.ego.trigger_range_m, _SIGHT_M * setup.own_people)
        self._near_m += _MARGIN_M
        self._reach_m = self._near_m + _MOST_MPS * max(_LOOK_S, self._step_s)
        self._every = max(1, round(_LOOK_S / self._step_s))
        self.before = {
            name: sorted({_edge(each.from_lane) for each in setup.town.connections(name)})
            for name in setup.crosswalks
        }
        self._on_edge: dict[str, Sequence[str]] = dict.fromkeys(self._watched(), ())
        self._new: list[str] = []

    def _watched(self) -> Iterable[str]:
        """The edges from which a vehicle may reach a chosen crosswalk within the reach."""
        town = self._setup.town
        away_m = {edge: 0.0 for edges in self.before.values() for edge in edges}
        todo = [*away_m]
        while todo:
            edge = todo.pop()
            lengths_m = (town.lane(each).length_m for each in town.lanes(edge))
            through_m = away_m[edge] + min(lengths_m, default=0.0)
            if through_m > self._reach_m:
                continue
            for before in town.before(edge):
                if through_m < away_m.get(before, math.inf):
                    away_m[before] = through_m
                    todo.append(before)
        return sorted(away_m)

    def departed(self, name: str) -> None:
        """Note a vehicle that has departed, which may be near at once."""
        if _edge(self._vehicles.lane(name)) in self._on_edge:
            self._new.append(name)

    def found(self, step: int) -> Sequence[str]:
        """The vehicles that have come onto watched edges."""
        new, self._new = self._new, []
        if step % self._every == 0:
            for edge, before in self._on_edge.items():
                names = self._session.vehicles_on(edge)
                if names != before:
                    self._on_edge[edge] = names
                    new += set(names).difference(before)
        return new

    def car(self, name: str, type_id: str, automated: bool, driver: Arm) -> Car:
        """A vehicle that has been found."""
        vehicles = self._vehicles
        vehicle = self._setup.vehicle(
            vehicles.length_m(name),
            vehicles.width_m(name),
            vehicles.acceleration_limit_mps2(name),
            vehicles.deceleration_limit_mps2(name),
            driver,
        )
        factor, most_mps = vehicles.speed_factor(name), vehicles.max_speed_mps(name)
        late = not vehicle.obeys_at_once
        return Car(name, type_id, automated, vehicle, factor, most_mps, late)

    def steps_until_near(self, car: Car) -> int:
        """The number of steps after which a planned vehicle may be near; 0 if it is."""
        left_m = car.passages[0].first_m - car.odometer_m - self._near_m
        return 0 if left_m <= 0.0 else 1 + int(left_m / (_MOST_MPS * self._step_s))

    def coming(self, car: Car) -> list[Passage] | None:
        """The passages ahead of a vehicle; None if it is still on its lane, or in a junction.

        Its limits and connections ahead are those from now on.
        """
        if car.odometer_m < car.replan_m:
            return None
        lane = self._vehicles.lane(car.name)
        if lane.startswith(":"):
            ends_m = (link.end_m for link in car.links if link.end_m > car.odometer_m)
            car.replan_m = next(ends_m, -math.inf)
        if lane == car.lane or lane.startswith(":") or not lane:
            return None
        car.lane, zones, town = lane, self._setup.zones, self._setup.town
        begin_m = car.odometer_m - self._vehicles.lane_position_m(car.name)
        limits, links = zones.ahead(self._lanes(car.name, lane), self._reach_m)
        car.limits = [(begin_m + at_m, car.limit_mps(limit)) for at_m, limit in limits]
        car.least_mps = min(limit for _, limit in car.limits)
        car.links = [link.moved(begin_m) for link in links]
        # From a single lane a vehicle comes onto another one at its end only.
        alone = len(town.lanes(_edge(lane))) == 1
        car.replan_m = begin_m + town.lane(lane).length_m if alone else -math.inf
        return [
            Passage(car, crosswalk, link.connection, *found, link.begin_m, car.vehicle)
            for link in car.links
            for crosswalk in zones.crosswalks(link.connection)
            if (
                found := zones.at(
                    link.connection, crosswalk, car.vehicle.length_m, car.vehicle.width_m
                )
            )
        ]

    def _lanes(self, name: str, lane: str) -> Sequence[str]:
        """The lanes that a vehicle will follow, its own first."""
        rows = self._vehicles.best_lanes(name)
        index = next((i for i, row in enumerate(rows) if row[0] == lane), None)
        if index is None:
            return [lane]
        row = rows[index]
        if len(row[5]) < 2 and row[3]:
            # It has to change lane before the junction.
            row = rows[index + row[3]]
        return [lane, *row[5][1:]]


def _edge(lane: str) -> str:
    return lane.rpartition("_")[0]
