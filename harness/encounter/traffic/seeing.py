"""The pedestrians that each driver of an hour sees: late, in part, with errors, or hidden."""

from collections.abc import Iterable, Mapping, Sequence

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Arm, Crossing, PedestrianView
from harness.encounter.crowd import VIEW
from harness.encounter.traffic.lanes import Lane
from harness.encounter.traffic.vehicles import HourVehicle
from harness.encounter.walkers import Walker
from harness.engine.road import SumoRoad
from harness.strategies.perception.occlusion import Point, Rectangle, is_hidden, outline
from harness.strategies.perception.sensor import (
    EYE_BEHIND_BUMPER_M,
    ROUNDING_M,
    Sensor,
    eye_behind,
)
from harness.strategies.perception.track import track_from
from harness.strategies.perception.updates import Updates, Views


class HourSight:
    """What the drivers of an hour see, in the ego's road frame.

    Each vehicle has a sensor state and random streams of its own, from R0 on.

    Args:
        sensors: the sensor of each driver; None for drivers who see the ground truth.
        pair: index of the pair, which keys the streams.
        road: SUMO.
        on_road: all vehicles on the road, by name; it changes while the hour runs.
    """

    def __init__(
        self,
        sensors: Mapping[Arm, Sensor | None],
        pair: int,
        road: SumoRoad,
        on_road: Mapping[str, HourVehicle],
    ) -> None:
        self._sensors, self._pair = sensors, pair
        self._road, self._on_road = road, on_road
        self._places: list[Point] = []
        self._range_m = max((_reach_m(sensor) for sensor in sensors.values() if sensor), default=0)
        self._outlines: dict[str, Rectangle] = {}

    def take_over(self, car: HourVehicle) -> None:
        """Begin the updates of a vehicle's sensor when its strategy takes over."""
        sensor = self._sensors[_driver(car)]
        if sensor is None:
            return
        number, pair = car.plan.number, self._pair
        car.shown = []
        car.updates = Updates(sensor, lambda index: track_from(sensor, pair, (number,), index))

    def begin_step(self, walkers: Sequence[Walker], crossing: Crossing) -> None:
        """Note where everybody is; where the vehicles are is read when a driver looks."""
        self._outlines.clear()
        self._places = [
            (walker.x_m, crossing.place_of(view.side, view.remaining_m))
            for walker, view in zip(walkers, map(VIEW, walkers), strict=True)
        ]

    def shown(self, car: HourVehicle, step: int, views: Sequence[PedestrianView]) -> Views:
        """The pedestrians that a vehicle's driver sees.

        Args:
            car: a vehicle whose driver has a sensor.
            step: number of steps since its strategy took over.
            views: everybody at the crosswalk from the vehicle's lane, in the order of the walkers.
        """
        assert car.updates is not None
        assert car.shown is not None
        shown = car.updates.shown(step, lambda: zip(views, self._in_sight(car), strict=True))
        car.shown.append(shown)
        return shown

    def _in_sight(self, car: HourVehicle) -> Iterable[bool]:
        """Whether a vehicle's driver could see each pedestrian."""
        sensor, places = self._sensors[_driver(car)], self._places
        assert sensor is not None
        if abs(car.x_m) > sensor.detection_range_m + ROUNDING_M:
            return [False] * len(places)
        if not places:
            return []
        eye = _place(car.plan.lane, car.x_m - eye_behind(car.vehicle.length_m))
        hiding = [*sensor.obstacles]
        if sensor.vehicles_hide:
            along_m = [eye[0], *(x_m for x_m, _ in places)]
            low_m, high_m = min(along_m) - PEDESTRIAN_RADIUS_M, max(along_m) + PEDESTRIAN_RADIUS_M
            hiding += [
                each
                for name, each in (self._outlines or self._read()).items()
                if each.x_high_m >= low_m and each.x_low_m <= high_m and name != car.name
            ]
        return [not is_hidden(eye, place, hiding) for place in places]

    def _read(self) -> dict[str, Rectangle]:
        """The outlines of the vehicles that may hide somebody, also of those that have passed.

        The vehicles of a lane are in the order in which they came: behind one that is too far
        upstream, all are.
        """
        distance_of, beyond = self._road.distance_of, set[Lane]()
        for name, car in self._on_road.items():
            lane, vehicle = car.plan.lane, car.vehicle
            if lane in beyond:
                continue
            driven = car.first_step is not None and not car.passed
            x_m = car.x_m if driven else car.insert_x_m + distance_of(name)
            if x_m < -self._range_m:
                beyond.add(lane)
                continue
            ends = _place(lane, x_m), _place(lane, x_m - vehicle.length_m)
            self._outlines[name] = outline(max(ends), 0.0, vehicle.length_m, vehicle.width_m)
        return self._outlines


def _reach_m(sensor: Sensor) -> float:
    """A distance before the crosswalk that is beyond everybody's eye and every person."""
    return sensor.detection_range_m + EYE_BEHIND_BUMPER_M + sensor.crossing.width_m


def _driver(car: HourVehicle) -> Arm:
    return Arm.AV if car.automated else Arm.HUMAN


def _place(lane: Lane, x_m: float) -> Point:
    """A point on a lane's centre, from x in the frame of its own direction."""
    return lane.direction.sign * x_m, lane.centre_m
