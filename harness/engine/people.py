"""Pedestrians in SUMO who are held where they are told to be, at every step."""

import math
from collections.abc import Sequence
from typing import Any

from harness.encounter import Arrival, Crossing, Side
from harness.engine.shown import Shown
from harness.roads import Site

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
        api: the module ``libsumo``, connected to a simulation.
        site: its crosswalk.
        crossing: the crosswalk's constants.
        copy: ends their type and their names, where everybody is there more than once.
        shown: where they are put for the eyes of SUMO's own driver; None: where they are.
    """

    def __init__(
        self,
        api: Any,
        site: Site,
        crossing: Crossing,
        copy: str = "",
        shown: Shown | None = None,
    ) -> None:
        self._person, self._move = api.person, api.person.moveToXY
        self._copy, self._shown = copy, shown
        self._footpaths = {
            side: (site.footpath(side).edge, site.footpath(side).inside_m) for side in Side
        }
        # Network coordinates of (0, y) are origin + y · across.
        self._line = (
            *site.frame.to_network(0.0, 0.0),
            site.frame.across_x,
            site.frame.across_y,
        )
        self._kerb_m = {Side.NEAR: 0.0, Side.FAR: crossing.length_m}
        if shown is not None:
            self._kerb_m = {side: shown.coming_y(side) for side in Side}
        self._ids: dict[int, str] = {}
        self._waiting: dict[int, float] = {}
        self._coming: list[Arrival] = []

    def begin(self, arrivals: Sequence[Arrival], hour: int) -> None:
        """Take the people of an hour, by arrival time; its number is in their names."""
        self._arrivals, self._hour, self._announced = arrivals, hour, 0
        self._next_s = arrivals[0].arrival_s if arrivals else math.inf

    @property
    def present(self) -> bool:
        """Whether anybody is there."""
        return bool(self._ids)

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
            name = f"pedestrian{self._copy}-{self._hour}-{arrival.index}"
            origin, start_m = self._footpaths[arrival.side]
            goal, goal_m = self._footpaths[arrival.side.other]
            self._person.add(name, origin, start_m, typeID=WALKER + self._copy)
            self._person.appendWalkingStage(name, [origin, goal], goal_m)
            self._ids[arrival.index] = name
            self._coming.append(arrival)
        return True

    def after_step(self) -> None:
        """Whoever was announced exists from now on."""
        for arrival in self._coming:
            self._waiting[arrival.index] = self._kerb_m[arrival.side]
        self._coming.clear()

    def _place(self, places: Sequence[tuple[int, float]]) -> None:
        """Move those with a place to it; the others who are announced wait at their kerbs."""
        origin_x, origin_y, across_x, across_y = self._line
        move, ids, waiting = self._move, self._ids, self._waiting
        if self._shown is not None:
            arrivals, y_of = self._arrivals, self._shown.y_of
            places = [(index, y_of(arrivals[index].side, y)) for index, y in places]
        for index, y in places:
            x_net, y_net = origin_x + across_x * y, origin_y + across_y * y
            move(ids[index], "", x_net, y_net, NO_ANGLE, KEEP_ROUTE, MATCH_THRESHOLD_M)
            if waiting:
                waiting.pop(index, None)
        for index, y in waiting.items():
            x_net, y_net = origin_x + across_x * y, origin_y + across_y * y
            move(ids[index], "", x_net, y_net, NO_ANGLE, KEEP_ROUTE, MATCH_THRESHOLD_M)

    def remove(self, index: int) -> None:
        """Take away somebody who has reached the other kerb."""
        self._person.remove(self._ids.pop(index))

    def clear(self) -> None:
        """Take everybody away."""
        for name in self._ids.values():
            self._person.remove(name)
        self._ids.clear()
        self._waiting.clear()
        self._coming.clear()
