"""One arm of a pair: SUMO step by step; passages, people and events out."""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from harness.core.encounter import (
    Arm,
    Arrival,
    Behaviour,
    Crossing,
    PedestrianView,
    Strategy,
    Vehicle,
)
from harness.encounter.cell_constants import CellConstants
from harness.encounter.deciding import ROUNDING_M
from harness.encounter.walkers import ChooseSpeed
from harness.engine.session import Session
from harness.scenario import ThresholdSection
from harness.simulation.driving import ON_IT, Car, Control, Passage, Zones, plan
from harness.simulation.people import WALKER_TYPE, OwnPeople, PeopleAt, SeenLane, Walked
from harness.simulation.seeing import Sight
from harness.simulation.shares import is_automated
from harness.site.configuration import SumoConfig
from harness.site.town import Town
from harness.strategies.perception.sensor import Sensor

QUEUED_MPS = 5 / 3.6
"""A vehicle below this speed is queued (5 km/h, as in SUMO's queue output)."""
SAMPLE_S = 1.0
"""Time between two samples of the queues."""
HOPELESS_S = 3600.0
"""In a configuration without an end, an arm fails if no vehicle moves for this long."""

SUMO_DRIVES = "sumo"
NOT_AN_AV = "it is no AV"
SUMO_IS_REFERENCE = "SUMO drives in this arm"
LEFT = "it went another way"
ENDED = "the simulation ended"
ARRIVED = "it arrived on its way"
TELEPORTED = "SUMO teleported it"
PASSED = "passed"

_SIGHT_M = 200.0
"""The harness's people see vehicles that are this near."""
_MARGIN_M = 15.0
"""The front of a body that touches a crosswalk is this much nearer to its stop line at most."""
_MOST_MPS = 70.0
"""No vehicle is faster."""
_CAR_M = (5.0, 1.8)
"""Length and width of SUMO's car."""


@dataclass(frozen=True, slots=True)
class Behaving:
    """How the harness's people come and decide.

    Attributes:
        arrivals: everybody at a crosswalk in a pair, by time since the simulation's begin.
        choose_speed: the walking speeds of a pair.
        behaviour, kerb_wait_s, threshold: see ``CellConstants``.
    """

    arrivals: Callable[[int, str], Sequence[Arrival]]
    choose_speed: Callable[[int], ChooseSpeed]
    behaviour: Behaviour
    kerb_wait_s: float
    threshold: ThresholdSection = field(default_factory=ThresholdSection)


@dataclass(frozen=True, slots=True)
class Setup:
    """What all arms of a cell share.

    Attributes:
        config, town, zones: SUMO's configuration, its network, and the zones in it.
        crosswalks: ids of the chosen crosswalks.
        av_share, av_types: the share of AVs among vehicles of these vTypes and vClasses.
        begin_s, end_s: the counted time; the end may be infinite.
        range_m: R0, where a passage begins.
        detection_m: distance within which drivers see people.
        resume_mps2: a0 of every strategy.
        names: the name of each arm's strategy.
        make: makes the strategy of a vehicle, from who drives, the pair and the vehicle's number;
            it may return None, which leaves the vehicle to SUMO.
        late: how late a vehicle obeys a driver.
        sensors: the sensor of each driver; without any, all see the truth.
        own: the harness's people, by crosswalk.
        until_empty: whether an arm ends once nobody is on the way after the counted time.
    """

    config: SumoConfig
    town: Town
    zones: Zones
    crosswalks: tuple[str, ...]
    av_share: float
    av_types: frozenset[str]
    begin_s: float
    end_s: float
    range_m: float
    detection_m: float
    resume_mps2: float
    names: Mapping[Arm, str]
    make: Callable[[Arm, int, str], Strategy | None]
    late: Callable[[Vehicle, Arm], Vehicle] = lambda vehicle, _driver: vehicle
    sensors: Mapping[Arm, Sensor | None] = field(default_factory=dict)
    own: Mapping[str, Behaving] = field(default_factory=dict)
    until_empty: bool = False

    def counts(self, time_s: float) -> bool:
        """Whether a time is within the counted time."""
        return self.begin_s <= time_s < self.end_s


@dataclass(slots=True)
class Log:
    """The events of an arm.

    Attributes:
        passages: over the chosen crosswalks, those before the counted time too.
        people: everybody at each chosen crosswalk.
        kinds: vType, vClass and whether it is an AV, of every vehicle that departed.
        queues: by crosswalk, the number of queued vehicles at every counted second.
        collisions: (collider, victim, lane, position) of vehicles with each other, each pair once.
        person_collisions: number of vehicles' collisions with people by crosswalk or edge.
        teleports, emergency_stops: their numbers in the counted time.
        end_s: when the simulation ended.
    """

    passages: list[Passage] = field(default_factory=list)
    people: dict[str, list[Walked]] = field(default_factory=dict)
    kinds: dict[str, tuple[str, str, bool]] = field(default_factory=dict)
    queues: dict[str, list[int]] = field(default_factory=dict)
    collisions: list[tuple[str, str, str, float]] = field(default_factory=list)
    person_collisions: Counter[str] = field(default_factory=Counter)
    teleports: int = 0
    emergency_stops: int = 0
    end_s: float = 0.0


class ArmOfPair:
    """One arm of a pair.

    Args:
        setup: what all arms share.
        session: SUMO, running the arm's configuration.
        pair: index of the pair.
        arm: which arm.
        seed: SUMO's seed of the pair.
    """

    def __init__(self, setup: Setup, session: Session, pair: int, arm: Arm, seed: int) -> None:
        self.setup, self.session = setup, session
        self._pair, self._arm, self._seed = pair, arm, seed
        self._vehicles, self._begin_s = session.vehicles, session.time_s
        self.log = Log(queues={name: [] for name in setup.crosswalks})
        self._cars: dict[str, Car] = {}
        self._near: dict[str, Car] = {}
        self._due: dict[int, list[Car]] = defaultdict(list)
        self._steps = 0
        self._hits: set[tuple[str, str]] = set()
        self.people: dict[str, PeopleAt] = {}
        self._owns: dict[str, OwnPeople] = {}
        self._lanes: dict[tuple[str, str], SeenLane] = {}
        self.control = Control(session, setup.detection_m, setup.config.ballistic, self._views)
        for name in setup.crosswalks:
            self._watch(name)
        self._always = frozenset(setup.crosswalks)
        self._types: set[str] = {WALKER_TYPE} if self._owns else set()
        self.control.ignore(self._types)
        self.sight = Sight(setup.sensors, pair, session, self.people)
        self._reach_m = max(setup.range_m, _SIGHT_M if self._owns else 0.0) + _MARGIN_M
        self._approaches = {
            name: sorted({_edge(each.from_lane) for each in setup.town.connections(name)})
            for name in setup.crosswalks
        }
        self._on_edge: dict[str, Sequence[str]] = dict.fromkeys(self._watched(), ())

    def run(self) -> Log:
        """Simulate until the end.

        Raises:
            EngineError: SUMO's simulation broke off, or would never end.
            StrategyError: a strategy failed.
        """
        session, setup = self.session, self.setup
        end_s = setup.config.end_s
        sample = max(1, round(SAMPLE_S / session.step_s))
        while session.goes_on(end_s) and not self._is_empty():
            now_s = session.time_s
            self._begin_people(now_s)
            self.control.command(now_s)
            then_s = now_s - self._begin_s + session.step_s
            for own in self._owns.values():
                own.place(then_s)
            time_s = session.step()
            self._steps += 1
            self._events(time_s)
            self._note_people(time_s)
            self._read()
            for own in self._owns.values():
                if own.crowd.next_s <= then_s:
                    own.crowd.advance(now_s - self._begin_s, then_s)
            self._move(time_s)
            self._look(time_s)
            if self._steps % sample == 0 and setup.counts(time_s):
                self._sample()
        self.log.end_s = session.time_s
        for passage in [each for car in self._near.values() for each in car.passages]:
            self._end(passage, ENDED)
        self.log.people = {
            name: self.people[name].walked(self._begin_s) for name in setup.crosswalks
        }
        self.log.passages.sort(key=lambda each: (each.time_s[0], each.car.name, each.crosswalk.id))
        return self.log

    def __len__(self) -> int:
        """The number of simulated steps."""
        return self._steps

    def _is_empty(self) -> bool:
        """Whether nobody is left whom the arm waits for."""
        session, setup = self.session, self.setup
        late = setup.until_empty and session.time_s >= setup.end_s
        return late and not session.goes_on(None)

    # People

    def _watch(self, name: str) -> None:
        """Begin to follow the people at a crosswalk."""
        setup, session = self.setup, self.session
        crosswalk, behaving = setup.town.crosswalks[name], setup.own.get(name)
        arrivals = () if behaving is None else behaving.arrivals(self._pair, name)
        people = PeopleAt(session, crosswalk, setup.town.areas(name), len(arrivals))
        self.people[name] = people
        if behaving is None:
            return
        lanes = []
        for connection in setup.town.connections(name):
            found = setup.zones.at(connection, crosswalk, *_CAR_M)
            if found is not None:
                lane = self._lanes[name, connection.id] = SeenLane(found[0], found[1].lane_width_m)
                lanes.append(lane)
        length_m = crosswalk.length_m
        rules = CellConstants(
            vehicle=_vehicle(setup, *_CAR_M, 2.6, 4.5),
            crossing=Crossing(length_m, crosswalk.width_m, length_m / 2, length_m),
            kerb_wait_s=behaving.kerb_wait_s,
            step_s=session.step_s,
            timeout_s=math.inf,
            behaviour=behaving.behaviour,
            threshold=behaving.threshold,
        )
        people.own = self._owns[name] = OwnPeople(
            session,
            name,
            people.axis,
            setup.town.footpaths(name),
            arrivals,
            behaving.choose_speed(self._pair),
            rules,
            lanes,
        )

    def _begin_people(self, now_s: float) -> None:
        """Let the harness's people decide on the vehicles' states at the step's beginning."""
        for own in self._owns.values():
            if own.crowd.walkers:
                own.crowd.begin_step(now_s - self._begin_s)

    def _note_people(self, time_s: float) -> None:
        """Note where SUMO's people are; each walking area is read once."""
        names = set(self._always)
        for car in self.control.driven.values():
            names.update(each.crosswalk.id for each in car.passages if each.strategy is not None)
        self._note_at(names, time_s)
        self.control.ignore(self._types)

    def _note_at(self, names: Iterable[str], time_s: float) -> None:
        there: dict[str, Sequence[str]] = {}
        for name in names:
            if name not in self.people:
                self._watch(name)
            people = self.people[name]
            for edge in people.edges:
                if edge not in there:
                    there[edge] = self.session.people_on(edge)
            people.note(time_s, there)
            self._types |= people.types

    def _views(self, passage: Passage, near: bool) -> Sequence[PedestrianView]:
        if passage.updates is not None:
            return self.sight.shown(passage, near=near)
        if not near:
            return ()
        views = self.people[passage.crosswalk.id].views(passage.zone)
        if passage.crosswalk.refused is not None:
            # A light tells the others when to go.
            return [view for view in views if view.on_crossing]
        return views

    # Events

    def _events(self, time_s: float) -> None:
        """Count the vehicles that departed, collided, were teleported, or have left."""
        session, log, setup = self.session, self.log, self.setup
        for name in session.departed():
            kind = self._vehicles.type(name), self._vehicles.vehicle_class(name)
            automated = is_automated(self._seed, name, {*kind}, setup.av_share, setup.av_types)
            log.kinds[name] = (*kind, automated)
        counts = setup.counts(time_s)
        for hit in session.collisions():
            key = (hit.collider, hit.victim)
            if key not in self._hits:
                self._hits.add(key)
                self._hit(*hit, counts)
        teleported = session.teleported()
        if counts:
            log.teleports += len(teleported)
            log.emergency_stops += len(session.emergency_stops())
        gone = dict.fromkeys(session.arrived(), ARRIVED) | dict.fromkeys(teleported, TELEPORTED)
        for name, why in gone.items():
            car = self._cars.pop(name, None)
            if car is not None:
                self._drop(car, why, exists=why == TELEPORTED)

    def _hit(self, collider: str, victim: str, lane: str, position_m: float, counts: bool) -> None:
        """Note a collision; SUMO reports it at several steps, and it counts at the first."""
        # Vehicles and people may have the same ids: whoever is on a crosswalk walks.
        places = [name for name, people in self.people.items() if victim in people.names]
        if victim in self.log.kinds and not places:
            if counts:
                self.log.collisions.append((collider, victim, lane, position_m))
            return
        car = self._near.get(collider)
        for passage in () if car is None else car.passages:
            passage.collided |= passage.crosswalk.id in places
        if counts:
            self.log.person_collisions[places[0] if places else _edge(lane)] += 1

    # Vehicles

    def _watched(self) -> Iterable[str]:
        """The edges from which a vehicle may reach a chosen crosswalk within the reach."""
        town = self.setup.town
        away_m = {edge: 0.0 for edges in self._approaches.values() for edge in edges}
        todo = [*away_m]
        while todo:
            edge = todo.pop()
            lanes = town.lanes(edge)
            through_m = away_m[edge] + min((town.lane(each).length_m for each in lanes), default=0)
            if through_m > self._reach_m:
                continue
            for before in town.before(edge):
                if through_m < away_m.get(before, math.inf):
                    away_m[before] = through_m
                    todo.append(before)
        return sorted(away_m)

    def _look(self, time_s: float) -> None:
        """Find the vehicles that came onto watched edges, or may have come near by now."""
        for edge, before in self._on_edge.items():
            names = self.session.vehicles_on(edge)
            if names != before:
                self._on_edge[edge] = names
                for name in names:
                    if name not in before:
                        self._found(name, time_s)
        for car in self._due.pop(self._steps, ()):
            if self._cars.get(car.name) is car and car.name not in self._near:
                self._approach(car, time_s)

    def _found(self, name: str, time_s: float) -> None:
        if name in self._near:
            return
        car = self._cars.get(name)
        if car is None:
            vehicles, kind = self._vehicles, self.log.kinds.get(name)
            if kind is None:
                return
            accel = vehicles.acceleration_limit_mps2(name)
            vehicle = _vehicle(
                self.setup,
                vehicles.length_m(name),
                vehicles.width_m(name),
                accel,
                vehicles.deceleration_limit_mps2(name),
            )
            car = self._cars[name] = Car(
                name,
                kind[0],
                kind[2],
                vehicle,
                vehicles.speed_factor(name),
                vehicles.max_speed_mps(name),
            )
        self._approach(car, time_s)

    def _approach(self, car: Car, time_s: float) -> None:
        """Plan a vehicle that is not near yet, and decide when to look at it again."""
        car.odometer_m = self._vehicles.odometer_m(car.name)
        self._replan(car)
        first_m = min((each.first_m for each in car.passages if each.chosen), default=None)
        if first_m is None:
            self._cars.pop(car.name, None)
            return
        left_m = first_m - car.odometer_m - self._reach_m
        if left_m > 0.0:
            steps = 1 + int(left_m / (_MOST_MPS * self.session.step_s))
            self._due[self._steps + steps].append(car)
            return
        self._near[car.name] = car
        car.next_m, car.next_mps = car.odometer_m, self._vehicles.speed_mps(car.name)
        car.speed_mps = car.next_mps
        car.acceleration_mps2 = self._vehicles.acceleration_mps2(car.name)
        self._begin(car, time_s)

    def _replan(self, car: Car) -> None:
        """Find the crosswalks ahead of a vehicle, if it has come onto another lane."""
        lane = self._vehicles.lane(car.name)
        if lane == car.lane or lane.startswith(":") or not lane:
            return
        car.lane = lane
        base_m = car.odometer_m - self._vehicles.lane_position_m(car.name)
        limits, links = plan(self.setup.town, self._ahead(car.name, lane), self._reach_m)
        car.limits = [(base_m + at_m, car.limit_mps(limit_mps)) for at_m, limit_mps in limits]
        car.links = [(base_m + begin_m, base_m + end_m, link) for begin_m, end_m, link in links]
        coming = [*self._coming(car)]
        for passage in [*car.passages]:
            alike = (
                each
                for each in coming
                if each.crosswalk is passage.crosswalk
                and abs(each.stop_m - passage.stop_m) < _MARGIN_M
            )
            same = next(alike, None)
            if same is not None:
                coming.remove(same)
                if same.connection is not passage.connection and passage.first_m > car.odometer_m:
                    self._seen(passage, remove=True)
                    passage.move_to(same)
                    self._seen(passage)
            elif passage.first_m > car.odometer_m:
                self._end(passage, LEFT)
        for passage in coming:
            if passage.last_m > car.odometer_m:
                car.passages.append(passage)
                self._seen(passage)
        car.passages.sort(key=lambda each: each.first_m)
        if car.mode is not None:
            self.control.update(car)

    def _ahead(self, name: str, lane: str) -> Sequence[str]:
        """The lanes that a vehicle will follow, its own first."""
        rows = self._vehicles.best_lanes(name)
        index = next((i for i, row in enumerate(rows) if row[0] == lane), None)
        if index is None:
            return [lane]
        row = rows[index]
        if len(row[5]) < 2 and row[3]:
            # It has to change lane before the junction.
            row = rows[index + row[3]]
        return [lane, *row[5][1:]] if row is rows[index] else row[5]

    def _coming(self, car: Car) -> Iterable[Passage]:
        """The passages that lie ahead; those over other crosswalks only if it may be driven."""
        zones, vehicle = self.setup.zones, car.vehicle
        may_be_driven = bool(self._owns) or car.automated
        for stop_m, _, link in car.links:
            for crosswalk in zones.crosswalks(link):
                chosen = crosswalk.id in self._always
                if not (chosen or may_be_driven):
                    continue
                found = zones.at(link, crosswalk, vehicle.length_m, vehicle.width_m)
                if found is not None:
                    yield Passage(car, crosswalk, chosen, link, *found, stop_m, vehicle)

    def _seen(self, passage: Passage, *, remove: bool = False) -> None:
        """Let the harness's people see a vehicle, or see it no more."""
        lane = self._lanes.get((passage.crosswalk.id, passage.connection.id))
        if lane is None:
            return
        if remove:
            lane.coming = [each for each in lane.coming if each is not passage]
        else:
            lane.coming.append(passage)
            lane.coming.sort(key=lambda each: -each.x_m)

    def _begin(self, car: Car, time_s: float) -> None:
        """Begin the passages of a vehicle that has passed R0."""
        begun = False
        for passage in car.passages:
            if passage.begun or car.odometer_m < passage.centre_m - self.setup.range_m - ROUNDING_M:
                continue
            if passage.chosen or car.mode is not None or begun:
                self._start(passage, time_s)
                begun |= passage.strategy is not None
        if begun:
            self.control.update(car)

    def _start(self, passage: Passage, time_s: float) -> None:
        setup, car = self.setup, passage.car
        x_m, link = car.odometer_m - passage.centre_m, passage.connection
        over_m = max(0.0, x_m + setup.range_m)
        step_m = (car.speed_mps + car.vehicle.max_deceleration_mps2 * self.session.step_s) * (
            self.session.step_s
        )
        inside = over_m > step_m + 1e-6
        driver = Arm.AV if car.automated and self._arm is Arm.AV else Arm.HUMAN
        v0_mps = car.limit_mps(setup.town.lane(link.from_lane).limit_mps)
        passage.begun = True
        passage.vehicle = setup.late(
            replace(
                car.vehicle,
                initial_speed_mps=max(v0_mps, 0.1),
                width_m=passage.zone.to_m - passage.zone.from_m,
                trigger_range_m=max(-x_m, 0.1) if inside else setup.range_m,
            ),
            driver,
        )
        if over_m > ROUNDING_M and not inside:
            gain, speed = car.acceleration_mps2, car.speed_mps
            if not setup.config.ballistic:
                gain = 0.0
            # Time since R0, from over = v t − a t²/2.
            root = math.sqrt(max(0.0, speed**2 - 2 * gain * over_m))
            passage.trace_offset_s = min(2 * over_m / (speed + root), self.session.step_s)
        if not (car.automated or passage.crosswalk.id in self._owns or car.mode is not None):
            passage.not_driven = NOT_AN_AV
        elif x_m >= -passage.crossing.width_m / 2:
            passage.not_driven = ON_IT
        else:
            passage.strategy = setup.make(driver, self._pair, car.name)
            if passage.strategy is None:
                passage.not_driven = SUMO_IS_REFERENCE
            else:
                passage.driver = setup.names[driver]
                if not passage.chosen:
                    self._note_at([passage.crosswalk.id], time_s)
                self.sight.begin(passage, driver)
        passage.note(time_s, car.odometer_m, car.speed_mps)
        if passage.chosen:
            self.log.passages.append(passage)

    def _read(self) -> None:
        """Read the states, at the step's end, of all vehicles near a chosen crosswalk."""
        odometer, speed, step_s = (
            self._vehicles.odometer_m,
            self._vehicles.speed_mps,
            self.session.step_s,
        )
        for name, car in self._near.items():
            car.next_m, car.next_mps = odometer(name), speed(name)
            car.acceleration_mps2 = (car.next_mps - car.speed_mps) / step_s
            if car.asked_mps is not None:
                self.control.check(car)

    def _move(self, time_s: float) -> None:
        """Go on to the step's end; end passages, and begin those beyond R0."""
        for car in [*self._near.values()]:
            car.odometer_m, car.speed_mps = car.next_m, car.next_mps
            done, wanted = False, False
            for passage in car.passages:
                if passage.begun:
                    passage.note(time_s, car.odometer_m, car.speed_mps)
                    done |= car.odometer_m >= passage.last_m - ROUNDING_M
                else:
                    wanted |= car.odometer_m >= passage.centre_m - self.setup.range_m - ROUNDING_M
            if done:
                for passage in [*car.passages]:
                    if passage.begun and car.odometer_m >= passage.last_m - ROUNDING_M:
                        passage.passed = True
                        self._end(passage, PASSED)
            self._replan(car)
            if wanted or (car.passages and not car.passages[-1].begun):
                self._begin(car, time_s)
            if done:
                self.control.update(car)
            if not any(each.chosen or each.strategy is not None for each in car.passages):
                self._cars.pop(car.name, None)
                self._drop(car, PASSED, exists=True)

    def _end(self, passage: Passage, why: str) -> None:
        passage.ended = why
        passage.car.passages.remove(passage)
        self._seen(passage, remove=True)
        if passage.strategy is not None:
            passage.fallback = bool(getattr(passage.strategy, "fallback", False))
            passage.strategy = None

    def _drop(self, car: Car, why: str, *, exists: bool) -> None:
        """Leave a vehicle alone."""
        self._near.pop(car.name, None)
        for passage in [*car.passages]:
            self._end(passage, why)
        self.control.release(car, exists=exists)

    def _sample(self) -> None:
        """Count the queued vehicles before each crosswalk."""
        speed = self._vehicles.speed_mps
        for crosswalk, edges in self._approaches.items():
            names = {name for edge in edges for name in self.session.vehicles_on(edge)}
            # The first one may wait inside the junction.
            names.update(
                car.name
                for car in self._near.values()
                for each in car.passages
                if each.crosswalk.id == crosswalk and each.begun and car.odometer_m < each.first_m
            )
            self.log.queues[crosswalk].append(sum(speed(name) < QUEUED_MPS for name in names))


def _vehicle(
    setup: Setup, length_m: float, width_m: float, accel_mps2: float, decel_mps2: float
) -> Vehicle:
    """The constants of a vehicle, apart from v0."""
    return Vehicle(
        initial_speed_mps=1.0,
        trigger_range_m=setup.range_m,
        detection_range_m=setup.detection_m,
        length_m=length_m,
        width_m=width_m,
        max_acceleration_mps2=accel_mps2,
        max_deceleration_mps2=decel_mps2,
        resume_acceleration_mps2=min(setup.resume_mps2, accel_mps2),
    )


def _edge(lane: str) -> str:
    return lane.rpartition("_")[0]
