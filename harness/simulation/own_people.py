"""The harness's people at one crosswalk, who decide by the scenario.

In SUMO they are from kerb to kerb only; who waits is known to the harness alone.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

from harness.core.vocabulary import Crossing, Side
from harness.encounter.cell_constants import constants_of
from harness.encounter.crowd import Crowd
from harness.encounter.deciding import KerbLane
from harness.encounter.walkers import ChooseSpeed, Walker
from harness.engine.ids import name_inside_junction
from harness.engine.protocol import CAR, ENDS_M, Running
from harness.measures.motion.walking import cleared_s
from harness.simulation.cars import LOOK_S, SIGHT_M, Car, Passage
from harness.simulation.setup import Setup
from harness.simulation.walk import Walked
from harness.site.town import Crosswalk
from harness.site.zone import zone_of

OWN_PREFIX = "own:"
"""How the ids of the harness's people begin in SUMO; no other person's id may."""


class OwnPeople:
    """The harness's people at one crosswalk.

    Args:
        session: SUMO.
        setup: how they come and decide.
        crosswalk: where.
        pair: index of the pair.
        choose_speed: their walking speeds.
        cars: the vehicles on their ways over crosswalks.
        refresh: reads the state of a vehicle that has begun no passage.

    Attributes:
        arrivals: everybody who will come, in the order of their arrival.
        crowd: those who have come, with their decisions and walks.
        moved: the indices of those whom SUMO has.
    """

    def __init__(
        self,
        session: Running,
        setup: Setup,
        crosswalk: Crosswalk,
        pair: int,
        choose_speed: ChooseSpeed,
        cars: Mapping[str, Car],
        refresh: Callable[[Car], None],
    ) -> None:
        self._session, self._crosswalk = session, crosswalk
        self._cars, self._refresh = cars, refresh
        self.arrivals = setup.arrivals(pair, crosswalk.id)
        self._lanes: dict[tuple[str, bool], KerbLane] = {}
        for connection in crosswalk.connections:
            zone = zone_of(setup.town.path(connection), crosswalk, CAR.length_m, CAR.width_m)
            if zone is not None:
                road = zone.crossing
                at = zone.y_of(road.lane_centre_m), road.lane_width_m, road.length_m
                # The other one has the vehicles that still have to change to this lane.
                self._lanes |= {(connection.id, off): KerbLane(*at) for off in (False, True)}
        length_m, lanes = crosswalk.length_m, [*self._lanes.values()]
        self._road = Crossing(length_m, crosswalk.width_m, length_m / 2, length_m)
        constants = constants_of(setup.scenario)
        rules = replace(constants, vehicle=setup.vehicle(CAR), crossing=self._road)
        self.crowd = Crowd(self.arrivals, lanes, choose_speed, rules, self._leave)
        self.moved: set[int] = set()

    def name_of(self, index: int) -> str:
        """SUMO's id of one of them."""
        return f"{OWN_PREFIX}{name_inside_junction(self._crosswalk.id)}-{index}"

    def _see(self) -> None:
        """Look at the vehicles that have begun a passage, and at the next one in each lane."""
        begun, others = (defaultdict[tuple[str, bool], list[Passage]](list) for _ in range(2))
        for car in self._cars.values():
            for each in car.passages:
                if each.at.crosswalk is self._crosswalk:
                    on = each.at.connection.id, each.off_lane
                    (begun if each.begun else others)[on].append(each)
        for name, lane in self._lanes.items():
            in_order = sorted(begun[name], key=lambda each: -each.x_m)
            lane.coming = [*in_order, *self._next(others[name])]

    def _next(self, passages: list[Passage]) -> list[Passage]:
        """The first of those that have not begun, if people can see it."""

        def may_be_m(each: Passage) -> float:
            """x at which it may be by now: its last look is at most a second old."""
            return each.x_m + each.car.facts.max_mps * LOOK_S

        found, x_m = list[Passage](), -SIGHT_M
        for each in sorted(passages, key=may_be_m, reverse=True):
            if may_be_m(each) < x_m:
                break
            self._refresh(each.car)
            if each.x_m >= x_m:
                found, x_m = [each], each.x_m
        return found

    def begin_step(self) -> None:
        """Let those who wait decide on the vehicles' states at the step's beginning."""
        now_s = self._session.time_s
        if any(walker.due_s <= now_s for walker in self.crowd.walkers):
            self._see()
            self.crowd.begin_step(now_s)

    def place(self) -> bool:
        """Have SUMO move everybody between the kerbs to where they are at the step's end.

        Returns:
            Whether somebody was added.
        """
        walkers, added = self.crowd.walkers, False
        end_s = self._session.time_s + self._session.step_s
        places = dict(self.crowd.walk_until(end_s)) if walkers else {}
        for walker in walkers:
            index = walker.index
            if walker.start_s is None:
                continue
            if index not in self.moved:
                # Moving somebody who is not there yet ends SUMO's process.
                self.moved.add(index)
                self._add(walker)
                added = True
            else:
                along_m = min(max(places[index], ENDS_M), self._crosswalk.length_m - ENDS_M)
                place = self._crosswalk.line.place(along_m)
                self._session.move_person(self.name_of(index), place.real, place.imag)
        return added

    def end_step(self) -> None:
        """Let those who came within the step that has ended see its vehicles."""
        now_s = self._session.time_s
        if self.crowd.next_s <= now_s:
            # The vehicles are in their states at the step's end.
            self._see()
            self.crowd.advance(now_s, now_s)

    def _add(self, walker: Walker) -> None:
        """Have SUMO add somebody on the crosswalk, where their way ends, too."""
        name, ends_m = self.name_of(walker.index), (ENDS_M, self._crosswalk.length_m - ENDS_M)
        start_m, goal_m = ends_m if walker.side is Side.NEAR else ends_m[::-1]
        self._session.add_person(name, self._crosswalk.id, start_m)
        self._session.people.walk(name, [self._crosswalk.id], goal_m)

    def _leave(self, index: int) -> None:
        if index in self.moved:
            self.moved.remove(index)
            self._session.people.remove(self.name_of(index))

    def walked(self) -> Iterator[Walked]:
        """Everybody who came."""
        for walker in self.crowd.came:
            walk, name = walker.walk, self.name_of(walker.index)
            done_s = cleared_s(walk, self._road)
            until_s = math.inf if done_s is None else done_s
            done_s = done_s if until_s <= self._session.time_s else None
            yield Walked(name, True, walk, done_s, until_s, self.crowd.let_go.get(walker.index))
