"""The people that each driver of a user's simulation sees: late, in part, with errors, or hidden.

Everything is in the network's coordinates, where a vehicle is a rectangle behind its front bumper.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from harness.core.encounter import PEDESTRIAN_RADIUS_M, PedestrianView
from harness.encounter.simulation.demand import number_of
from harness.encounter.simulation.driving import PassageLog
from harness.encounter.simulation.people import PeopleAtCrosswalk
from harness.engine.simulation.running import Function
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
        self._size_of: dict[str, tuple[float, float]] = {}
        self._fronts: dict[str, Point] = {}
        self._outlines: dict[str, Rectangle] = {}

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
        self._fronts.clear()
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
        if not self._fronts:
            # Vehicles that park beside a road are among them.
            self._fronts.update((name, self._front(name)) for name in self._vehicles())
        (west, east), (south, north) = (
            (min(values), max(values)) for values in zip(*points, strict=True)
        )
        for name, (x_m, y_m) in self._fronts.items():
            # No point of a vehicle is further from its front.
            reach_m = sum(self._size(name)) + PEDESTRIAN_RADIUS_M
            beside = not west - reach_m <= x_m <= east + reach_m
            if beside or not south - reach_m <= y_m <= north + reach_m or name == but:
                continue
            if name not in self._outlines:
                self._outlines[name] = outline(*self._pose(name), *self._size(name))
            yield self._outlines[name]

    def _size(self, name: str) -> tuple[float, float]:
        """Length and width of a vehicle, which it keeps."""
        size = self._size_of.get(name)
        if size is None:
            length_of, width_of = self._sizes
            size = self._size_of[name] = length_of(name), width_of(name)
        return size

    def _pose(self, name: str) -> tuple[Point, float]:
        """The front bumper of a vehicle and its direction, counterclockwise from the x axis."""
        x_m, y_m = self._front(name)
        # SUMO's angles are clockwise from north.
        return (x_m, y_m), math.radians(90.0 - self._angle_deg(name))
