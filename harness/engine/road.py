"""An hour of traffic in SUMO: speeds of vehicles and positions of pedestrians in, motion out.

docs/sumo.md explains the choices and has the measurements behind them.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from harness.core.encounter import Arrival, Crossing, Vehicle
from harness.core.errors import EngineError
from harness.engine.control import limit_speed
from harness.engine.people import HeldPeople
from harness.site import Site

SPEED_MODE_FOLLOWING = 33
"""SUMO keeps a safe gap to the leader only; it does not react to pedestrians."""


class SumoRoad:
    """Moves the vehicles of an hour, and sets pedestrians to given positions.

    Vehicles have text ids.  A vehicle that was added is on the road from the end of the next step.
    ``drive`` sets its speed at the end of each step until ``release``; SUMO lowers that speed where
    the leader is too near or the lane's limit is lower.

    Args:
        api: the module ``libsumo``, connected to a simulation.
        close: ends that simulation.
        site: the crosswalk.
        crossing: the crosswalk's constants.
        limit_mps: the speed limit of all lanes.
        step_s: length of a step.
        endings: endings of the names of SUMO's types (``Following.endings``).
    """

    def __init__(
        self,
        api: Any,
        close: Callable[[], None],
        site: Site,
        crossing: Crossing,
        limit_mps: float,
        step_s: float,
        endings: Sequence[str] = ("",),
    ) -> None:
        self._api, self._close, self._step_s = api, close, step_s
        self._types = [(f"vehicle{ending}", f"av{ending}") for ending in endings]
        self.closed = self.lost = False
        self.lanes = site.ways
        self._lost: tuple[type[Exception], ...] = (api.TraCIException, api.FatalTraCIError)
        self._people = HeldPeople(api, site, crossing)
        self._advance, self._arrived = api.simulationStep, api.simulation.getArrivedIDList
        self._steps, self._hours = 0, 0
        self._names: set[str] = set()
        # Called for every vehicle at every step, so these are SUMO's functions without a wrapper.
        self.drive: Callable[[str, float], None] = api.vehicle.setSpeed
        self.speed_of: Callable[[str], float] = api.vehicle.getSpeed
        self.distance_of: Callable[[str], float] = api.vehicle.getDistance
        self._routes: set[str] = set()
        edges = {stretch.edge for lane in self.lanes for stretch in lane.stretches}
        limit_speed(api, sorted(edges), limit_mps)

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Turn SUMO's errors within this context into ``EngineError``."""
        try:
            yield
        except self._lost as error:
            self.lost = True
            raise EngineError(f"SUMO failed during the hour: {error}") from None

    def begin(self, arrivals: Sequence[Arrival]) -> None:
        """Begin an hour with all pedestrians, by arrival time, with indices from 0."""
        self._hours += 1
        self._steps = 0
        self._people.begin(arrivals, self._hours)
        # A person exists only after a step, so they are announced a step before they arrive.
        self._people.before_step((), 2 * self._step_s)
        self._advance()
        self._people.after_step()

    def name_of(self, vehicle: int) -> str:
        """SUMO's id of a vehicle in this hour."""
        return f"vehicle-{self._hours}-{vehicle}"

    def add(
        self,
        name: str,
        lane: int,
        x_m: float,
        speed_mps: float,
        *,
        automated: bool = False,
        kind: int = 0,
    ) -> None:
        """Insert a vehicle of type number ``kind``.

        It has this position and speed at the end of the next step.
        """
        road = self.lanes[lane]
        first, last = road.stretches
        route = f"lane-{lane}"
        if route not in self._routes:
            self._api.route.add(route, [first.edge, last.edge])
            self._routes.add(route)
        self._api.vehicle.add(
            name,
            route,
            typeID=self._types[kind][automated],
            depart="now",
            departLane=str(first.lane),
            # SUMO counts a negative position, even a rounding error, from the lane's end.
            departPos=repr(max(0.0, x_m - first.start_m)),
            departSpeed=repr(speed_mps),
            arrivalLane=str(last.lane),
            arrivalPos=repr(road.ends_x_m - last.start_m),
        )
        self._api.vehicle.setSpeedMode(name, SPEED_MODE_FOLLOWING)
        self._api.vehicle.setLaneChangeMode(name, 0)
        self._names.add(name)

    def limit(self, name: str, vehicle: Vehicle) -> None:
        """Give a vehicle other limits of accelerating and braking than its type's."""
        api = self._api.vehicle
        api.setAccel(name, vehicle.resume_acceleration_mps2)
        api.setDecel(name, vehicle.max_deceleration_mps2)
        api.setEmergencyDecel(name, vehicle.max_deceleration_mps2)

    def step(self, places: Sequence[tuple[int, float]]) -> Sequence[str]:
        """Advance one step.

        Args:
            places: pedestrians' positions, as in ``Engine.step``.

        Returns:
            The ids of the vehicles that have left the road.
        """
        until_s = (self._steps + 3) * self._step_s
        announced = self._people.before_step(places, until_s)
        self._advance()
        self._steps += 1
        if announced:
            self._people.after_step()
        departed: Sequence[str] = self._arrived()
        if departed:
            self._names.difference_update(departed)
        return departed

    def release(self, name: str) -> None:
        """Let SUMO's car following drive a vehicle; it ignores pedestrians."""
        self._api.vehicle.setSpeedMode(name, SPEED_MODE_FOLLOWING)
        self.drive(name, -1.0)

    def collided(self) -> set[str]:
        """The vehicles for which SUMO detected a collision with a pedestrian in the last step."""
        if not self._people.ids:
            return set()
        return {collision.collider for collision in self._api.simulation.getCollisions()}

    def remove(self, index: int) -> None:
        """Remove a pedestrian who has reached the other kerb."""
        self._people.remove(index)

    def end(self) -> None:
        """Clear the road."""
        with self.watched():
            self._people.clear()
            for name in self._names:
                self._api.vehicle.remove(name)
            self._names.clear()
            self._advance()

    def close(self) -> None:
        """End the simulation."""
        self.closed = True
        self._close()
