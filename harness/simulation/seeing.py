"""The people that drivers with a sensor see: late, in part, with errors, or hidden by vehicles.

Everything is in the network's coordinates, where a vehicle is a rectangle behind its front bumper.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Arm, PedestrianView
from harness.engine.session import Session
from harness.scenario import Scenario
from harness.simulation.cars import Passage
from harness.simulation.people import PeopleAt
from harness.simulation.shares import number_of
from harness.strategies.perception.occlusion import Point, Rectangle, is_hidden, outline
from harness.strategies.perception.sensor import eye_behind, sensor_of
from harness.strategies.perception.track import track_from
from harness.strategies.perception.updates import Updates, Views


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
        self._pair, self._people = pair, people
        self._session, self._vehicles = session, session.vehicles
        self._read_s = -math.inf
        self._fronts: dict[str, Point] = {}

    def begin(self, passage: Passage, driver: Arm) -> None:
        """Begin the updates of a vehicle's sensor when its strategy takes over."""
        sensor = self._sensors[driver]
        if sensor is None:
            return
        crosswalk = passage.crosswalk.id
        people, keys = self._people[crosswalk], (number_of(passage.car.name), number_of(crosswalk))
        passage.shown = []
        passage.updates = Updates(
            sensor,
            lambda index: track_from(sensor, self._pair, keys, number_of(people.id_of(index))),
        )
        passage.hides = sensor.vehicles_hide

    def shown(self, passage: Passage, near: bool) -> Views:
        """The people that a vehicle's driver sees; ``near``: within its detection range."""
        assert passage.updates is not None
        assert passage.shown is not None
        step = len(passage.shown)
        shown = passage.updates.shown(step, lambda: self._look(passage, near))
        passage.shown.append(shown)
        return shown

    def _look(self, passage: Passage, near: bool) -> Iterable[tuple[PedestrianView, bool]]:
        people = self._people[passage.crosswalk.id]
        views = people.views(passage.zone)
        if not near or not passage.hides or not views:
            return ((view, near) for view in views)
        (x_m, y_m), heading = self._pose(passage.car.name)
        back_m = eye_behind(passage.car.vehicle.length_m)
        eye = x_m - back_m * math.cos(heading), y_m - back_m * math.sin(heading)
        places = people.places()
        hiding = [*self._outlines_among([eye, *places], passage.car.name)]
        return (
            (view, not is_hidden(eye, place, hiding))
            for view, place in zip(views, places, strict=True)
        )

    def _outlines_among(self, points: Sequence[Point], but: str) -> Iterator[Rectangle]:
        """The outlines of the other vehicles that may reach between some points."""
        if self._read_s != self._session.time_s:
            # Vehicles that park beside a road are among them.
            self._read_s = self._session.time_s
            vehicles = self._vehicles
            self._fronts = {name: vehicles.position(name) for name in vehicles.ids()}
        (west, east), (south, north) = (
            (min(values), max(values)) for values in zip(*points, strict=True)
        )
        for name, (x_m, y_m) in self._fronts.items():
            size = self._vehicles.length_m(name), self._vehicles.width_m(name)
            # No point of a vehicle is further from its front.
            reach_m = sum(size) + PEDESTRIAN_RADIUS_M
            within = west - reach_m <= x_m <= east + reach_m
            if within and south - reach_m <= y_m <= north + reach_m and name != but:
                yield outline(*self._pose(name), *size)

    def _pose(self, name: str) -> tuple[Point, float]:
        """The front bumper of a vehicle and its direction, counterclockwise from the x axis."""
        # SUMO's angles are clockwise from north.
        heading = math.radians(90.0 - self._vehicles.angle_deg(name))
        return self._vehicles.position(name), heading
