"""One arm of a pair in a user's simulation: SUMO step by step, its log out."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from harness.core.encounter import PedestrianView, Strategy, Vehicle
from harness.core.errors import EngineError
from harness.encounter.deciding import ROUNDING_M
from harness.encounter.simulation.driving import Control, PassageLog
from harness.encounter.simulation.lane_changes import LaneChanges
from harness.encounter.simulation.log import SimulationLog, VehicleKind
from harness.encounter.simulation.looking import Lookout, WatchedLane
from harness.encounter.simulation.people import PeopleAtCrosswalk
from harness.encounter.simulation.seeing import SimulationSight
from harness.encounter.simulation.standing import NEAR_M, SAMPLE_S, Standing
from harness.encounter.simulation.visits import (
    BENDS,
    INSIDE,
    TURNS,
    Visit,
    free_speed,
    left_way,
    visit_of,
    why_not,
)
from harness.engine.simulation.running import Function, OwnSimulation
from harness.site.simulation import DrivenWay, Setting

VANISHED = "vanished"
TELEPORTED = "teleported"

_WITH_PEOPLE = ("crossing", "walkingarea", "sharedLane")
"""Types of SUMO's collisions of a vehicle with a person."""

MakeDriver = Callable[[str, bool], tuple[str, Strategy | None]]
"""From a vehicle's id and whether it is an AV to its driver's name and strategy (None: SUMO)."""

See = Callable[[Function, Mapping[str, PeopleAtCrosswalk]], SimulationSight | None]
"""From SUMO's functions and the people at each crosswalk to what drivers see of them."""


class SimulationArm:
    """One arm of a pair.

    Args:
        simulation: SUMO, running the user's scenario.
        setting: its crosswalks.
        counted: begin and end of the counted time, in s.
        detection_m: distance within which vehicles see people.
        resume_mps2: a0 of every strategy.
        is_automated: whether a vehicle with this id, type and class is an AV.
        make: makes the driver of a vehicle that a strategy may drive.
        late: how late a vehicle obeys; with the vehicle and whether it is an AV.
        see: what drivers see of the people at each crosswalk; None: the ground truth.
    """

    def __init__(
        self,
        simulation: OwnSimulation,
        setting: Setting,
        counted: tuple[float, float],
        detection_m: float,
        resume_mps2: float,
        is_automated: Callable[[str, str, str], bool],
        make: MakeDriver,
        late: Callable[[Vehicle, bool], Vehicle] = lambda vehicle, _automated: vehicle,
        see: See = lambda _function, _people: None,
    ) -> None:
        self.simulation, self.setting, self.counted = simulation, setting, counted
        self.detection_m, self.resume_mps2 = detection_m, resume_mps2
        self.is_automated, self.make, self.late = is_automated, make, late
        self.api: Any = simulation.api
        self.log = SimulationLog()
        function = simulation.function
        self.lookout = Lookout(
            setting,
            simulation.step_s,
            function("lane", "getLastStepVehicleIDs"),
            function("vehicle", "getLanePosition"),
            self.api.edge.getLaneNumber,
            self._judged,
        )
        self._distance_of = function("vehicle", "getDistance")
        self._speed_of = function("vehicle", "getSpeed")
        self._departed = function("simulation", "getDepartedIDList")
        self._gone = function("simulation", "getArrivedIDList")
        self._teleported = function("simulation", "getStartingTeleportIDList")
        self._collisions = function("simulation", "getCollisions")
        self._lane_changes = LaneChanges(setting, function)
        self.judged: dict[str, dict[str, int]] = {}
        self.active: dict[tuple[str, str], PassageLog] = {}
        set_speed = function("vehicle", "setSpeed")
        self.control = Control(self.api, set_speed, simulation.step_s, detection_m, self._views)
        self.people = {
            crosswalk.id: PeopleAtCrosswalk(function, crosswalk, self._person_came)
            for crosswalk in setting.crosswalks
        }
        self.sight = see(function, self.people)
        self._persons_on: Callable[[str], Sequence[str]] = function("edge", "getLastStepPersonIDs")
        self._walked_edges = sorted(set().union(*(each.edges for each in self.people.values())))
        self.hits: set[tuple[str, str]] = set()
        self.standing = Standing(self.api, setting, self.log)

    def run(self) -> SimulationLog:
        """Simulate until the end.

        Raises:
            EngineError: SUMO's simulation broke off, or would never end.
            StrategyError: a strategy failed.
        """
        simulation, log = self.simulation, self.log
        sample_steps = max(1, round(SAMPLE_S / simulation.step_s))
        steps = 0
        try:
            while simulation.goes_on:
                if self.sight is not None:
                    self.sight.begin_step()
                self.control.command(simulation.time_s)
                time_s = simulation.step()
                steps += 1
                self._count()
                self._note_people(time_s)
                self._follow(time_s)
                self.lookout.look(time_s)
                if steps % sample_steps == 0:
                    if self.counted[0] < time_s <= self.counted[1]:
                        self.standing.sample(self.active.values(), self.people)
                    self.standing.check(time_s)
        except (self.api.TraCIException, self.api.FatalTraCIError) as error:
            raise EngineError(f"SUMO lost the simulation: {error}") from None
        for passage in self.active.values():
            passage.ended = "the simulation ended"
            self._leave_out(passage)
        log.end_s = simulation.time_s
        log.people = {name: people.tracks() for name, people in self.people.items()}
        if self.sight is not None:
            log.numbers = {name: people.numbers() for name, people in self.people.items()}
        log.passages.sort(key=lambda each: (each.time_s[0], each.name))
        return log

    def _views(self, passage: PassageLog, near: bool) -> Sequence[PedestrianView]:
        if passage.updates is not None and self.sight is not None:
            return self.sight.shown(passage, near=near)
        way = passage.driven_way.way
        return self.people[way.crosswalk].views(way) if near else ()

    def _note_people(self, time_s: float) -> None:
        """Note where everybody at the crosswalks is; each walking area is read once."""
        edges = self._walked_edges
        on_edges = zip(edges, map(self._persons_on, edges), strict=True)
        there = {edge: names for edge, names in on_edges if names}
        for people in self.people.values():
            if people.present or not people.edges.isdisjoint(there):
                people.note(time_s, there)

    def _person_came(self, person: str) -> None:
        self.control.ignore(self.api.person.getTypeID(person))

    def _count(self) -> None:
        """Count the vehicles that departed, collided, were teleported, or have left."""
        api, log = self.api, self.log
        for name in self._departed():
            type_id = api.vehicle.getTypeID(name)
            vehicle_class = api.vehicle.getVehicleClass(name)
            automated = self.is_automated(name, type_id, vehicle_class)
            log.vehicles[name] = VehicleKind(type_id, vehicle_class, automated)
            self.simulation.departed(name, automated=automated)
        for collision in self._collisions():
            self._note_collision(collision)
        teleported = self._teleported()
        log.teleports += len(teleported)
        gone = [(name, "arrived on its way") for name in self._gone()]
        for name, why in gone + [(name, TELEPORTED) for name in teleported]:
            self.judged.pop(name, None)
            for key in [key for key in self.active if key[0] == name]:
                self._end(key, why, exists=why == TELEPORTED)

    def _note_collision(self, collision: Any) -> None:
        """Count a collision once, although SUMO reports it at several steps."""
        log = self.log
        key = (collision.collider, collision.victim)
        if key in self.hits:
            return
        self.hits.add(key)
        # Vehicles and people may have the same ids.
        if collision.type not in _WITH_PEOPLE and collision.victim in log.vehicles:
            log.collisions += 1
            return
        crosswalk = self._hit_at(collision.lane, collision.pos)
        for passage in self.active.values():
            at_crosswalk = passage.driven_way.way.crosswalk == crosswalk
            if passage.name == collision.collider and at_crosswalk:
                passage.collided = True
        log.person_collisions[crosswalk] += 1

    def _hit_at(self, lane: str, position_m: float) -> str:
        """The chosen crosswalk nearest to a vehicle's front on a lane; else the lane's edge."""
        places = {
            crosswalk.id: abs(part.start_m + position_m)
            for crosswalk in self.setting.crosswalks
            for way in crosswalk.ways
            for part in way.lanes
            if part.lane == lane and part.start_m + position_m >= -way.crossing.width_m / 2 - NEAR_M
        }
        if not places or min(places.values()) > self.setting.range_m:
            return lane.rsplit("_", 1)[0]
        return min(places, key=lambda crosswalk: places[crosswalk])

    def _follow(self, time_s: float) -> None:
        """Read the states, at the step's end, of all vehicles on their way over a crosswalk."""
        if not self.active:
            return
        states: dict[str, tuple[float, float]] = {}
        checked: set[str] = set()
        for key, passage in [*self.active.items()]:
            name = passage.name
            if name not in states:
                try:
                    states[name] = self._distance_of(name), self._speed_of(name)
                except self.api.TraCIException:
                    self._end(key, VANISHED, exists=False)
                    continue
            driven_m, speed_mps = states[name]
            if passage.offset_m + driven_m < 0.0:
                self._lane_changes.follow(passage, driven_m)
            x_m = passage.offset_m + driven_m
            passage.note(time_s, x_m, speed_mps)
            if passage.strategy is not None and name not in checked:
                checked.add(name)
                self.control.check(name, speed_mps)
            if x_m >= passage.rear_left_m:
                if left_way(self.api, name, passage.driven_way.way, x_m):
                    # It was rerouted on its way here.
                    passage.astray = TURNS
                self._end(key, "passed", exists=True)

    def _end(self, key: tuple[str, str], why: str, *, exists: bool) -> None:
        passage = self.active.pop(key)
        passage.ended = why
        self._leave_out(passage)
        if passage.strategy is not None:
            passage.fallback = bool(getattr(passage.strategy, "fallback", False))
            self.control.leave(passage, exists=exists)
            passage.strategy = None

    def _leave_out(self, passage: PassageLog) -> None:
        """Count a passage that cannot be measured where the vehicle went, instead of its values."""
        if passage.astray is not None:
            self.log.passages.remove(passage)
            crosswalk = passage.driven_way.way.crosswalk
            self._not_measured(crosswalk, passage.astray, passage.time_s[0])

    def _judged(self, name: str, position_m: float, lane: WatchedLane, time_s: float) -> bool:
        """Whether nothing remains to be decided about a vehicle at any crosswalk on this lane."""
        decided = lane.decided.setdefault(name, set())
        for crosswalk, ways in lane.ways.items():
            if crosswalk in decided:
                continue
            candidates = [(each, start_m + position_m) for each, start_m in ways]
            x_m = max(x_m for _, x_m in candidates)
            if (name, crosswalk) not in self.active and x_m < 0.0:
                near = x_m >= -self.setting.range_m - ROUNDING_M
                if not (near and self._arrived(name, crosswalk, candidates, time_s)):
                    continue
            decided.add(crosswalk)
        return len(decided) == len(lane.ways)

    def _arrived(
        self, name: str, crosswalk: str, candidates: list[tuple[DrivenWay, float]], time_s: float
    ) -> bool:
        """Whether a vehicle has passed R0 of a crosswalk; if so, its passage begins or is counted.

        A vehicle whose route does not lead over the crosswalk has no passage there.
        """
        api = self.api.vehicle
        route, index = api.getRoute(name), api.getRouteIndex(name)
        visits = self.judged.setdefault(name, {})
        elsewhere: Visit | None = None
        for each, x_m in candidates:
            visit = visit_of(route, index, each.way)
            if visit is None:
                continue
            if visit.why is not None:
                elsewhere = visit
                continue
            if x_m < -self.setting.range_m - ROUNDING_M:
                return False
            if visits.get(crosswalk) != visit.at:
                visits[crosswalk] = visit.at
                self._begin(name, each, x_m, time_s, route[visit.at + 1 :])
            return True
        if elsewhere is not None and visits.get(crosswalk) != elsewhere.at:
            visits[crosswalk] = elsewhere.at
            self._not_measured(crosswalk, elsewhere.why or TURNS, time_s)
        return True

    def _not_measured(self, crosswalk: str, why: str, time_s: float) -> None:
        if self.counted[0] <= time_s < self.counted[1]:
            self.log.not_measured[crosswalk, why] += 1

    def _begin(
        self, name: str, driven_way: DrivenWay, x_m: float, time_s: float, ahead: Sequence[str]
    ) -> None:
        api, way = self.api.vehicle, driven_way.way
        speed_mps = api.getSpeed(name)
        vehicle = Vehicle(
            initial_speed_mps=max(free_speed(self.api, name, way), 0.1),
            trigger_range_m=self.setting.range_m,
            detection_range_m=self.detection_m,
            length_m=api.getLength(name),
            width_m=api.getWidth(name),
            max_acceleration_mps2=api.getAccel(name),
            max_deceleration_mps2=api.getDecel(name),
            resume_acceleration_mps2=min(self.resume_mps2, api.getAccel(name)),
        )
        if not way.is_straight(vehicle.length_m):
            self._not_measured(way.crosswalk, BENDS, time_s)
            return
        kind = self.log.vehicles[name]
        step_s = self.simulation.step_s
        # If the speed fell within the step, the front may be farther beyond R0.
        most_m = (speed_mps + vehicle.max_deceleration_mps2 * step_s) * step_s + 1e-6
        if x_m + self.setting.range_m > most_m:
            refused: str | None = INSIDE
        else:
            refused = why_not(self.api, name, way, vehicle, x_m, ahead)
        driver, strategy = ("sumo", None) if refused else self.make(name, kind.automated)
        if strategy is not None:
            vehicle = self.late(vehicle, kind.automated)
        passage = PassageLog(
            name=name,
            type_id=kind.type_id,
            driven_way=driven_way,
            vehicle=vehicle,
            automated=kind.automated,
            strategy_name=driver,
            not_driven=refused,
            offset_m=x_m - api.getDistance(name),
            strategy=strategy,
        )
        passage.note(time_s, x_m, speed_mps)
        self.active[name, way.crosswalk] = passage
        self.log.passages.append(passage)
        if strategy is not None:
            if self.sight is not None:
                self.sight.begin(passage)
            self.control.take(passage)
