"""The driven vehicles of a simulation in; the speeds that SUMO is given out.

The lowest of three speeds applies: the strategy's, that of lanes and curves ahead, and SUMO's for
leaders and junctions.  ``LIMITED_BY`` names what limited a step; each driven step is counted.  SUMO
does not mind people at the crosswalks that a strategy has taken over; elsewhere it drives as ever.
docs/method.md has the rules ("Who drives").
"""

import math
from collections.abc import Mapping

from harness.core.actuation import CUT_MPS, Actuator
from harness.core.errors import StrategyError
from harness.core.vocabulary import ACTUATOR, LANE, LEADER, RIGHT_OF_WAY, STRATEGY, Strategy
from harness.encounter.driver import Driver, answer_of
from harness.engine.plain import slowing_mps
from harness.engine.protocol import Running
from harness.simulation.cars import Car, Driven, Passage
from harness.simulation.people_at import PeopleAt
from harness.simulation.setup import Setup
from harness.site.town import Crosswalk

_ROUNDING_MPS = 1e-3
"""Differences of speed below this are rounding."""


class Control:
    """Gives SUMO the speeds of the vehicles that strategies drive.

    Args:
        session: SUMO.
        setup: says how vehicles move within a step.
        people: everybody at each crosswalk.
    """

    def __init__(self, session: Running, setup: Setup, people: Mapping[str, PeopleAt]) -> None:
        self._session, self._vehicles = session, session.vehicles
        self._ballistic = setup.config.ballistic
        self._step_s, self._people = session.step_s, people
        self._driven: dict[str, tuple[Car, Driven]] = {}

    def update(self, car: Car) -> None:
        """Drive a vehicle, or give it back to SUMO, after its passages have changed."""
        passages, driven = [each for each in car.passages if each.strategy is not None], car.driven
        if not passages:
            self.release(car)
            return
        if driven is None:
            vehicle, gain_mps2 = car.facts.vehicle, car.acceleration_mps2
            obeyed = car.speed_mps, gain_mps2, vehicle.within_limits(gain_mps2)
            car.driven = driven = Driven(Actuator(vehicle, self._step_s, *obeyed))
            self._driven[car.name] = car, driven
        self._ignore(car)
        end_m = max(each.at.last_m for each in passages)
        ahead = (each for each in car.ahead.links if car.odometer_m < each.end_m)
        yields = any(each.yields and each.begin_m < end_m for each in ahead)
        if yields != driven.yields:
            driven.yields = yields
            self._session.let_yield(car.name, yields)

    def ignore_at(self, crosswalk: Crosswalk) -> None:
        """Let SUMO not mind those who are at a crosswalk now."""
        for car, _ in self._driven.values():
            if any(each.at.crosswalk is crosswalk for each in car.passages):
                self._ignore(car)

    def _ignore(self, car: Car) -> None:
        """Let SUMO not mind those who are at the crosswalks for which a strategy decides."""
        driven = (each.at.crosswalk.id for each in car.passages if each.strategy is not None)
        self._session.ignore(car.name, [name for at in driven for name in self._people[at].names()])

    def release(self, car: Car, *, exists: bool = True) -> None:
        """Give a vehicle back to SUMO."""
        if self._driven.pop(car.name, None) is None:
            return
        car.driven = None
        if exists:
            self._session.release(car.name)

    def command(self, now_s: float) -> None:
        """Let every strategy decide, and give SUMO the lowest command for each vehicle."""
        for car, driven in self._driven.values():
            lowest = math.inf
            for passage in car.passages:
                strategy, driver = passage.strategy, passage.driven_by
                if strategy is not None and driver is not None:
                    try:
                        lowest = min(lowest, self._decision(passage, strategy, driver))
                    except StrategyError as error:
                        where = f"vehicle {car.name} at {passage.at.crosswalk.id}, {now_s:.3f} s"
                        raise error.at(where) from error
            wish_mps = max(0.0, car.speed_mps + lowest * self._step_s)
            target_mps = driven.actuator.speed_after(lowest, car.speed_mps)
            driven.limited_by = STRATEGY if abs(target_mps - wish_mps) <= CUT_MPS else ACTUATOR
            if target_mps > car.ahead.least_mps:
                cap_mps = self._cap_mps(car)
                if cap_mps < target_mps - CUT_MPS:
                    driven.limited_by = LANE
                target_mps = min(target_mps, cap_mps)
            # SUMO keeps a command until the next one.
            if driven.asked_mps != target_mps:
                driven.asked_mps = target_mps
                self._vehicles.set_speed(car.name, target_mps)

    def check(self, car: Car, driven: Driven, before_mps: float) -> None:
        """Count what limited a step that has been read.

        Args:
            car: the vehicle.
            driven: what was commanded.
            before_mps: the speed before the step.
        """
        record, limited_by = car.record, driven.limited_by
        if car.speed_mps < driven.asked_mps - _ROUNDING_MPS:
            # What holds a standing vehicle is not asked for again.
            if record.held_by is None or before_mps > _ROUNDING_MPS:
                decel_mps2 = car.facts.vehicle.max_deceleration_mps2
                follows = self._session.follows(car.name, before_mps, decel_mps2)
                record.held_by = LEADER if follows else RIGHT_OF_WAY
            limited_by = record.held_by
        else:
            record.held_by = None
        record.limited[limited_by] += 1

    def _decision(self, passage: Passage, strategy: Strategy, driver: Driver) -> float:
        """The acceleration that a strategy commands."""
        car = passage.car
        range_m = passage.at.centre_m - car.odometer_m
        time_s = (len(car.record.speeds_mps) - 1 - passage.first) * self._step_s
        seen = driver.observe(time_s, range_m, car.speed_mps, car.acceleration_mps2)
        return driver.command(answer_of(strategy, seen), time_s)

    def _cap_mps(self, car: Car) -> float:
        """The highest speed at the step's end that lanes and curves allow."""
        cap_mps, decel = math.inf, car.facts.vehicle.max_deceleration_mps2
        for at_m, limit_mps in car.ahead.limits:
            ahead_m = at_m - car.odometer_m
            if ahead_m <= 0.0:
                cap_mps = limit_mps
            elif limit_mps < cap_mps:
                slowing = slowing_mps(
                    car.speed_mps, limit_mps, ahead_m, decel, self._step_s, self._ballistic
                )
                cap_mps = min(cap_mps, slowing)
        return max(cap_mps, car.speed_mps - decel * self._step_s)
