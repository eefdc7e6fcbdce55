"""The people that each driver of a user's simulation sees: late, in part, with errors, or hidden.

Everything is in the network's coordinates, where a vehicle is a rectangle behind its front bumper.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from harness.core.encounter import PEDESTRIAN_RADIUS_M, PedestrianView
from harness.engine.simulation.running import Function
from harness.episode.simulation.demand import number_of
from harness.episode.simulation.driving import PassageLog
from harness.episode.simulation.people import PeopleAtCrosswalk
from harness.strategies.perception.occlusion import Point, Rectangle, is_hidden, outline
from harness.strategies.perception.sensor import Sensor, eye_behind
from harness.strategies.perception.track import Track, track_from
from harness.strategies.perception.updates import Updates, Views


class SimulationSight:
    """What the drivers of an arm see.

    Each passage has a sensor state and random streams of its own, keyed by the ids of vehicle,
    crosswalk and person.

    Args:
        sensor_of: the sensor of an AV's driver (True), or another's; None: the ground truth.
        pair: index of the pair, which keys the streams.
        function: SUMO's function of a part and a name (``OwnSimulation.function``).
        people: everybody at each crosswalk.
    """

    def __init__(
        self,
        sensor_of: Callable[[bool], Sensor | None],
        pair: int,
        function: Function,
        people: Mapping[str, PeopleAtCrosswalk],
    ) -> None:
        self._sensor_of, self._pair, self._people = sensor_of, pair, people
        self._vehicles = function("vehicle", "getIDList")
        self._front = function("vehicle", "getPosition")
        self._angle_deg = function("vehicle", "getAngle")
        self._sizes = function("vehicle", "getLength"), function("vehicle", "getWidth")
        self._outlines: dict[str, tuple[Point, float, Rectangle]] = {}

    def begin(self, passage: PassageLog) -> None:
        """Begin the updates of a vehicle's sensor when its strategy takes over."""
        sensor = self._sensor_of(passage.automated)
        if sensor is None:
            return
        crosswalk = passage.driven_way.way.crosswalk
        people, pair = self._people[crosswalk], self._pair
        keys = number_of(passage.name), number_of(crosswalk)

        def new_track(index: int) -> Track:
            return track_from(sensor, pair, keys, number_of(people.id_of[index]))

        passage.sensor, passage.shown = sensor, []
        passage.updates = Updates(sensor, new_track)

    def begin_step(self) -> None:
        """Forget where the vehicles were; it is read when a driver looks."""
        self._outlines.clear()

    def shown(self, passage: PassageLog, *, near: bool) -> Views:
        """The people that a vehicle's driver sees.

        Args:
            passage: a passage whose driver has a sensor.
            near: whether the vehicle is within its detection range of the crosswalk.
        """
        assert passage.updates is not None
        assert passage.shown is not None
        step = len(passage.shown)
        shown = passage.updates.shown(step, lambda: self._look(passage, near=near))
        passage.shown.append(shown)
        return shown

    def _look(self, passage: PassageLog, *, near: bool) -> Iterable[tuple[PedestrianView, bool]]:
        assert passage.sensor is not None
        way = passage.driven_way.way
        people = self._people[way.crosswalk]
        views = people.views(way)
        if not near or not passage.sensor.vehicles_hide:
            return ((view, near) for view in views)
        if not views:
            return ()
        eye = self._eye(passage)
        places = [(person.x_m[-1], person.y_m[-1]) for person in people.present.values()]
        hiding = [*self._outlines_among([eye, *places], passage.name)]
        return (
            (view, not is_hidden(eye, place, hiding))
            for view, place in zip(views, places, strict=True)
        )

    def _eye(self, passage: PassageLog) -> Point:
        (x_m, y_m), heading_rad = self._pose(passage.name)
        back_m = eye_behind(passage.vehicle.length_m)
        return x_m - back_m * math.cos(heading_rad), y_m - back_m * math.sin(heading_rad)

    def _outlines_among(self, points: Sequence[Point], but: str) -> Iterator[Rectangle]:
        """The outlines of the other vehicles that may reach between some points."""
        if not self._outlines:
            self._read()
        (west, east), (south, north) = (
            (min(values), max(values)) for values in zip(*points, strict=True)
        )
        for name, ((x_m, y_m), reach_m, rectangle) in self._outlines.items():
            beside = not west - reach_m <= x_m <= east + reach_m
            if beside or not south - reach_m <= y_m <= north + reach_m or name == but:
                continue
            yield rectangle

    def _read(self) -> None:
        """Read the outlines of all vehicles, also of those that park beside a road."""
        length_of, width_of = self._sizes
        for name in self._vehicles():
            pose, length_m, width_m = self._pose(name), length_of(name), width_of(name)
            # No point of a vehicle is further from its front.
            reach_m = length_m + width_m + PEDESTRIAN_RADIUS_M
            self._outlines[name] = pose[0], reach_m, outline(*pose, length_m, width_m)

    def _pose(self, name: str) -> tuple[Point, float]:
        """The front bumper of a vehicle and its direction, counterclockwise from the x axis."""
        x_m, y_m = self._front(name)
        # SUMO's angles are clockwise from north.
        return (x_m, y_m), math.radians(90.0 - self._angle_deg(name))
