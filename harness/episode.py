"""Runs one episode: a strategy, an engine, and pedestrians who look once and walk.

This is the loop everything else waits for.  Contacts and measures are found afterwards, from
the trace; the loop only keeps what cannot be worked out later.
"""

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np

from harness.encounter import (
    Arrival,
    Crossing,
    EgoView,
    Ending,
    Observation,
    PedestrianView,
    Side,
    Strategy,
    Trace,
    Vehicle,
    Walk,
)
from harness.engine.protocol import Engine
from harness.errors import EngineError, StrategyError, place_of

ROUNDING_M = 1e-9
"""An ego this near a threshold is on it: engines differ in the last bits of their sums."""

ChooseSpeed = Callable[[Arrival, float, float], float]
"""(who, range_m, vehicle_speed_mps) → walking speed in m/s, > 0."""

Steps = Generator[Observation, float | None, Ending]
"""An episode from the driver's side: observations out, wanted accelerations in."""


@dataclass(frozen=True, slots=True)
class Rules:
    """What is the same in all episodes of a cell.

    ``kerb_wait_s``: nobody steps off while the ego, at its present speed, would reach the near
    edge within that time, or while its body overlaps the crosswalk.
    """

    vehicle: Vehicle
    crossing: Crossing
    kerb_wait_s: float
    step_s: float
    timeout_s: float


class _Walker:
    """One pedestrian while he is at the crosswalk.

    ``due_s`` is when he needs attention: always while he waits, then when he reaches the kerb.
    """

    __slots__ = (
        "_direction",
        "_kerb",
        "_length",
        "_progress",
        "_speed",
        "_start",
        "_to_lane",
        "due_s",
        "index",
        "side",
        "walk",
    )

    def __init__(self, walk: Walk, crossing: Crossing) -> None:
        self.walk = walk
        self.index, self.side = walk.arrival.index, walk.arrival.side
        self.due_s = -math.inf
        self._start, self._speed, self._progress = 0.0, 0.0, 0.0
        self._length = crossing.length_m
        near = self.side is Side.NEAR
        self._kerb, self._direction = (0.0, 1.0) if near else (crossing.length_m, -1.0)
        lane = crossing.lane_centre_m
        self._to_lane = lane if near else crossing.length_m - lane

    def step_off(self, time_s: float, speed_mps: float, state: tuple[float, float]) -> None:
        self._start, self._speed = time_s, speed_mps
        self.walk.start_s, self.walk.speed_mps = time_s, speed_mps
        self.walk.range_m, self.walk.vehicle_speed_mps = state
        self.due_s = time_s + self._length / speed_mps

    def walk_until(self, time_s: float) -> float:
        """Move on to that time; returns y.  One who waits has no speed yet."""
        progress = self._speed * (time_s - self._start)
        self._progress = progress if progress < self._length else self._length
        return self._kerb + self._direction * self._progress

    def view(self) -> PedestrianView:
        return PedestrianView(
            self.index,
            self.side,
            self._to_lane - self._progress,
            self._length - self._progress,
            self._speed,
            self._speed > 0,
        )


def run_episode(
    engine: Engine,
    strategy: Strategy,
    arrivals: Sequence[Arrival],
    choose_speed: ChooseSpeed,
    rules: Rules,
) -> Trace:
    """Simulate one episode from the trigger until the ego has passed or the time is up.

    Args:
        engine: an engine bound to the same vehicle, crossing and step as ``rules``.
        strategy: a fresh strategy object.
        arrivals: everyone who may come, by arrival time (s from the trigger, ≥ 0).
        choose_speed: the walking speed of someone who steps off, given what he sees.
        rules: the cell's constants.

    Returns:
        The trace.  It goes on past a contact, until the body has passed; ``measures`` ends the
        record there.  An error of engine or strategy ends it as ``engine_failed``.
    """
    episode = Episode(engine, arrivals, choose_speed, rules)
    reason, traceback, collided = None, None, None
    try:
        ending = _drive(episode.steps(), strategy)
        collided = engine.end()
    except EngineError as error:
        ending, reason = Ending.ENGINE_FAILED, str(error)
        traceback = error.traceback if isinstance(error, StrategyError) else None
    return episode.trace(
        ending,
        reason=reason,
        sumo_collision=collided,
        fallback=bool(getattr(strategy, "fallback", False)),
        traceback=traceback,
    )


def failed_episode(error: StrategyError, rules: Rules) -> Trace:
    """The trace of an episode whose strategy could not even be made."""
    return Trace(
        vehicle=rules.vehicle,
        crossing=rules.crossing,
        step_s=rules.step_s,
        x_m=np.array([]),
        speed_mps=np.array([]),
        walks=(),
        ending=Ending.ENGINE_FAILED,
        reason=str(error),
        sumo_collision=None,
        fallback=False,
        traceback=error.traceback,
    )


def _drive(steps: Steps, strategy: Strategy) -> Ending:
    """Answer every observation of an episode with the strategy's command."""
    decide = strategy.decide
    observation = next(steps)
    try:
        while True:
            try:
                wanted = decide(observation)
            except Exception as error:
                what = f"raised {type(error).__name__}: {error}"
                when = f"at t = {observation.time_s:.3f} s ({place_of(error)})"
                raise StrategyError(f"the strategy {what} {when}", error) from error
            observation = steps.send(wanted)
    except StopIteration as finished:
        ending: Ending = finished.value
        return ending


class Episode:
    """One running episode: who drives it answers the observations of ``steps``.

    Arguments as of ``run_episode``.  ``x_m`` and ``speed_mps`` hold the ego's states so far,
    ``walks`` everyone who has arrived, ``places`` (index, y in m) of everyone who was at the
    crosswalk at the end of the last step.
    """

    def __init__(
        self,
        engine: Engine,
        arrivals: Sequence[Arrival],
        choose_speed: ChooseSpeed,
        rules: Rules,
    ) -> None:
        self.engine, self.rules = engine, rules
        self.arrivals, self.choose_speed = arrivals, choose_speed
        self.next_arrival = 0
        self.walkers: list[_Walker] = []
        self.walks: list[Walk] = []
        self.x_m: list[float] = []
        self.speed_mps: list[float] = []
        self.places: list[tuple[int, float]] = []

    def trace(
        self,
        ending: Ending,
        *,
        reason: str | None = None,
        sumo_collision: bool | None = None,
        fallback: bool = False,
        traceback: str | None = None,
    ) -> Trace:
        """What has been simulated so far, as of an engine that left off like this."""
        return Trace(
            vehicle=self.rules.vehicle,
            crossing=self.rules.crossing,
            step_s=self.rules.step_s,
            x_m=np.array(self.x_m),
            speed_mps=np.array(self.speed_mps),
            walks=tuple(self.walks),
            ending=ending,
            reason=reason,
            sumo_collision=sumo_collision,
            fallback=fallback,
            traceback=traceback,
        )

    def steps(self) -> Steps:
        """Simulate step by step.

        Yields what a strategy sees at each step and takes the wanted acceleration in m/s² (None:
        the engine's own driver); returns how the engine left off.

        Raises:
            EngineError: the engine lost the episode, or the answer is no acceleration.
        """
        rules, engine = self.rules, self.engine
        vehicle, crossing, step = rules.vehicle, rules.crossing, rules.step_s
        detection = vehicle.detection_range_m + ROUNDING_M
        passed_at = vehicle.length_m + crossing.width_m / 2 - ROUNDING_M
        steps = math.ceil(rules.timeout_s / step - 1e-9)
        note_x, note_speed = self.x_m.append, self.speed_mps.append
        walkers = self.walkers
        acceleration = 0.0
        x, speed = engine.begin(self.arrivals)
        note_x(x)
        note_speed(speed)
        next_arrival_s = self._admit(0.0, 0.0, x, speed, 0.0)
        for n in range(steps):
            now, then = n * step, (n + 1) * step
            for walker in walkers:
                if walker.due_s <= now:
                    self._update_walkers(now, -x, speed)
                    break
            seen: tuple[PedestrianView, ...] = ()
            if walkers and abs(x) <= detection:
                seen = tuple([walker.view() for walker in walkers])
            view = EgoView(-x, speed, acceleration)
            wanted = yield Observation(now, step, view, vehicle, crossing, seen)
            target = None
            if wanted is not None:
                wanted = self._limited(wanted, now)
                target = speed + wanted * step
                if target < 0:
                    target = 0.0
                acceleration = (target - speed) / step
            # Those who arrive within this step see the ego where it is at that very moment.
            if next_arrival_s <= then:
                next_arrival_s = self._admit(now, then, x, speed, acceleration)
            self.places = places = [(w.index, w.walk_until(then)) for w in walkers]
            x, after = engine.step(target, places)
            if after != target:
                acceleration = (after - speed) / step
            speed = after
            note_x(x)
            note_speed(speed)
            if x >= passed_at:
                return Ending.CROSSED
        return Ending.TIMED_OUT

    def _limited(self, answer: float, now: float) -> float:
        """A command within the vehicle's limits."""
        vehicle = self.rules.vehicle
        wanted = answer if type(answer) is float else _as_float(answer)
        if wanted > vehicle.max_acceleration_mps2:
            return vehicle.max_acceleration_mps2
        if wanted < -vehicle.max_deceleration_mps2:
            return -vehicle.max_deceleration_mps2
        if wanted == wanted:
            return wanted
        raise StrategyError(f"the strategy returned {answer!r} at t = {now:.3f} s")

    def _update_walkers(self, now: float, range_m: float, speed: float) -> None:
        """Those who wait look again; those who have reached the other kerb leave."""
        for walker in tuple(self.walkers):
            if walker.walk.start_s is None:
                self._look(walker, now, range_m, speed)
            elif walker.due_s <= now:
                self.walkers.remove(walker)
                self.engine.remove(walker.index)

    def _admit(
        self, now: float, until: float, x: float, speed: float, acceleration: float
    ) -> float:
        """Everyone who arrives in (now, until] reaches the kerb and looks; returns who is next."""
        while self.next_arrival < len(self.arrivals):
            arrival = self.arrivals[self.next_arrival]
            if arrival.arrival_s > until:
                return arrival.arrival_s
            self.next_arrival += 1
            walk = Walk(arrival)
            walker = _Walker(walk, self.rules.crossing)
            self.walks.append(walk)
            self.walkers.append(walker)
            elapsed = arrival.arrival_s - now
            range_then = -(x + speed * elapsed + acceleration * elapsed**2 / 2)
            self._look(walker, arrival.arrival_s, range_then, speed + acceleration * elapsed)
        return math.inf

    def _look(self, walker: _Walker, time_s: float, range_m: float, speed: float) -> None:
        """Kerb rule: step off now, or wait for the next step."""
        rules = self.rules
        to_edge = range_m - rules.crossing.width_m / 2
        if to_edge <= speed * rules.kerb_wait_s + ROUNDING_M:
            return
        walking_speed = self.choose_speed(walker.walk.arrival, range_m, speed)
        walker.step_off(time_s, walking_speed, (range_m, speed))


def _as_float(answer: object) -> float:
    """A command that is another kind of number, as numpy's; NaN for what is none."""
    return float(answer) if isinstance(answer, Real) else math.nan
