"""A running SUMO simulation: its functions with types, in this process or in another one."""

import contextlib
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Protocol, TypeVar, get_type_hints

from harness.core.errors import EngineError, one_line
from harness.core.vocabulary import ROUNDING
from harness.engine.installation import program_path, run_program

Module = Literal["libsumo", "traci", "gui"]
"""Where SUMO runs: in this process, in another one, or in another one with a window."""

_VIEW = "View #0"
"""The name of sumo-gui's first view."""
_WALKER = "DEFAULT_PEDTYPE"
"""SUMO's own type of people."""
_DEPART_NOW = -3.0
"""SUMO's flag for a departure at once."""
_COMMANDED = 32
"""Speed mode: SUMO neither brakes for anybody nor limits accelerations."""
_PRIVILEGED = 23
"""SUMO keeps leaders, limits and red lights; the vehicle has the right of way among vehicles."""
_YIELDING = 31
"""SUMO's own driver's mode: it also yields where its connection has to."""
_NO_COMMAND = -1.0
"""The speed that gives a vehicle back to SUMO's driver."""

_NO_ANGLE = -1073741824.0
"""SUMO's INVALID_DOUBLE_VALUE: the angle follows from the movement."""
_KEEP_ROUTE = 2
"""The person may leave their route."""
_MATCH_THRESHOLD_M = 1.0
"""Distance within which SUMO searches for a lane."""


@dataclass(frozen=True, slots=True)
class Vehicles:
    """SUMO's functions for vehicles; most take a vehicle's id; each has SUMO's name for it."""

    ids: Annotated[Callable[[], Sequence[str]], "getIDList"]
    lane: Annotated[Callable[[str], str], "getLaneID"]
    lane_position_m: Annotated[Callable[[str], float], "getLanePosition"]
    odometer_m: Annotated[Callable[[str], float], "getDistance"]
    speed_mps: Annotated[Callable[[str], float], "getSpeed"]
    acceleration_mps2: Annotated[Callable[[str], float], "getAcceleration"]
    position: Annotated[Callable[[str], tuple[float, float]], "getPosition"]
    angle_deg: Annotated[Callable[[str], float], "getAngle"]
    speed_factor: Annotated[Callable[[str], float], "getSpeedFactor"]
    type: Annotated[Callable[[str], str], "getTypeID"]
    headway_s: Annotated[Callable[[str], float], "getTau"]
    set_speed: Annotated[Callable[[str, float], object], "setSpeed"]
    remove: Annotated[Callable[[str], object], "remove"]


@dataclass(frozen=True, slots=True)
class People:
    """SUMO's functions for people; most take a person's id; each has SUMO's name for it."""

    ids: Annotated[Callable[[], Sequence[str]], "getIDList"]
    next_edge: Annotated[Callable[[str], str], "getNextEdge"]
    position: Annotated[Callable[[str], tuple[float, float]], "getPosition"]
    speed_mps: Annotated[Callable[[str], float], "getSpeed"]
    walk: Annotated[Callable[[str, Sequence[str], float], object], "appendWalkingStage"]
    remove: Annotated[Callable[[str], object], "remove"]


_WRAPPED = "getLeader"
"""The function of libsumo whose wrapper in Python does more than to call it."""


class Collision(Protocol):
    """A collision that SUMO reports: who drove, whom they hit, and on which lane."""

    collider: str
    victim: str
    lane: str


class Leader(NamedTuple):
    """The vehicle ahead, and the gap to it without the follower's minGap."""

    name: str
    gap_m: float


class VehicleType(NamedTuple):
    """What the vehicles of a type are and can do."""

    length_m: float
    width_m: float
    acceleration_mps2: float
    deceleration_mps2: float
    max_speed_mps: float


def edge_of(lane: str) -> str:
    """The id of the edge of a lane, which is empty where a vehicle is on none.

    >>> edge_of("A0_B0_1"), edge_of("")
    ('A0_B0', '')
    """
    return lane.rpartition("_")[0]


def lane_of(edge: str, number: int = 0) -> str:
    """The id of a lane of an edge; lanes are counted from the right."""
    return f"{edge}_{number}"


def is_inside_junction(lane: str) -> bool:
    """Whether a lane or an edge is inside a junction."""
    return lane.startswith(":")


_Functions = TypeVar("_Functions", Vehicles, People)
_Ids = Callable[[], Sequence[str]]
_IdsOn = Callable[[str], Sequence[str]]


class Session:
    """A running simulation.

    Args:
        config: a SUMO configuration.
        options: further options of SUMO by name, which win; e.g. ``{"seed": "3"}``.
        module: where SUMO runs.

    Attributes:
        vehicles, people: their functions.
        departed, arrived, teleported, emergency_stops: ids of the vehicles that entered, arrived,
            began to teleport, or had to stop as in an emergency in the last step.
        collisions: those of the last step; one hit may last several steps.
        vehicles_on, people_on: ids of those on an edge at the last step.
        lane_length_m: the length of a lane.
        step_s: length of a step.
        time_s: the time at the end of the last step.
        move_person: puts a person who exists on a point of a crosswalk's axis, 0.05 m or more from
            its ends; SUMO ends the process if the person does not exist.
        lost, advance: SUMO's exceptions, and its function for a step.  Only the loop of an
            encounter in ``sumo_engine`` has them, where a context would cost time at every step;
            elsewhere ``watched`` turns the exceptions into ``EngineError``.

    Raises:
        EngineError: SUMO does not start, or another simulation runs in this process.
    """

    def __init__(
        self, config: Path, options: Mapping[str, str] | None = None, module: Module = "libsumo"
    ) -> None:
        command = ["-c", str(config)]
        command += [
            part for name, value in (options or {}).items() for part in (f"--{name}", value)
        ]
        self._api = api = _started(module, command)
        self.lost = (api.TraCIException, api.FatalTraCIError)
        self.advance = self._function("simulation", "step")
        self._now = self._function("simulation", "getTime")
        self.vehicles = self._functions("vehicle", Vehicles)
        self.people = self._functions("person", People)
        self.vehicles_on: _IdsOn = self._function("edge", "getLastStepVehicleIDs")
        self.people_on: _IdsOn = self._function("edge", "getLastStepPersonIDs")
        self.move_person = _mover(self._function("person", "moveToXY"))
        self.lane_length_m: Callable[[str], float] = self._function("lane", "getLength")
        self._leader = self._function("vehicle", "getLeader")
        self._best_lanes = self._function("vehicle", "getBestLanes")
        self._set_speed_mode = self._function("vehicle", "setSpeedMode")
        self._set_parameter = self._function("vehicle", "setParameter")
        self.departed: _Ids = self._function("simulation", "getDepartedIDList")
        self.arrived: _Ids = self._function("simulation", "getArrivedIDList")
        self.teleported: _Ids = self._function("simulation", "getStartingTeleportIDList")
        stopping = "getEmergencyStoppingVehiclesIDList"
        self.emergency_stops: _Ids = self._function("simulation", stopping)
        self.collisions: Callable[[], Sequence[Collision]]
        self.collisions = self._function("simulation", "getCollisions")
        self.time_s: float = api.simulation.getTime()
        self.step_s: float = api.simulation.getDeltaT()

    def _function(self, domain: str, name: str) -> Callable[..., Any]:
        found: Callable[..., Any] = getattr(getattr(self._api, domain), name)
        if name != _WRAPPED:
            # libsumo's own, if there is one: its wrapper in Python takes as long as the function.
            found = getattr(getattr(self._api, "_libsumo", None), f"{domain}_{name}", found)
        return found

    def _functions(self, domain: str, kind: type[_Functions]) -> _Functions:
        names = get_type_hints(kind, include_extras=True).items()
        return kind(**{each: self._function(domain, how.__metadata__[0]) for each, how in names})

    @contextlib.contextmanager
    def watched(self, what: str) -> Iterator[None]:
        """Turn SUMO's exceptions within this context into ``EngineError``; ``what`` SUMO did."""
        try:
            yield
        except self.lost as error:
            raise EngineError(f"SUMO {what}: {one_line(str(error))}") from None

    def step(self) -> float:
        """Simulate one step; return the time at its end in s.

        Raises:
            EngineError: SUMO lost the simulation.
        """
        with self.watched("lost the simulation"):
            self.advance()
        self.time_s = self._now()
        return self.time_s

    def goes_on(self, end_s: float | None) -> bool:
        """Whether there is a further step; None: as long as anybody is on the way.

        libsumo itself ignores the configuration's end.
        """
        if end_s is not None:
            return self.time_s < end_s - ROUNDING
        api = self._api
        expected = api.simulation.getMinExpectedNumber()
        if not expected or api.vehicle.getIDCount():
            return bool(expected)
        people = api.person.getIDList()
        if expected > len(people):
            return True
        # As in SUMO, people who wait for a ride do not keep the simulation going.
        return any(api.person.getStage(name).type != api.constants.STAGE_DRIVING for name in people)

    def ignore(self, vehicle: str, people: Sequence[str]) -> None:
        """Let a vehicle not mind these people, by their ids."""
        self._set_parameter(vehicle, "junctionModel.ignoreIDs", " ".join(people))

    def let_yield(self, vehicle: str, yields: bool) -> None:
        """Let SUMO keep a commanded vehicle's duty to yield; in any case it keeps leaders."""
        self._set_speed_mode(vehicle, _YIELDING if yields else _PRIVILEGED)

    def release(self, vehicle: str) -> None:
        """Give a commanded vehicle back to SUMO's driver, who minds everybody."""
        self.vehicles.set_speed(vehicle, _NO_COMMAND)
        self.let_yield(vehicle, True)
        self.ignore(vehicle, ())

    def leader(self, vehicle: str, sight_m: float) -> Leader | None:
        """The vehicle ahead within a distance; None if there is none."""
        found = self._leader(vehicle, sight_m)
        return Leader(*found) if found and found[0] else None

    def lanes_ahead(self, vehicle: str, lane: str) -> Sequence[str]:
        """The lanes that a vehicle will follow on its route, that on which it is first."""
        # A row has the lane, two lengths, the changes of lane to the best one, a flag and the way.
        rows = self._best_lanes(vehicle)
        index = next((i for i, row in enumerate(rows) if row[0] == lane), None)
        if index is None:
            return [lane]
        *_, changes, _, ahead = rows[index]
        if len(ahead) < 2 and changes:
            # It has to change lane before the junction.
            *_, ahead = rows[index + changes]
        return [lane, *ahead[1:]]

    def add_route(self, name: str, edges: Sequence[str]) -> None:
        """Add a route for vehicles."""
        self._api.route.add(name, edges)

    def limit_speed(self, road: Sequence[str], limit_mps: float) -> None:
        """Set the speed limit of a road's successive edges and of the lanes that connect them."""
        api = self._api
        counts = {edge: api.edge.getLaneNumber(edge) for edge in road}
        lanes = [lane_of(edge, number) for edge, count in counts.items() for number in range(count)]
        while lanes:
            lane = lanes.pop()
            api.lane.setMaxSpeed(lane, limit_mps)
            # Inside a junction several lanes may follow one after another.
            lanes += [inside for *_, inside, _, _, _ in api.lane.getLinks(lane) if inside]

    def add_commanded(
        self, name: str, route: str, type_id: str, lane: int, position_m: float, speed_mps: float
    ) -> None:
        """Add a vehicle whose speed is commanded alone; it exists after the next step."""
        self._api.vehicle.add(
            name,
            route,
            typeID=type_id,
            depart="now",
            departLane=str(lane),
            departPos=repr(position_m),
            departSpeed=repr(speed_mps),
        )
        self._set_speed_mode(name, _COMMANDED)
        self._api.vehicle.setLaneChangeMode(name, 0)

    def add_person(self, name: str, edge: str, position_m: float, type_id: str = _WALKER) -> None:
        """Add a person, who has to get a way (``people.walk``) before the next step.

        They exist, and may be moved, after the next step.
        """
        self._api.person.add(name, edge, position_m, depart=_DEPART_NOW, typeID=type_id)

    def built(self, vehicle: str) -> VehicleType:
        """What a vehicle is and can do, which may differ from its type's."""
        return _built(self._api.vehicle, vehicle)

    def vehicle_classes(self) -> Mapping[str, str]:
        """The class of every type of vehicles that SUMO has read so far, by the type's id."""
        types = self._api.vehicletype
        return {name: types.getVehicleClass(name) for name in types.getIDList()}

    def look(self, x_m: float, y_m: float, reach_m: float) -> None:
        """Show a square of the network in the window."""
        self._api.gui.setBoundary(_VIEW, x_m - reach_m, y_m - reach_m, x_m + reach_m, y_m + reach_m)

    def close(self) -> None:
        """End the simulation; only then are its output files complete."""
        # The user may have closed the window.
        with contextlib.suppress(self._api.FatalTraCIError):
            self._api.close()


def vehicle_types(config: Path) -> Mapping[str, VehicleType]:
    """Every type of vehicles of a configuration, by its id; SUMO reads all of them."""
    session = Session(config, {"route-steps": "0"})
    with contextlib.closing(session), session.watched("failed"):
        session.step()
        types = session._api.vehicletype
        return {name: _built(types, name) for name in types.getIDList()}


def _built(api: Any, name: str) -> VehicleType:
    """What a vehicle or a type is and can do."""
    asked = (api.getLength, api.getWidth, api.getAccel, api.getDecel, api.getMaxSpeed)
    return VehicleType(*(each(name) for each in asked))


def _mover(move: Callable[..., object]) -> Callable[[str, float, float], object]:
    """SUMO's function for a person's place, with its arguments that are always the same."""
    angle, route, reach_m = _NO_ANGLE, _KEEP_ROUTE, _MATCH_THRESHOLD_M
    return lambda name, x, y: move(name, "", x, y, angle, route, reach_m)


def interface(module: Module) -> Any:
    """SUMO's functions: libsumo, or TraCI's for a SUMO in another process."""
    return import_module("libsumo" if module == "libsumo" else "traci")


def _started(module: Module, command: Sequence[str]) -> Any:
    """The module that SUMO's functions are in, once SUMO runs."""
    api = interface(module)
    if module == "libsumo":
        # The module path may lead to another SUMO, e.g. that of SUMO_HOME/tools.
        version, wanted = api.getVersion()[1], f"SUMO {metadata.version('libsumo')}"
        if version != wanted:
            raise EngineError(f"{api.__file__} is {version}, not {wanted}: see PYTHONPATH")
        if api.isLoaded():
            raise EngineError("only one SUMO simulation can run in a process; close the first")
    try:
        # traci prints its retries on stdout, which is for results only.
        with contextlib.redirect_stdout(io.StringIO()):
            api.start([program_path("sumo-gui" if module == "gui" else "sumo"), *command])
    except (api.TraCIException, api.FatalTraCIError, OSError) as error:
        # A simulation that failed counts as loaded.
        with contextlib.suppress(api.TraCIException, api.FatalTraCIError):
            api.close()
        why = _first_error(command) or one_line(str(error))
        raise EngineError(f"SUMO did not start: {why}") from None
    return api


def _first_error(command: Sequence[str]) -> str | None:
    """The first error of SUMO with these options; libsumo only prints it."""
    try:
        run_program("sumo", [*command, "--begin", "0", "--end", "0"])
    except EngineError as error:
        return str(error)
    return None
