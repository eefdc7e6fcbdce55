"""One arm of a pair in a user's simulation: SUMO step by step, its log out."""

import hashlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from harness.core.encounter import PedestrianView, Strategy, Vehicle
from harness.core.errors import EngineError
from harness.engine.simulation.running import OwnSimulation
from harness.episode.deciding import ROUNDING_M
from harness.episode.simulation.driving import Control, PassageLog
from harness.episode.simulation.passages import PersonTrack
from harness.episode.simulation.people import PeopleAtCrosswalk
from harness.site.simulation import DrivenWay, Setting

QUEUED_MPS = 5 / 3.6
"""Slower than this counts as queued (SUMO's queue output: 5 km/h)."""

SAMPLE_S = 1.0
"""How often the queues are looked at."""

TURNS = "turns at the junction"
INSIDE = "came onto the approach within R0"
BENDS = "its way bends within R0 or before its rear has left"
STOPS = "stops before its rear has left"
ARRIVES = "arrives before its rear has left"

MakeDriver = Callable[[str, bool], tuple[str, Strategy | None]]
"""From a vehicle's id and whether it is an AV: its driver's name and strategy (None: SUMO)."""


def uniform_of(seed: int, vehicle: str) -> float:
    """A number from 0 to 1 that belongs to a vehicle of a pair.

    Whoever's number lies below the share is an AV, so a greater share only adds AVs.
    """
    digest = hashlib.blake2b(f"{seed}:{vehicle}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big") / 2**64


@dataclass(slots=True)
class VehicleKind:
    """What a trip's row needs beside SUMO's: the vehicle's class, and whether it is an AV."""

    type_id: str
    vehicle_class: str
    automated: bool


@dataclass(slots=True)
class SimulationLog:
    """The events of one arm.

    Attributes:
        vehicles: every vehicle that departed, by id.
        passages: over the chosen crosswalks, by the time of R0.
        people: by crosswalk, everybody who was on it.
        queues_m: by crosswalk, the queue in m at every second that counts.
        not_measured: by crosswalk and reason, vehicles that were not measured.
        collisions: number of vehicle–vehicle and vehicle–person collisions by SUMO's own count.
        person_collisions: by crosswalk, those with people at the chosen crosswalks.
        teleports: number of vehicles that SUMO teleported.
        end_s: the time at which the simulation ended.
    """

    vehicles: dict[str, VehicleKind] = field(default_factory=dict)
    passages: list[PassageLog] = field(default_factory=list)
    people: dict[str, list[PersonTrack]] = field(default_factory=dict)
    queues_m: dict[str, list[float]] = field(default_factory=dict)
    not_measured: Counter[tuple[str, str]] = field(default_factory=Counter)
    collisions: int = 0
    person_collisions: Counter[str] = field(default_factory=Counter)
    teleports: int = 0
    end_s: float = 0.0


class SimulationArm:
    """One arm on the road.

    Args:
        simulation: SUMO, running the user's scenario.
        setting: its crosswalks.
        counted: begin and end of what is counted, in s.
        detection_m: how far vehicles see people.
        resume_mps2: a0 of every strategy.
        is_automated: whether a vehicle with this id, type and class is an AV.
        make: the driver of a vehicle that a strategy may drive.
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
    ) -> None:
        self.simulation, self.setting, self.counted = simulation, setting, counted
        self.detection_m, self.resume_mps2 = detection_m, resume_mps2
        self.is_automated, self.make = is_automated, make
        self.api: Any = simulation.api
        self.log = SimulationLog()
        self.lanes = dict(setting.lanes())
        self.seen: dict[str, set[str]] = {lane: set() for lane in self.lanes}
        self.judged: dict[str, dict[str, int]] = {}
        self.active: dict[tuple[str, str], PassageLog] = {}
        self.control = Control(self.api, simulation.step_s, detection_m, self._views)
        self.people = {
            crosswalk.id: PeopleAtCrosswalk(self.api, crosswalk, self._person_came)
            for crosswalk in setting.crosswalks
        }
        self.hits: set[tuple[str, str]] = set()
        self.queues = {crosswalk.id: list[float]() for crosswalk in setting.crosswalks}
        self.approaches: dict[str, list[tuple[str, float]]] = {
            crosswalk.id: sorted(
                {
                    (lane.lane, lane.start_m)
                    for way in crosswalk.ways
                    for lane in way.lanes
                    if lane.lane == way.approach
                }
            )
            for crosswalk in setting.crosswalks
        }

    def run(self) -> SimulationLog:
        """Simulate until the end.

        Raises:
            EngineError: SUMO lost the simulation; StrategyError: a strategy failed.
        """
        simulation, log = self.simulation, self.log
        sample_steps = max(1, round(SAMPLE_S / simulation.step_s))
        steps = 0
        try:
            while simulation.goes_on:
                self.control.command(simulation.time_s)
                time_s = simulation.step()
                steps += 1
                self._count()
                for people in self.people.values():
                    people.note(time_s)
                self._follow(time_s)
                self._look(time_s)
                if steps % sample_steps == 0 and self.counted[0] < time_s <= self.counted[1]:
                    self._sample()
        except (self.api.TraCIException, self.api.FatalTraCIError) as error:
            raise EngineError(f"SUMO lost the simulation: {error}") from None
        for passage in self.active.values():
            passage.ended = "the simulation ended"
        log.end_s = simulation.time_s
        log.people = {name: people.tracks() for name, people in self.people.items()}
        log.queues_m = self.queues
        log.passages.sort(key=lambda each: (each.time_s[0], each.name))
        return log

    def _views(self, driven_way: DrivenWay) -> list[PedestrianView]:
        return self.people[driven_way.way.crosswalk].views(driven_way.way)

    def _person_came(self, person: str) -> None:
        self.control.ignore(self.api.person.getTypeID(person))

    def _count(self) -> None:
        """Note who departed, collided, was teleported, or has left."""
        api, log = self.api, self.log
        for name in api.simulation.getDepartedIDList():
            type_id = api.vehicle.getTypeID(name)
            vehicle_class = api.vehicle.getVehicleClass(name)
            automated = self.is_automated(name, type_id, vehicle_class)
            log.vehicles[name] = VehicleKind(type_id, vehicle_class, automated)
            self.simulation.departed(name, automated=automated)
        for collision in api.simulation.getCollisions():
            self._note_collision(collision)
        teleported = api.simulation.getStartingTeleportIDList()
        log.teleports += len(teleported)
        gone = [(name, "arrived on its way") for name in api.simulation.getArrivedIDList()]
        for name, why in gone + [(name, "teleported") for name in teleported]:
            self.judged.pop(name, None)
            for key in [key for key in self.active if key[0] == name]:
                self._end(key, why, exists=why == "teleported")

    def _note_collision(self, collision: Any) -> None:
        """Count a collision once: SUMO repeats one for several steps."""
        log = self.log
        key = (collision.collider, collision.victim)
        if key in self.hits:
            return
        self.hits.add(key)
        if collision.victim in log.vehicles:
            log.collisions += 1
            return
        crosswalk = collision.lane.rsplit("_", 1)[0]
        for passage in self.active.values():
            if passage.name == collision.collider:
                passage.collided = True
                crosswalk = passage.driven_way.way.crosswalk
        log.person_collisions[crosswalk] += 1

    def _follow(self, time_s: float) -> None:
        """Read the states at the step's end of everybody on their way over a crosswalk."""
        vehicle = self.api.vehicle
        checked: set[str] = set()
        for key, passage in list(self.active.items()):
            name = passage.name
            x_m = passage.offset_m + vehicle.getDistance(name)
            speed_mps = vehicle.getSpeed(name)
            passage.note(time_s, x_m, speed_mps)
            if passage.strategy is not None and name not in checked:
                checked.add(name)
                self.control.check(name, speed_mps)
            if x_m >= passage.rear_left_m:
                self._end(key, "passed", exists=True)

    def _end(self, key: tuple[str, str], why: str, *, exists: bool) -> None:
        passage = self.active.pop(key)
        passage.ended = why
        if passage.strategy is not None:
            passage.fallback = bool(getattr(passage.strategy, "fallback", False))
            self.control.leave(passage, exists=exists)
            passage.strategy = None

    def _look(self, time_s: float) -> None:
        """Find the vehicles whose front has passed R0 in the last step."""
        on_lane, place = self.api.lane.getLastStepVehicleIDs, self.api.vehicle.getLanePosition
        for lane, ways in self.lanes.items():
            names, seen = on_lane(lane), self.seen[lane]
            if not names:
                seen.clear()
                continue
            for name in names:
                if name not in seen and self._judged(name, lane, place(name), ways, time_s):
                    seen.add(name)
            if len(seen) > len(names):
                seen.intersection_update(names)

    def _judged(
        self, name: str, lane: str, position_m: float, ways: list[DrivenWay], time_s: float
    ) -> bool:
        """Whether it is known of every crosswalk on this lane how the vehicle passes it."""
        by_crosswalk: dict[str, list[tuple[DrivenWay, float]]] = {}
        for each in ways:
            start_m = next(part.start_m for part in each.way.lanes if part.lane == lane)
            by_crosswalk.setdefault(each.way.crosswalk, []).append((each, start_m + position_m))
        whole = True
        for crosswalk, candidates in by_crosswalk.items():
            x_m = max(x_m for _, x_m in candidates)
            if (name, crosswalk) in self.active or x_m >= 0.0:
                continue
            if x_m < -self.setting.range_m - ROUNDING_M:
                whole = False
                continue
            self._arrive(name, crosswalk, candidates, time_s)
        return whole

    def _arrive(
        self, name: str, crosswalk: str, candidates: list[tuple[DrivenWay, float]], time_s: float
    ) -> None:
        """A vehicle has passed R0 of a crosswalk: its passage begins."""
        vehicle = self.api.vehicle
        route, index = vehicle.getRoute(name), vehicle.getRouteIndex(name)
        visits = self.judged.setdefault(name, {})
        for each, x_m in candidates:
            at = _on_route(route, index, each)
            if at is None:
                continue
            if visits.get(crosswalk) == at:
                return
            visits[crosswalk] = at
            self._begin(name, each, x_m, time_s)
            return
        if visits.get(crosswalk) != index:
            visits[crosswalk] = index
            self._not_measured(crosswalk, TURNS, time_s)

    def _not_measured(self, crosswalk: str, why: str, time_s: float) -> None:
        if self.counted[0] <= time_s < self.counted[1]:
            self.log.not_measured[crosswalk, why] += 1

    def _begin(self, name: str, driven_way: DrivenWay, x_m: float, time_s: float) -> None:
        api, way, range_m = self.api.vehicle, driven_way.way, self.setting.range_m
        speed_mps = api.getSpeed(name)
        vehicle = Vehicle(
            initial_speed_mps=max(api.getAllowedSpeed(name), 0.1),
            trigger_range_m=range_m,
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
        refused = self._refused(name, driven_way, vehicle, x_m, speed_mps)
        driver, strategy = ("sumo", None) if refused else self.make(name, kind.automated)
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
            self.control.take(passage)

    def _refused(
        self, name: str, driven_way: DrivenWay, vehicle: Vehicle, x_m: float, speed_mps: float
    ) -> str | None:
        """Why no strategy may drive a vehicle over a crosswalk, or None."""
        way, range_m = driven_way.way, self.setting.range_m
        step_s = self.simulation.step_s
        # Where the speed fell within the step, the front may be farther beyond R0.
        most_m = (speed_mps + vehicle.max_deceleration_mps2 * step_s) * step_s + 1e-6
        if x_m + range_m > most_m:
            return INSIDE
        if way.straight_before_m < range_m - 1e-6:
            return BENDS
        rear_m = vehicle.length_m + way.crossing.width_m / 2
        for stop in self.api.vehicle.getStops(name, 3):
            edge, _, _ = stop.lane.rpartition("_")
            place_m = way.place_m(edge, stop.endPos)
            if place_m is not None and -range_m <= place_m < rear_m:
                return STOPS
        route = self.api.vehicle.getRoute(name)
        if route[-1] == way.to_edge:
            length_m = self.api.lane.getLength(f"{way.to_edge}_0")
            end_m = way.place_m(way.to_edge, length_m)
            if end_m is not None and end_m < rear_m:
                return ARRIVES
        return None

    def _sample(self) -> None:
        """Every second: the queue before each crosswalk, to the rear of its last vehicle."""
        vehicle, on_lane = self.api.vehicle, self.api.lane.getLastStepVehicleIDs
        for crosswalk, lanes in self.approaches.items():
            longest_m = 0.0
            for lane, start_m in lanes:
                for name in on_lane(lane):
                    if vehicle.getSpeed(name) < QUEUED_MPS:
                        rear_m = -(start_m + vehicle.getLanePosition(name)) + vehicle.getLength(
                            name
                        )
                        longest_m = max(longest_m, rear_m)
            self.queues[crosswalk].append(longest_m)


def _on_route(route: tuple[str, ...], index: int, driven_way: DrivenWay) -> int | None:
    """The place of a way's approach in a vehicle's route ahead; None if it goes another way."""
    way = driven_way.way
    edges = [lane.edge for lane in way.lanes if not lane.edge.startswith(":")]
    if route[max(index, 0)] not in edges:
        return None
    here, last = edges.index(route[max(index, 0)]), edges.index(way.from_edge)
    ahead = [*edges[here : last + 1], way.to_edge]
    if list(route[index : index + len(ahead)]) != ahead:
        return None
    return index + last - here
