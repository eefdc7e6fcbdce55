"""A running SUMO simulation: its functions with types, in this process or in another one."""

import contextlib
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module, metadata
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal, TypeVar, get_type_hints

from harness.core.errors import EngineError
from harness.core.vocabulary import ROUNDING
from harness.engine.ids import lane_of
from harness.engine.installation import program_path, run_program
from harness.engine.plain import followed_m
from harness.engine.protocol import LastStep, People, Vehicles, VehicleType

Runs = Literal["here", "apart", "window"]
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
_SIGHT_M = 9.0
"""Leaders are looked for this much farther: SUMO's search counts the follower's minGap as way."""

_Functions = TypeVar("_Functions", Vehicles, People, LastStep)


class Session:
    """A running simulation; see ``Running``.

    Args:
        config: a SUMO configuration.
        options: further options of SUMO by name, which win; e.g. ``{"seed": "3"}``.
        runs: where SUMO runs.

    Attributes:
        lost, advance: SUMO's exceptions, and its function for a step.  ``watched`` turns the
            exceptions into ``EngineError``, but not at every step, where a context would cost time.

    Raises:
        EngineError: SUMO does not start, or another simulation runs in this process.
    """

    def __init__(
        self, config: Path, options: Mapping[str, str] | None = None, runs: Runs = "here"
    ) -> None:
        command = ["-c", str(config)]
        command += [
            part for name, value in (options or {}).items() for part in (f"--{name}", value)
        ]
        self._api = api = _started(runs, command)
        self.lost = (api.TraCIException, api.FatalTraCIError)
        self.advance = self._function("simulation.step")
        self._now = self._function("simulation.getTime")
        self.vehicles, self.people = self._functions(Vehicles), self._functions(People)
        self.last = self._functions(LastStep)
        self.move_person = _mover(self._function("person.moveToXY"))
        self.time_s: float = api.simulation.getTime()
        self.step_s: float = api.simulation.getDeltaT()

    def _function(self, name: str) -> Callable[..., Any]:
        # libsumo's own, if there is one: its wrapper in Python takes as long as the function.
        wrapped, own = attrgetter(name)(self._api), getattr(self._api, "_libsumo", None)
        found: Callable[..., Any] = getattr(own, name.replace(".", "_"), wrapped)
        return found

    def _functions(self, kind: type[_Functions]) -> _Functions:
        names = get_type_hints(kind, include_extras=True).items()
        return kind(**{each: self._function(how.__metadata__[0]) for each, how in names})

    @contextlib.contextmanager
    def watched(self, what: str) -> Iterator[None]:
        """Turn SUMO's exceptions within this context into ``EngineError``; ``what`` SUMO did."""
        try:
            yield
        except self.lost as error:
            raise EngineError(f"SUMO {what}: {error}") from None

    def step(self) -> float:
        """See ``Running.step``."""
        try:
            self.advance()
        except self.lost as error:
            raise EngineError(f"SUMO lost the simulation: {error}") from None
        self.time_s = self._now()
        return self.time_s

    def goes_on(self, end_s: float | None) -> bool:
        """See ``Running.goes_on``; libsumo itself ignores the configuration's end."""
        if end_s is not None:
            return self.time_s < end_s - ROUNDING
        api = self._api
        expected = api.simulation.getMinExpectedNumber()
        if not expected or api.vehicle.getIDCount():
            return bool(expected)
        people = api.person.getIDList()
        # As in SUMO, people who wait for a ride do not keep the simulation going.
        stages = (api.person.getStage(name).type for name in people)
        return expected > len(people) or any(at != api.constants.STAGE_DRIVING for at in stages)

    def ignore(self, vehicle: str, people: Sequence[str]) -> None:
        """See ``Running.ignore``."""
        self._api.vehicle.setParameter(vehicle, "junctionModel.ignoreIDs", " ".join(people))

    def let_yield(self, vehicle: str, yields: bool) -> None:
        """See ``Running.let_yield``."""
        self._api.vehicle.setSpeedMode(vehicle, _YIELDING if yields else _PRIVILEGED)

    def release(self, vehicle: str) -> None:
        """See ``Running.release``."""
        self.vehicles.set_speed(vehicle, _NO_COMMAND)
        self.let_yield(vehicle, True)
        self.ignore(vehicle, ())

    def follows(self, vehicle: str, speed_mps: float, deceleration_mps2: float) -> bool:
        """See ``Running.follows``."""
        how = speed_mps, deceleration_mps2, self._api.vehicle.getTau(vehicle), self.step_s
        sight_m = followed_m(0.0, *how) + _SIGHT_M
        name, gap_m = self._api.vehicle.getLeader(vehicle, sight_m) or ("", 0.0)
        return bool(name and gap_m <= followed_m(self.vehicles.speed_mps(name), *how))

    def lanes_ahead(self, vehicle: str, lane: str) -> Sequence[str]:
        """See ``Running.lanes_ahead``."""
        # A row has the lane, two lengths, the changes of lane to the best one, a flag and the way.
        rows = self._api.vehicle.getBestLanes(vehicle)
        index = next((i for i, row in enumerate(rows) if row[0] == lane), None)
        if index is None:
            return [lane]
        *_, changes, _, ahead = rows[index]
        if len(ahead) < 2 and changes:
            *_, ahead = rows[index + changes]
        return ahead or [lane]

    def add_route(self, name: str, edges: Sequence[str]) -> None:
        """Add a route for vehicles."""
        self._api.route.add(name, edges)

    def lane_length_m(self, lane: str) -> float:
        """The length of a lane."""
        return float(self._api.lane.getLength(lane))

    def limit_speed(self, road: Sequence[str], limit_mps: float) -> None:
        """Set the speed limit of a road's successive edges and of the lanes that connect them."""
        counts = {edge: self._api.edge.getLaneNumber(edge) for edge in road}
        lanes = [lane_of(edge, number) for edge, count in counts.items() for number in range(count)]
        while lanes:
            lane = lanes.pop()
            self._api.lane.setMaxSpeed(lane, limit_mps)
            # Inside a junction several lanes may follow one after another.
            lanes += [inside for *_, inside, _, _, _ in self._api.lane.getLinks(lane) if inside]

    def add_commanded(
        self, name: str, route: str, type_id: str, lane: int, position_m: float, speed_mps: float
    ) -> None:
        """Add a vehicle whose speed is commanded alone; it exists after the next step."""
        begin = {"departLane": str(lane), "departPos": repr(position_m)}
        begin |= {"depart": "now", "departSpeed": repr(speed_mps)}
        self._api.vehicle.add(name, route, typeID=type_id, **begin)
        self._api.vehicle.setSpeedMode(name, _COMMANDED)
        self._api.vehicle.setLaneChangeMode(name, 0)

    def add_person(self, name: str, edge: str, position_m: float, type_id: str = _WALKER) -> None:
        """See ``Running.add_person``."""
        self._api.person.add(name, edge, position_m, depart=_DEPART_NOW, typeID=type_id)

    def built(self, vehicle: str) -> VehicleType:
        """See ``Running.built``."""
        return _built(self._api.vehicle, vehicle)

    def vehicle_classes(self) -> Mapping[str, str]:
        """See ``Running.vehicle_classes``."""
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
    return lambda name, x, y: move(name, "", x, y, _NO_ANGLE, _KEEP_ROUTE, _MATCH_THRESHOLD_M)


def interface(runs: Runs = "here") -> Any:
    """SUMO's functions: libsumo, or TraCI's for a SUMO in another process."""
    return import_module("libsumo" if runs == "here" else "traci")


def _started(runs: Runs, command: Sequence[str]) -> Any:
    """The module that SUMO's functions are in, once SUMO runs."""
    api = interface(runs)
    if runs == "here":
        # The module path may lead to another SUMO, e.g. that of SUMO_HOME/tools.
        version, wanted = api.getVersion()[1], f"SUMO {metadata.version('libsumo')}"
        if version != wanted:
            raise EngineError(f"{api.__file__} is {version}, not {wanted}: see PYTHONPATH")
        if api.isLoaded():
            raise EngineError("only one SUMO simulation can run in a process; close the first")
    try:
        # traci prints its retries on stdout, which is for results only.
        with contextlib.redirect_stdout(io.StringIO()):
            api.start([program_path("sumo-gui" if runs == "window" else "sumo"), *command])
    except (api.TraCIException, api.FatalTraCIError, OSError) as error:
        # A simulation that failed counts as loaded.
        with contextlib.suppress(api.TraCIException, api.FatalTraCIError):
            api.close()
        why = _first_error(command) or str(error)
        raise EngineError(f"SUMO did not start: {why}") from None
    return api


def _first_error(command: Sequence[str]) -> str | None:
    """The first error of SUMO with these options; libsumo only prints it."""
    try:
        run_program("sumo", [*command, "--begin", "0", "--end", "0"])
    except EngineError as error:
        return str(error)
    return None
