"""The harness's people at one crosswalk, who decide by the scenario.

In SUMO they are from kerb to kerb only; who waits is known to the harness alone.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from harness.core.encounter import Crossing, FloatArray, Side, Walk
from harness.encounter.cell_constants import constants_of
from harness.encounter.crowd import Crowd
from harness.encounter.deciding import Lane
from harness.encounter.walkers import ChooseSpeed, Walker
from harness.engine.session import Session
from harness.measures.motion.walking import cleared_s, states_at
from harness.simulation.cars import Car, Passage
from harness.simulation.setup import CAR_M, Setup
from harness.site.town import Crosswalk
from harness.site.zone import zone_of

HELD_M = 0.05
"""The harness's people are moved in SUMO only this far from both kerbs."""
OWN_CROSSES = "own:"
"""The ids of the harness's people begin so; a crossing's id begins with ``:``."""
WALKER_TYPE = "DEFAULT_PEDTYPE"
"""SUMO's type of the harness's people."""

_STEPS_TO_COME = 2
"""Steps after which an added person may be moved."""
_CAR_MPS2 = (2.6, 4.5)
"""Acceleration and deceleration of SUMO's car."""


@dataclass(frozen=True, slots=True)
class Walked:
    """One person's way over the crosswalk.

    Attributes:
        id: SUMO's id, or the one that a person of the harness has there.
        own: whether the harness moved them.
        walk: in the axis's frame, where y = 0 is the axis's beginning, ``near`` the kerb there, and
            x the way to the axis's left; its times are SUMO's.
        cleared_s: when they reached the other kerb; None if they did not.
        until_s: when they reached it, or were last seen; infinite if they are there at the end.
        let_go: whether they went before the first vehicle that kept them waiting; None if none did,
            or if SUMO decided.
    """

    id: str
    own: bool
    walk: Walk
    cleared_s: float | None
    until_s: float
    let_go: bool | None = None

    def places(self, time_s: FloatArray, crosswalk: Crosswalk) -> FloatArray:
        """Where they are between the kerbs at some times, shape (n, 2); NaN at other times."""
        assert self.walk.start_s is not None
        found = np.full((len(time_s), 2), np.nan)
        on = (time_s >= self.walk.start_s) & (time_s <= self.until_s)
        if on.any():
            road = Crossing(crosswalk.length_m, 1.0, 0.0, 1.0)
            left_m, along_m, *_ = states_at(self.walk, road, time_s[on])
            found[on] = [*map(crosswalk.point, along_m.tolist(), left_m.tolist())]
        return found


class OwnPeople:
    """The harness's people at one crosswalk.

    Args:
        session: SUMO.
        setup: how they come and decide.
        crosswalk: where.
        pair: index of the pair.
        choose_speed: their walking speeds.
        cars: the vehicles that they may see.
    """

    def __init__(
        self,
        session: Session,
        setup: Setup,
        crosswalk: Crosswalk,
        pair: int,
        choose_speed: ChooseSpeed,
        cars: "Mapping[str, Car]",
    ) -> None:
        self._session, self._crosswalk = session, crosswalk
        self._cars = cars
        self._footpaths = [setup.town.footpath(crosswalk, end) for end in range(2)]
        self.arrivals = setup.arrivals(pair, crosswalk.id)
        self._lanes: dict[str, Lane] = {}
        for connection in crosswalk.connections:
            zone = zone_of(setup.town.path(connection), crosswalk, *CAR_M)
            if zone is not None:
                road = zone.crossing
                centre_m = zone.y_of(road.lane_centre_m)
                self._lanes[connection.id] = Lane(centre_m, road.lane_width_m, road.length_m)
        length_m, lanes = crosswalk.length_m, [*self._lanes.values()]
        self._road = Crossing(length_m, crosswalk.width_m, length_m / 2, length_m)
        car = setup.vehicle(*CAR_M, *_CAR_MPS2)
        rules = replace(constants_of(setup.scenario), vehicle=car, crossing=self._road)
        self.crowd = Crowd(self.arrivals, lanes, choose_speed, rules, self._leave)
        self.moved: dict[int, int] = {}
        """Those whom SUMO has, each with the step from which they may be moved."""
        self._steps = 0

    def name_of(self, index: int) -> str:
        """SUMO's id of one of them."""
        return f"own{self._crosswalk.id}-{index}"

    def _see(self) -> None:
        """Look at the vehicles that come."""
        coming = defaultdict[str, list[Passage]](list)
        for car in self._cars.values():
            for each in car.passages:
                if each.crosswalk is self._crosswalk:
                    coming[each.connection.id].append(each)
        for name, lane in self._lanes.items():
            lane.coming = sorted(coming[name], key=lambda each: -each.x_m)

    def begin_step(self) -> None:
        """Let those who wait decide on the vehicles' states at the step's beginning."""
        if self.crowd.walkers:
            self._see()
            self.crowd.begin_step(self._session.time_s)

    def place(self) -> bool:
        """Have SUMO move everybody between the kerbs to where they are at the step's end.

        Returns:
            Whether somebody was added.
        """
        self._steps += 1
        walkers, added = self.crowd.walkers, False
        end_s = self._session.time_s + self._session.step_s
        places = dict(self.crowd.walk_until(end_s)) if walkers else {}
        for walker in walkers:
            index = walker.index
            if walker.start_s is None:
                continue
            if index not in self.moved:
                # Moving somebody who is not there yet ends SUMO's process.
                self.moved[index] = self._steps + _STEPS_TO_COME
                self._add(walker)
                added = True
            elif self._steps >= self.moved[index]:
                along_m = min(max(places[index], HELD_M), self._crosswalk.length_m - HELD_M)
                self._session.move_person(self.name_of(index), *self._crosswalk.point(along_m))
        return added

    def end_step(self) -> None:
        """Let those who came within the step that has ended see its vehicles."""
        now_s = self._session.time_s
        if self.crowd.next_s <= now_s:
            # The vehicles are in their states at the step's end.
            self._see()
            self.crowd.advance(now_s, now_s)

    def _add(self, walker: Walker) -> None:
        start, goal = self._footpaths if walker.side is Side.NEAR else self._footpaths[::-1]
        name = self.name_of(walker.index)
        self._session.add_person(name, start.edge, start.inside_m, WALKER_TYPE)
        way = [start.edge, *start.areas, self._crosswalk.id, *reversed(goal.areas), goal.edge]
        self._session.people.walk(name, way, goal.inside_m)

    def _leave(self, index: int) -> None:
        if self.moved.pop(index, None) is not None:
            self._session.people.remove(self.name_of(index))

    def walked(self) -> Iterator[Walked]:
        """Everybody who came."""
        for walker in self.crowd.came:
            walk, name = walker.walk, self.name_of(walker.index)
            done_s = cleared_s(walk, self._road)
            until_s = math.inf if done_s is None else done_s
            done_s = done_s if until_s <= self._session.time_s else None
            yield Walked(name, True, walk, done_s, until_s, self.crowd.let_go.get(walker.index))
