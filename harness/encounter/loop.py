"""The simulation of one episode: a strategy and an engine in, a trace out.

This loop takes most of a run's time.  Contacts and measures are computed afterwards from the
trace; the loop records only what cannot be computed later.
"""

import math
from collections.abc import Generator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from harness.core.actuation import Actuator
from harness.core.errors import EngineError, StrategyError
from harness.core.vocabulary import (
    ROUNDING,
    Arrival,
    Ending,
    Observation,
    Strategy,
    Trace,
    Vehicle,
    Views,
)
from harness.encounter.cell_constants import CellConstants
from harness.encounter.crowd import Crowd
from harness.encounter.deciding import KerbLane
from harness.encounter.driver import Driver, answer_of, attribute_of
from harness.encounter.walkers import ChooseSpeed
from harness.engine.protocol import Engine

if TYPE_CHECKING:
    from harness.strategies.perception.encounter_view import Perception

Steps = Generator[Observation, object, Ending]
"""An episode as a generator: it yields observations and receives the answers of a strategy."""


def drive(episode: "Episode", strategy: Strategy) -> Trace:
    """Simulate an episode from the trigger until the ego has passed or the time is up.

    Args:
        episode: a new episode.
        strategy: a new strategy object.

    Returns:
        The trace.  It continues after a contact, until the ego has passed; ``measures`` ends the
        record at the contact.  An error of engine or strategy ends it as ``failed``.
    """
    try:
        ending = _driven(episode.steps(), strategy)
        trace = episode.trace(ending, episode.engine.end())
    except (EngineError, StrategyError) as error:
        trace = failed(episode.trace(Ending.TIMED_OUT), error)
    try:
        fallback = attribute_of(strategy, "fallback")
    except StrategyError as error:
        return failed(trace, error)
    return replace(trace, fallback=True) if fallback else trace


def failed(trace: Trace, error: EngineError | StrategyError) -> Trace:
    """The trace of an episode that an error ended."""
    if isinstance(error, StrategyError):
        trace = replace(trace, failed_in="strategy", traceback=error.traceback)
    else:
        trace = replace(trace, failed_in="engine")
    return replace(trace, ending=Ending.FAILED, reason=str(error))


def _driven(steps: Steps, strategy: Strategy) -> Ending:
    """Answer every observation of an episode with the strategy's command."""
    observation = next(steps)
    try:
        while True:
            observation = steps.send(answer_of(strategy, observation))
    except StopIteration as finished:
        ending: Ending = finished.value
        return ending


class _Ego:
    """The ego in its last recorded state, as pedestrians see it."""

    begun, passed, passed_at_m = True, False, math.inf

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.at(0.0, 0.0, 0.0)

    def at(self, x_m: float, speed_mps: float, acceleration_mps2: float) -> None:
        """Record the ego's state at the beginning of a step."""
        self.x_m, self.speed_mps, self.acceleration_mps2 = x_m, speed_mps, acceleration_mps2


class Episode:
    """One running episode, whose driver answers the observations of ``steps``.

    ``x_m`` and ``speed_mps`` hold the ego's states so far, ``crowd`` the pedestrians, and
    ``places`` (index, y in m) of all pedestrians who were at the crosswalk at the end of the last
    step.

    Args:
        engine: an engine bound to the same vehicle, crossing and step as ``rules``.
        arrivals: all pedestrians who may arrive, by arrival time (s from the trigger, ≥ 0).
        choose_speed: returns the walking speed of a pedestrian who steps off, given what they see.
        rules: the cell's constants.
        perception: a new object with the driver's perception; None: the driver sees the ground
            truth within the detection range.
    """

    def __init__(
        self,
        engine: Engine,
        arrivals: Sequence[Arrival],
        choose_speed: ChooseSpeed,
        rules: CellConstants,
        perception: "Perception | None" = None,
    ) -> None:
        self.engine, self.rules, self.perception = engine, rules, perception
        self._arrivals, self._ego, road = arrivals, _Ego(rules.vehicle), rules.crossing
        lane = KerbLane(road.lane_centre_m, road.lane_width_m, road.length_m)
        lane.coming = [self._ego]
        self.crowd = Crowd(arrivals, [lane], choose_speed, rules, engine.remove, look_back=True)
        self.x_m: list[float] = []
        self.speed_mps: list[float] = []
        self.places: list[tuple[int, float]] = []
        sensor = None if perception is None else self._perceived
        self._driver = Driver(rules, rules.step_s, self.crowd.views, sensor)

    def _perceived(self, near: bool) -> Views:
        assert self.perception is not None
        return self.perception.shown(near, self.x_m[-1], self.crowd.views())

    def trace(self, ending: Ending, sumo_collision: bool | None = None) -> Trace:
        """The trace of what has been simulated so far, as if it ended now."""
        return Trace(
            vehicle=self.rules.vehicle,
            crossing=self.rules.crossing,
            step_s=self.rules.step_s,
            x_m=np.array(self.x_m),
            speed_mps=np.array(self.speed_mps),
            walks=tuple(walker.walk for walker in self.crowd.came),
            ending=ending,
            sumo_collision=sumo_collision,
            shown=self._driver.shown,
        )

    def steps(self) -> Steps:
        """Simulate step by step.

        It yields the observation of each step, receives the commanded acceleration in m/s² and
        returns the ending.

        Raises:
            EngineError: the engine failed.
            StrategyError: the command is not a number.
        """
        rules, engine = self.rules, self.engine
        vehicle, crossing, step_s = rules.vehicle, rules.crossing, rules.step_s
        passed_at_m = vehicle.length_m + crossing.width_m / 2 - ROUNDING
        steps = math.ceil(rules.timeout_s / step_s - ROUNDING)
        note_x, note_speed = self.x_m.append, self.speed_mps.append
        crowd, ego, driver = self.crowd, self._ego, self._driver
        walkers = crowd.walkers
        gain_mps2 = 0.0
        x_m, speed_mps = engine.begin(self._arrivals)
        note_x(x_m)
        note_speed(speed_mps)
        ego.at(x_m, speed_mps, 0.0)
        actuator = Actuator(vehicle, step_s, speed_mps)
        crowd.advance(0.0, 0.0)
        then_s = 0.0
        for n in range(1, steps + 1):
            now_s, then_s = then_s, n * step_s
            for walker in walkers:
                if walker.due_s <= now_s:
                    ego.at(x_m, speed_mps, gain_mps2)
                    crowd.begin_step(now_s)
                    break
            answer = yield driver.observe(now_s, -x_m, speed_mps, gain_mps2)
            target_mps = actuator.speed_after(driver.command(answer, now_s), speed_mps)
            gain_mps2 = (target_mps - speed_mps) / step_s
            # Pedestrians who arrive within this step see the ego's state at their arrival.
            if crowd.next_s <= then_s:
                ego.at(x_m, speed_mps, gain_mps2)
                crowd.advance(now_s, then_s)
            # As ``crowd.walk_until``; a call and a comprehension would take longer here.
            self.places = places = []
            for walker in walkers:
                places.append((walker.index, walker.walk_until(then_s)))
            x_m, speed_mps = engine.step(target_mps, places), target_mps
            note_x(x_m)
            note_speed(speed_mps)
            if x_m >= passed_at_m:
                return Ending.CROSSED
        return Ending.TIMED_OUT
