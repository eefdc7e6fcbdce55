"""One arm of a pair, step by step: who drives which passage; passages and people out."""

import math
from array import array
from collections import defaultdict
from collections.abc import Sequence
from functools import partial

from harness.core.vocabulary import ROUNDING, Arm, ModelUse
from harness.encounter.arms import uses_of
from harness.encounter.driver import Driver
from harness.encounter.walking_speeds import WalkingSpeeds
from harness.engine.protocol import Running
from harness.simulation.approaches import Approaches
from harness.simulation.cars import PASSED, Car, Passage
from harness.simulation.driving import Control
from harness.simulation.own_people import OwnPeople
from harness.simulation.people_at import PeopleAt
from harness.simulation.setup import Setup
from harness.simulation.traffic_counts import TrafficCounts
from harness.site.town import Crosswalk
from harness.strategies.perception.sensor import sensor_of

SAMPLE_S = 1.0
"""Time between two samples of the queues."""
LEAST_RANGE_M = 0.1
"""The least R0 of a passage whose vehicle came onto the road at the crosswalk."""
STROLL_S = 0.5
"""Time between two looks at people while no vehicle is within R0."""

ENDED = "the simulation ended"


class SimulatedArm:
    """One arm of a pair.

    Args:
        setup: what all arms share.
        session: SUMO, running the arm's configuration.
        pair: index of the pair.
        arm: which arm.

    Attributes:
        people: everybody at each chosen crosswalk.
        passages: over the chosen crosswalks, those before the counted time too.
        traffic: SUMO's events, the queues, and which vehicles are AVs.
        uses: those of the interaction model, by strategies that have ended and by people.
        times_s: the time at the end of every step so far.
    """

    def __init__(self, setup: Setup, session: Running, pair: int, arm: Arm) -> None:
        self.setup, self.session = setup, session
        self._pair, self._arm = pair, arm
        self.passages: list[Passage] = []
        self.uses: list[ModelUse] = []
        self.times_s = array("d")
        self._cars: dict[str, Car] = {}
        self._begun: dict[str, Car] = {}
        self._due: dict[int, list[Car]] = defaultdict(list)
        self._speeds = WalkingSpeeds(setup.scenario, setup.model)
        self.people = {name: self._people_at(each) for name, each in setup.crosswalks.items()}
        self._owns = [each.own for each in self.people.values() if each.own is not None]
        self._control = Control(session, setup, self.people)
        self._approaches = Approaches(setup, session)
        self.traffic = TrafficCounts(setup, session, pair, self._cars, self.people)

    def _people_at(self, crosswalk: Crosswalk) -> PeopleAt:
        setup, session = self.setup, self.session
        if not setup.own_people:
            return PeopleAt(session, crosswalk, None)
        others = self._pair, self._speeds, self._cars, self._refresh
        return PeopleAt(session, crosswalk, OwnPeople(session, setup, crosswalk, *others))

    def run(self) -> None:
        """Simulate until the end.

        Raises:
            EngineError: SUMO's simulation broke off.
            StrategyError: a strategy failed.
        """
        session, setup, last = self.session, self.setup, self.session.last
        empties = setup.scenario.traffic is not None
        sample, stroll = (max(1, round(each / session.step_s)) for each in (SAMPLE_S, STROLL_S))
        end_s = setup.config.end_s
        while session.goes_on(end_s):
            if empties and session.time_s >= setup.end_s and not session.goes_on(None):
                break
            self._begin_step()
            time_s = session.step()
            self.times_s.append(time_s)
            steps, departed = len(self.times_s), last.departed()
            self.traffic.note(time_s, departed)
            for name in last.arrived():
                self._drop(self._cars.get(name), "it arrived on its way")
            for name in last.teleported():
                self._drop(self._cars.get(name), "SUMO teleported it", exists=True)
            due = self._read()
            for own in self._owns:
                own.end_step()
            for car in due:
                self._go_on(car, time_s)
            self._look(steps, time_s, departed)
            for people in self.people.values():
                if people.watched or steps % stroll == 0:
                    people.note(time_s)
            if steps % sample == 0 and setup.counts(time_s):
                self.traffic.sample_queues(self._approaches.before)
        for car in [*self._cars.values()]:
            self._drop(car, ENDED)
        self.traffic.read_classes()
        self.uses.append(self._speeds.model_use.counts)
        self.passages.sort(key=lambda each: (each.begin_s, each.car.name, each.at.crosswalk.id))

    def _begin_step(self) -> None:
        """Let people and strategies decide on the state at the step's beginning."""
        for own in self._owns:
            own.begin_step()
        self._control.command(self.session.time_s)
        for people in self.people.values():
            if people.own is not None and people.own.place():
                people.changed = True
            if people.changed:
                people.changed = False
                self._control.ignore_at(people.crosswalk)

    def _read(self) -> list[Car]:
        """Read all vehicles that have begun a passage, at the step's end.

        Returns:
            Those that begin or end a passage, or have come onto another lane.
        """
        vehicles = self.session.vehicles
        odometer, speed, lane = vehicles.odometer_m, vehicles.speed_mps, vehicles.lane
        step_s, check, due = self.session.step_s, self._control.check, list[Car]()
        for name, car in self._begun.items():
            before_mps, odometer_m, speed_mps = car.speed_mps, odometer(name), speed(name)
            car.note(odometer_m, speed_mps)
            car.acceleration_mps2 = (speed_mps - before_mps) / step_s
            if (driven := car.driven) is not None:
                check(car, driven, before_mps)
            if odometer_m >= car.next_m or lane(name) != car.lane:
                due.append(car)
        return due

    def _look(self, steps: int, time_s: float, departed: Sequence[str]) -> None:
        """Find the vehicles that came onto watched edges, or may begin a passage by now."""
        due, automated_by_name = self._due.pop(steps, []), self.traffic.automated
        for name in self._approaches.found(steps, departed):
            if name not in self._cars and name in automated_by_name:
                automated = automated_by_name[name]
                driver = self._arm if automated else Arm.HUMAN
                self._cars[name] = self._approaches.car(name, automated, driver)
                due.append(self._cars[name])
        for car in due:
            if self._cars.get(car.name) is car:
                self._refresh(car)
                if car.odometer_m >= car.next_m or self.session.vehicles.lane(car.name) != car.lane:
                    self._go_on(car, time_s)
                else:
                    self._look_later(car)

    def _refresh(self, car: Car) -> None:
        """Read the state of a vehicle that is not read at every step."""
        name, vehicles = car.name, self.session.vehicles
        if name not in self._begun:
            car.odometer_m, car.speed_mps = vehicles.odometer_m(name), vehicles.speed_mps(name)
            car.acceleration_mps2 = vehicles.acceleration_mps2(name)

    def _go_on(self, car: Car, time_s: float) -> None:
        """End passages, find those that come, and begin those beyond R0."""
        for passage in [*car.passages]:
            if passage.begun and car.odometer_m >= passage.at.last_m - ROUNDING:
                self._end(passage, PASSED)
        self._replan(car)
        range_m = self.setup.scenario.ego.trigger_range_m + ROUNDING
        car.next_m = math.inf
        for passage in car.passages:
            if not passage.begun and car.odometer_m >= passage.at.centre_m - range_m:
                self._begin(passage, time_s)
            ends_m, begins_m = passage.at.last_m - ROUNDING, passage.at.centre_m - range_m
            car.next_m = min(car.next_m, ends_m if passage.begun else begins_m)
        if not car.passages:
            self._drop(car, PASSED, exists=True)
            return
        self._control.update(car)
        if not any(each.begun for each in car.passages):
            self._begun.pop(car.name, None)
            self._look_later(car)

    def _look_later(self, car: Car) -> None:
        """Look again when a vehicle may begin its next passage, but within a second."""
        step_m = max(car.facts.max_mps, 1.0) * self.session.step_s
        steps = min(int((car.next_m - car.odometer_m) / step_m), self._approaches.every)
        self._due[len(self.times_s) + max(1, steps)].append(car)

    def _replan(self, car: Car) -> None:
        """Find the crosswalks ahead of a vehicle, if it has come onto another lane."""
        coming = self._approaches.coming(car)
        if coming is None:
            return
        for passage in [*car.passages]:
            ahead = passage.at.first_m > car.odometer_m
            same = next((each for each in coming if each.at.is_like(passage.at)), None)
            if same is not None:
                coming.remove(same)
                if ahead and same.at.connection is not passage.at.connection:
                    passage.move_to(same)
            elif ahead:
                self._end(passage, "it went another way")
        car.passages += [each for each in coming if each.at.last_m > car.odometer_m]
        car.passages.sort(key=lambda each: each.at.first_m)

    def _begin(self, passage: Passage, time_s: float) -> None:
        """Begin a passage whose vehicle is within R0, and choose who drives."""
        setup, car, step_s = self.setup, passage.car, self.session.step_s
        people = self.people[passage.at.crosswalk.id]
        if car.name not in self._begun:
            self._begun[car.name] = car
            car.note(car.odometer_m, car.speed_mps)
        driver = self._arm if car.facts.automated else Arm.HUMAN
        range_m = setup.scenario.ego.trigger_range_m
        x_m = car.odometer_m - passage.at.centre_m
        over_m = max(0.0, x_m + range_m)
        reach_m = (car.speed_mps + car.facts.vehicle.max_deceleration_mps2 * step_s) * step_s
        within = car.speed_mps > 0 and over_m <= reach_m  # it may have departed here
        passage.begin(time_s, range_m if within else max(-x_m, LEAST_RANGE_M))
        if over_m > ROUNDING and within:
            # Time since R0, from over = v t − a t²/2.
            gain = car.acceleration_mps2 if setup.config.ballistic else 0.0
            root = math.sqrt(max(0.0, car.speed_mps**2 - 2 * gain * over_m))
            passage.trace_offset_s = min(2 * over_m / (car.speed_mps + root), step_s)
        if not (car.facts.automated or setup.own_people):
            passage.not_driven = "it is no AV"
        elif x_m >= -passage.crossing.width_m / 2:
            passage.not_driven = "it came onto the road on the crosswalk"
        else:
            passage.strategy = setup.strategy(driver, self._pair, car.name)
            if passage.strategy is None:
                passage.not_driven = "SUMO drives in this arm"
            else:
                passage.driver = setup.scenario.arms.driver(driver)
                people.note(time_s)
                sensor = sensor_of(setup.scenario, driver)
                look = None if sensor is None else people.seen_by(passage, sensor, self._pair)
                truth = partial(people.views, passage)
                passage.driven_by = Driver(passage, step_s, truth, look)
        people.watched += 1
        self.passages.append(passage)

    def _end(self, passage: Passage, why: str) -> None:
        if passage.strategy is not None:
            self.uses.append(uses_of(passage.strategy))
        passage.end(why)
        if passage.begun:
            self.people[passage.at.crosswalk.id].watched -= 1
        passage.car.passages.remove(passage)

    def _drop(self, car: Car | None, why: str, *, exists: bool = False) -> None:
        """Leave a vehicle alone; None: it was not watched."""
        if car is None:
            return
        del self._cars[car.name]
        self._begun.pop(car.name, None)
        for passage in [*car.passages]:
            self._end(passage, why)
        self._control.release(car, exists=exists)
