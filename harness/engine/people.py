"""Pedestrians in SUMO who are held where they are told to be, at every step."""

import math
from collections.abc import Sequence
from typing import Any

from harness.core.encounter import Arrival, Crossing, Side
from harness.engine.shown import Shown
from harness.site import Site

WALKER = "walker"
"""SUMO's type of a pedestrian."""

NO_ANGLE = -1073741824.0
"""SUMO's INVALID_DOUBLE_VALUE: the angle follows from the movement."""

KEEP_ROUTE = 2
"""The person leaves their route for the place."""

MATCH_THRESHOLD_M = 1.0
"""How far SUMO looks for a lane.  Named one by one: unpacking costs a hundredth of a step."""


class HeldPeople:
    """Everyone who comes to the crosswalk, from their arrival until they are removed.

    A person exists only after the step that follows its insertion, and moving one that does not
    exist ends the process: each is announced some steps ahead and held at their kerb until they
    are placed for the first time.

    Args:
        api: the module ``libsumo`` or ``traci``, connected to a simulation.
        site: its crosswalk.
        crossing: the crosswalk's constants.
        copy: ends their type and their names, where everybody is there more than once.
        shown: where SUMO's own driver is to see them; None: where they are.  It may be set at any
            time.
        move: the function called for each of them at every step; None: the module's own.
    """

    def __init__(
        self,
        api: Any,
        site: Site,
        crossing: Crossing,
        copy: str = "",
        shown: Shown | None = None,
        move: Any = None,
    ) -> None:
        self._person, self._move = api.person, move or api.person.moveToXY
        self._copy, self.shown = copy, shown
        self._footpaths = {side: site.footpath(side) for side in Side}
        self._to_network = site.frame.to_network
        # Network coordinates of (0, y) are origin + y · across.
        self._line = (*self._to_network(0.0, 0.0), site.frame.across_x, site.frame.across_y)
        self._kerb_m = {Side.NEAR: 0.0, Side.FAR: crossing.length_m}
        self.ids: dict[int, str] = {}
        """SUMO's names of those who are there, by index."""
        self._waiting: dict[int, tuple[float, float]] = {}
        self._coming: dict[int, tuple[float, float]] = {}

    def begin(self, arrivals: Sequence[Arrival], run: int) -> None:
        """Take the people of an episode or hour, by arrival; its number is in their names."""
        self._arrivals, self._run, self._announced = arrivals, run, 0
        self._sides = {arrival.index: arrival.side for arrival in arrivals}
        self._next_s = arrivals[0].arrival_s if arrivals else math.inf
        self._waiting.clear()
        self._coming.clear()

    def before_step(self, places: Sequence[tuple[int, float]], until_s: float) -> bool:
        """Put everyone where they are at the step's end, and add everyone who comes by then.

        Returns:
            Whether somebody was added: ``after_step`` is then due.
        """
        if places or self._waiting:
            self._place(places)
        if self._next_s > until_s:
            return False
        while self._next_s <= until_s:
            arrival = self._arrivals[self._announced]
            self._announced += 1
            coming = self._announced < len(self._arrivals)
            self._next_s = self._arrivals[self._announced].arrival_s if coming else math.inf
            self.add(arrival.index, arrival.side, self._footpaths[arrival.side].inside_m)
            self._coming[arrival.index] = self._first_place(arrival)
        return True

    def after_step(self) -> None:
        """Whoever was announced exists from now on."""
        self._waiting.update(self._coming)
        self._coming.clear()

    def add(self, index: int, side: Side, start_m: float) -> str:
        """Put someone on the footpath of their side, on their way to the other one."""
        name = f"pedestrian{self._copy}-{self._run}-{index}"
        origin, goal = self._footpaths[side], self._footpaths[side.other]
        self._person.add(name, origin.edge, start_m, typeID=WALKER + self._copy)
        self._person.appendWalkingStage(name, [origin.edge, goal.edge], goal.inside_m)
        self.ids[index] = name
        return name

    def remove(self, index: int) -> None:
        """Take away somebody who has reached the other kerb."""
        self._person.remove(self.ids.pop(index))

    def clear(self) -> None:
        """Take everybody away."""
        for name in self.ids.values():
            self._person.remove(name)
        self.ids.clear()

    def _first_place(self, arrival: Arrival) -> tuple[float, float]:
        """Network coordinates at which somebody is held until they are placed."""
        if arrival.path is not None:
            return self._to_network(arrival.path[0].x_m, arrival.path[0].y_m)
        shown, side = self.shown, arrival.side
        return self._to_network(0.0, self._kerb_m[side] if shown is None else shown.coming_y(side))

    def _place(self, places: Sequence[tuple[int, float]]) -> None:
        """Move those with a place to it; the others who are announced wait at their kerbs."""
        origin_x, origin_y, across_x, across_y = self._line
        move, ids, waiting = self._move, self.ids, self._waiting
        if self.shown is not None:
            sides, y_of = self._sides, self.shown.y_of
            places = [(index, y_of(sides[index], y)) for index, y in places]
        for index, y in places:
            x_net, y_net = origin_x + across_x * y, origin_y + across_y * y
            move(ids[index], "", x_net, y_net, NO_ANGLE, KEEP_ROUTE, MATCH_THRESHOLD_M)
            if waiting:
                waiting.pop(index, None)
        for index, (x_net, y_net) in waiting.items():
            move(ids[index], "", x_net, y_net, NO_ANGLE, KEEP_ROUTE, MATCH_THRESHOLD_M)
