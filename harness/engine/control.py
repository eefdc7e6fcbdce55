"""An encounter in SUMO: the ego's speed and the pedestrians' positions in, the ego's state out.

It uses the interface that libsumo and TraCI share.  docs/sumo.md explains the choices and has the
measurements behind them.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from harness.core.encounter import Arrival, Crossing, Vehicle
from harness.core.errors import EngineError
from harness.engine.people import HeldPeople
from harness.site import Site

SPEED_MODE_EXTERNAL = 32
"""SUMO neither brakes for pedestrians nor limits accelerations; only the strategy drives."""

COLLISION_REACH_M = 5.0
"""SUMO's collisions are read only when the ego's front is this near to the crosswalk.

SUMO reports a hit only while the front is on the junction, which begins a few metres upstream.
"""


def limit_speed(api: Any, road: Sequence[str], limit_mps: float) -> None:
    """Set the speed limit of a road's successive edges and of the lanes that connect them."""
    lanes = [f"{edge}_{index}" for edge in road for index in range(api.edge.getLaneNumber(edge))]
    while lanes:
        lane = lanes.pop()
        api.lane.setMaxSpeed(lane, limit_mps)
        # Inside a junction several lanes may follow one after another.
        lanes += [inside for *_, inside, _, _, _ in api.lane.getLinks(lane) if inside]


class Calls(NamedTuple):
    """The functions that are called at every step."""

    advance: Callable[[], object]
    move: Callable[..., object]
    set_speed: Callable[[str, float], object]
    get_distance: Callable[[str], float]


def calls_of(api: Any) -> Calls:
    """The public functions of libsumo or traci."""
    vehicle, person = api.vehicle, api.person
    return Calls(api.simulationStep, person.moveToXY, vehicle.setSpeed, vehicle.getDistance)


class SumoEngine:
    """Simulates episodes in SUMO, one after another in the same simulation.

    ``setSpeed`` sets the ego's speed under ballistic steps, so SUMO's state follows constant
    accelerations in closed form.  ``moveToXY`` sets the positions of all pedestrians at every step,
    because SUMO's own pedestrians would stop for the vehicle and hide crashes.

    Args:
        api: the module ``libsumo`` or ``traci``, connected to a simulation that was
            started with ``start_command``.
        close: ends that simulation.
        site: the crosswalk.
        vehicle: the ego.
        crossing: the crosswalk's constants.
        step_s: length of a step, whole milliseconds.
        calls: the functions that are called at every step; None: the functions of ``api``.

    Attributes:
        automated: whether SUMO's files and window name the ego an AV; set between episodes.
    """

    def __init__(
        self,
        api: Any,
        close: Callable[[], None],
        site: Site,
        vehicle: Vehicle,
        crossing: Crossing,
        step_s: float,
        calls: Calls | None = None,
    ) -> None:
        self._api, self._close = api, close
        self.closed = self.automated = False
        self._lost: tuple[type[Exception], ...] = (api.TraCIException, api.FatalTraCIError)
        calls = calls or calls_of(api)
        self._advance = calls.advance
        self._set_speed, self._get_distance = calls.set_speed, calls.get_distance
        self._get_speed = api.vehicle.getSpeed
        self._vehicle, self._step_s = vehicle, step_s
        departure = site.ego.departure(vehicle.trigger_range_m)
        self._depart_position = repr(departure.position_m)
        self._lane_index = str(departure.lane)
        self._start_x_m = -vehicle.trigger_range_m
        self._collisions_from_m = -crossing.width_m / 2 - COLLISION_REACH_M
        self._episode = 0
        self._ego = ""
        self._set_mps: float | None = None
        """The speed that was last set."""
        self.people = HeldPeople(api, site, crossing, move=calls.move)
        api.route.add("drive", departure.edges)
        if crossing.speed_limit_mps is not None:
            limit_speed(api, departure.edges, crossing.speed_limit_mps)

    def begin(self, arrivals: Sequence[Arrival]) -> tuple[float, float]:
        """See ``Engine.begin``."""
        self._steps = 0
        self._collided = False
        self._set_mps = None
        self._ego = f"ego-{self._episode}"
        people = self.people
        people.begin(arrivals, self._episode)
        with self._watched("could not set up the episode"):
            # Persons exist only after a step, so they are inserted a step before the ego.
            people.before_step((), 2 * self._step_s)
            self._advance()
            people.after_step()
            self._insert_ego()
            people.before_step((), -math.inf)
            self._advance()
            self._commanded = self._get_speed(self._ego)
            return self._start_x_m + self._get_distance(self._ego), self._commanded

    def step(self, speed_mps: float, pedestrians: Sequence[tuple[int, float]]) -> float:
        """See ``Engine.step``."""
        people = self.people
        try:
            if speed_mps != self._set_mps:  # SUMO keeps the speed that was last set
                self._set_speed(self._ego, speed_mps)
                self._set_mps = speed_mps
            announced = people.before_step(pedestrians, (self._steps + 3) * self._step_s)
            self._advance()
            self._steps += 1
            if announced:
                people.after_step()
            x = self._start_x_m + self._get_distance(self._ego)
            if x > self._collisions_from_m and people.ids:
                self._note_collisions()
            # A set speed is not read back at every step; ``end`` checks that SUMO kept it.
            self._commanded = speed_mps
            return x
        except self._lost as error:
            raise EngineError(f"SUMO failed during the episode: {error}") from None

    def remove(self, index: int) -> None:
        """See ``Engine.remove``."""
        with self._watched(f"could not find pedestrian {index}"):
            self.people.remove(index)

    def end(self) -> bool | None:
        """See ``Engine.end``."""
        self._episode += 1
        with self._watched("could not clear the road"):
            self.people.clear()
            if self._ego in self._api.vehicle.getIDList():
                kept = self._get_speed(self._ego) == self._commanded
                self._api.vehicle.remove(self._ego)
                if not kept:
                    raise EngineError("SUMO did not keep the speed that was set")
        return self._collided

    def close(self) -> None:
        """End the simulation, which also completes SUMO's output files."""
        self.closed = True
        self._close()

    @contextmanager
    def _watched(self, what: str) -> Iterator[None]:
        """Turn SUMO's errors within this context into ``EngineError``."""
        try:
            yield
        except self._lost as error:
            raise EngineError(f"SUMO {what}: {error}") from None

    def _insert_ego(self) -> None:
        self._api.vehicle.add(
            self._ego,
            "drive",
            typeID="av" if self.automated else "ego",
            depart="now",
            departLane=self._lane_index,
            departPos=self._depart_position,
            departSpeed=repr(self._vehicle.initial_speed_mps),
        )
        self._api.vehicle.setSpeedMode(self._ego, SPEED_MODE_EXTERNAL)
        self._api.vehicle.setLaneChangeMode(self._ego, 0)

    def _note_collisions(self) -> None:
        # SUMO also lists two persons who pass each other; only collisions of the ego count.
        for collision in self._api.simulation.getCollisions():
            if collision.collider == self._ego:
                self._collided = True
