"""The people that drivers with a sensor see: late, in part, with errors, or hidden by vehicles.

Everything is in the network's coordinates, where a vehicle is a rectangle behind its front bumper.
"""

import math
from collections.abc import Iterable, Mapping

from harness.core.encounter import Arm, PedestrianView
from harness.engine.session import Session
from harness.scenario import Scenario
from harness.simulation.cars import Passage
from harness.simulation.people import PeopleAt
from harness.simulation.shares import number_of
from harness.strategies.perception.occlusion import Point, Rectangle, is_hidden, outline
from harness.strategies.perception.sensor import eye_behind, sensor_of
from harness.strategies.perception.updates import Updates, Views, track_from

_LONGEST_M = 30.0
"""No vehicle whose front is this much further away than a person hides them."""


class Sight:
    """What the drivers of an arm see.

    Each passage has a sensor state and random streams of its own, keyed by the ids of vehicle,
    crosswalk and person.

    Args:
        scenario: has the sensor of each driver; without one they see the truth.
        pair: index of the pair, which keys the streams.
        session: SUMO.
        people: everybody at each crosswalk.
    """

    def __init__(
        self,
        scenario: Scenario,
        pair: int,
        session: Session,
        people: Mapping[str, PeopleAt],
    ) -> None:
        self._sensors = {driver: sensor_of(scenario, driver) for driver in Arm}
        self._pair, self._people, self._session = pair, people, session
        self._read_s = -math.inf
        self._outlines: dict[str, tuple[Point, Rectangle]] = {}

    def begin(self, passage: Passage, driver: Arm) -> None:
        """Begin the updates of a vehicle's sensor when its strategy takes over."""
        sensor = self._sensors[driver]
        if sensor is None:
            return
        crosswalk = passage.crosswalk.id
        people, keys = self._people[crosswalk], (number_of(passage.car.name), number_of(crosswalk))
        passage.shown, passage.hides = [], sensor.vehicles_hide
        passage.updates = Updates(
            sensor,
            lambda index: track_from(sensor, self._pair, keys, number_of(people.id_of(index))),
        )

    def shown(self, passage: Passage, near: bool) -> Views:
        """The people that a vehicle's driver sees; ``near``: within its detection range."""
        assert passage.updates is not None
        assert passage.shown is not None
        step = len(passage.shown)
        shown = passage.updates.shown(step, lambda: self._look(passage, near))
        passage.shown.append(shown)
        return shown

    def _look(self, passage: Passage, near: bool) -> Iterable[tuple[PedestrianView, bool]]:
        people, car = self._people[passage.crosswalk.id], passage.car
        views = people.views(passage)
        if not near or not passage.hides or not views:
            return ((view, near) for view in views)
        if self._read_s != self._session.time_s:
            self._read_s = self._session.time_s
            # Vehicles that park beside a road are among them.
            self._outlines = {name: self._outline(name) for name in self._session.vehicles.ids()}
        (x_m, y_m), rectangle = self._outlines[car.name]
        back_m, heading = eye_behind(car.vehicle.length_m), rectangle.heading_rad
        eye = x_m - back_m * math.cos(heading), y_m - back_m * math.sin(heading)
        places = people.places()
        reach_m = max(math.dist(eye, place) for place in places) + _LONGEST_M
        hiding = [
            other
            for name, (front, other) in self._outlines.items()
            if name != car.name and math.dist(eye, front) < reach_m
        ]
        return (
            (view, not is_hidden(eye, place, hiding))
            for view, place in zip(views, places, strict=True)
        )

    def _outline(self, name: str) -> tuple[Point, Rectangle]:
        """The front bumper of a vehicle, and its rectangle."""
        vehicles = self._session.vehicles
        front = vehicles.position(name)
        # SUMO's angles are clockwise from north.
        heading = math.radians(90.0 - vehicles.angle_deg(name))
        return front, outline(front, heading, vehicles.length_m(name), vehicles.width_m(name))
