"""Pedestrians in SUMO whose positions are set at every step."""

import math
from collections.abc import Sequence

from harness.core.vocabulary import Arrival, Side, arrives_s
from harness.engine.ids import lane_of
from harness.engine.session import Session
from harness.site.road_frame import RoadFrame

WALKER = "walker"
"""The SUMO type of pedestrians."""

_BESIDE_M = 1.0
"""Distance from the end of a footpath at the crosswalk at which pedestrians are inserted."""


class HeldPeople:
    """All pedestrians at the crosswalk, from their arrival until they are removed.

    A person exists in SUMO only after the step that follows their insertion, and moving a person
    who does not exist ends the process.  So pedestrians are announced some steps ahead, and held at
    their kerb until their first position is set.

    Args:
        session: the simulation.
        frame: the road frame.
        length_m: from kerb to kerb.
    """

    def __init__(self, session: Session, frame: RoadFrame, length_m: float) -> None:
        self._session, self._people, self._move = session, session.people, session.move_person
        # Both footpaths lead from the near side to the far side.
        near_m = session.lane_length_m(lane_of("near")) - _BESIDE_M
        self._places = {Side.NEAR: ("near", near_m), Side.FAR: ("far", _BESIDE_M)}
        self._to_network = frame.to_network
        # Network coordinates of (0, y) are origin + y · across.
        self._line = (*self._to_network(0.0, 0.0), -frame.along_y, frame.along_x)
        self._kerb_m = {Side.NEAR: 0.0, Side.FAR: length_m}
        self.ids: dict[int, str] = {}
        """SUMO's ids of the pedestrians in the simulation, by index."""
        self.next_s = math.inf
        """Arrival of the next pedestrian who is not yet announced."""
        self._arrivals: Sequence[Arrival] = ()
        self._run = self._announced = 0
        self._waiting: dict[int, tuple[float, float]] = {}
        self._coming: dict[int, tuple[float, float]] = {}

    def begin(self, arrivals: Sequence[Arrival], run: int) -> None:
        """Begin an episode with these arrivals; their ids contain its number ``run``."""
        self._arrivals, self._run, self._announced = arrivals, run, 0
        self.next_s = arrives_s(arrivals, 0)
        self._waiting.clear()
        self._coming.clear()

    def place(self, places: Sequence[tuple[int, float]]) -> None:
        """Move pedestrians to their positions; other announced pedestrians stay at their kerbs."""
        origin_x, origin_y, across_x, across_y = self._line
        move, ids, waiting = self._move, self.ids, self._waiting
        for index, y in places:
            move(ids[index], origin_x + across_x * y, origin_y + across_y * y)
            if waiting:
                waiting.pop(index, None)
        for index, (x_net, y_net) in waiting.items():
            move(ids[index], x_net, y_net)

    def announce(self, until_s: float) -> None:
        """Insert the pedestrians who arrive by ``until_s``; after the step they are waiting."""
        while self.next_s <= until_s:
            arrival = self._arrivals[self._announced]
            self._announced += 1
            self.next_s = arrives_s(self._arrivals, self._announced)
            self._add(arrival.index, arrival.side)
            # They are held there until their first position is set.
            path, kerb = arrival.path, (0.0, self._kerb_m[arrival.side])
            at = (path[0].x_m, path[0].y_m) if path else kerb
            self._coming[arrival.index] = self._to_network(*at)

    def after_step(self) -> None:
        """Note that the announced pedestrians now exist in SUMO."""
        self._waiting.update(self._coming)
        self._coming.clear()

    def _add(self, index: int, side: Side) -> None:
        """Insert a pedestrian on the footpath of their side, with a route to the other side."""
        name = f"pedestrian-{self._run}-{index}"
        (origin, from_m), (goal, to_m) = self._places[side], self._places[side.other]
        self._session.add_person(name, origin, from_m, WALKER)
        self._people.walk(name, [origin, goal], to_m)
        self.ids[index] = name

    def remove(self, index: int) -> None:
        """Remove a pedestrian who has reached the other kerb."""
        self._people.remove(self.ids.pop(index))

    def clear(self) -> None:
        """Remove all pedestrians."""
        for name in self.ids.values():
            self._people.remove(name)
        self.ids.clear()
