"""The people that a driver with a sensor sees: late, in part, with errors, or hidden by vehicles.

Everything is in the network's coordinates, where a vehicle is a rectangle behind its front bumper.
"""

import math
from collections.abc import Iterable, Mapping

from harness.core.encounter import PedestrianView
from harness.engine.session import Session
from harness.simulation.cars import Passage
from harness.simulation.people import PeopleAt
from harness.simulation.shares import number_of
from harness.strategies.perception.occlusion import Point, Rectangle, is_hidden, outline
from harness.strategies.perception.sensor import Sensor, eye_behind
from harness.strategies.perception.updates import Updates, Views, track_from

_LONGEST_M = 30.0
"""No vehicle whose front is this much further away than a person hides them."""


class Outlines:
    """The outlines of all vehicles, those that park beside a road too, read once in a step."""

    def __init__(self, session: Session) -> None:
        self._session, self._vehicles, self._read_s = session, session.vehicles, -math.inf
        self._found: Mapping[str, tuple[Point, Rectangle]] = {}

    def now(self) -> Mapping[str, tuple[Point, Rectangle]]:
        """The front bumper and the rectangle of each vehicle, by its id."""
        if self._read_s != self._session.time_s:
            self._read_s = self._session.time_s
            self._found = {name: self._outline(name) for name in self._vehicles.ids()}
        return self._found

    def _outline(self, name: str) -> tuple[Point, Rectangle]:
        of, front = self._vehicles, self._vehicles.position(name)
        # SUMO's angles are clockwise from north.
        heading = math.radians(90.0 - of.angle_deg(name))
        return front, outline(front, heading, of.length_m(name), of.width_m(name))


class Sight:
    """What the driver of one passage sees, by a sensor state and random streams of its own.

    Args:
        sensor: the driver's sensor.
        pair: index of the pair; it keys the streams with the ids of vehicle, crosswalk and person.
        passage: the passage.
        people: everybody at its crosswalk.
        outlines: those of all vehicles.
    """

    def __init__(
        self, sensor: Sensor, pair: int, passage: Passage, people: PeopleAt, outlines: Outlines
    ) -> None:
        self._passage, self._people, self._outlines = passage, people, outlines
        keys = number_of(passage.car.name), number_of(passage.crosswalk.id)
        self._updates = Updates(
            sensor, lambda index: track_from(sensor, pair, keys, number_of(people.id_of(index)))
        )
        self._hides = sensor.vehicles_hide

    def look(self, near: bool) -> Views:
        """The people that the driver sees now; ``near``: within the detection range."""
        return self._updates.shown(len(self._passage.shown), lambda: self._truth(near))

    def _truth(self, near: bool) -> Iterable[tuple[PedestrianView, bool]]:
        """Everybody, and whether they are in range and in sight."""
        views = self._people.views(self._passage)
        if not near or not self._hides or not views:
            return ((view, near) for view in views)
        car, outlines = self._passage.car, self._outlines.now()
        (x_m, y_m), rectangle = outlines[car.name]
        back_m, heading = eye_behind(car.vehicle.length_m), rectangle.heading_rad
        eye = x_m - back_m * math.cos(heading), y_m - back_m * math.sin(heading)
        places = [self._people.place(view.index) for view in views]
        reach_m = max(math.dist(eye, place) for place in places) + _LONGEST_M
        hiding = [
            other
            for name, (front, other) in outlines.items()
            if name != car.name and math.dist(eye, front) < reach_m
        ]
        return (
            (view, not is_hidden(eye, place, hiding))
            for view, place in zip(views, places, strict=True)
        )
