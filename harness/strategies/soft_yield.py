"""Soft-Yield, the automated vehicle of the paper (Schroeder et al. 2014)."""

import math
from typing import ClassVar, NamedTuple

from harness.core.vocabulary import ROUNDING, Observation, PedestrianView
from harness.strategies.hard_yield import HardYield
from harness.strategies.manoeuvres import clearing_time_s, towards_v0


class _Plan(NamedTuple):
    """Decelerate until ``decelerate_until_s``, then coast to x = 0 at ``arrival_s``."""

    acceleration_mps2: float
    decelerate_until_s: float
    arrival_s: float


class SoftYield:
    """Decelerates for T1 and then coasts, so that it reaches x = 0 as the pedestrian leaves.

    It plans with the state (v, R) at the moment at which it perceives a pedestrian:
    a = p1 + p2 v + p3 R (paper, section III-C) and
    T1 = t_x − sqrt(t_x² − 2 (R − v t_x) / a), with t_x = remaining distance / v_p + time_margin_s.
    If R ≥ v t_x, the pedestrian clears first and it keeps its speed.  With several pedestrians it
    plans for the last to leave, and plans again when another pedestrian becomes the last.  With a
    positive margin it follows the plan until t_x, after the pedestrian has left.  The paper's
    strategy has no margin; here its aggressiveness (paper, figure 1) is −time_margin_s.

    *Limits.*  It makes one plan for each walk and keeps it if the pedestrian's speed changes.

    *No valid plan.*  A plan is not valid if the pedestrian stands, if a ≥ 0, if the root is of a
    negative number, if the speed would fall below zero within T1, or if a exceeds the vehicle's
    maximum deceleration.  Then Hard-Yield drives, which has no margin, and ``fallback`` is set.  At
    R = 30 m and v = 5 m/s there is no plan if t_x exceeds 9.2246 s.  Without a margin this happens
    for v_p below 0.97565 m/s, and with a margin m for v_p below 9 m / (9.2246 s − m).

    Args:
        p1: constant of the regression, m/s².
        p2: coefficient of the speed, 1/s.
        p3: coefficient of the range, 1/s².
        time_margin_s: time in s from the pedestrian's leaving to the ego's arrival at x = 0; if
            negative, the ego arrives first.
    """

    AGGRESSIVENESS: ClassVar = {"time_margin_s": -1.0}  # a smaller margin is bolder
    FALLBACK: ClassVar = "hard_yield"

    def __init__(
        self,
        *,
        p1: float = 0.0169,
        p2: float = -0.13986,
        p3: float = 0.010115,
        time_margin_s: float = 0.0,
    ) -> None:
        self._p1, self._p2, self._p3 = p1, p2, p3
        self._margin_s = time_margin_s
        self.fallback = False
        self._target: int | None = None
        self._plan: _Plan | None = None
        self._hard_yield = HardYield()

    def decide(self, observation: Observation, /) -> float:
        """Commanded acceleration in m/s²."""
        last, before = _last_to_leave(observation.pedestrians), observation.ego.range_m > 0
        if last is None or not before:
            waits = before and self._margin_s > 0 and self._target is not None
            if waits and self._plan is not None and observation.time_s < self._plan.arrival_s:
                # The last pedestrian has left, but the planned arrival is still ahead.
                return _follow(self._plan, observation)
            self._target = None
            return towards_v0(observation)
        if last.index != self._target:
            self._target = last.index
            self._plan = self._make_plan(observation, clearing_time_s(last) + self._margin_s)
            self._hard_yield = HardYield()
            self.fallback = self.fallback or self._plan is None
        if self._plan is None:
            return self._hard_yield.decide(observation)
        return _follow(self._plan, observation)

    def _make_plan(self, observation: Observation, until_s: float) -> _Plan | None:
        """The plan to reach x = 0 in ``until_s``; None if there is none."""
        now_s, ego = observation.time_s, observation.ego
        if not math.isfinite(until_s):
            return None  # a pedestrian stands
        shortfall_m = ego.range_m - ego.speed_mps * until_s
        if shortfall_m >= 0:
            return _Plan(0.0, now_s, now_s + until_s)
        a_mps2 = self._p1 + self._p2 * ego.speed_mps + self._p3 * ego.range_m
        if a_mps2 >= 0 or -a_mps2 > observation.vehicle.max_deceleration_mps2:
            return None
        discriminant = until_s * until_s - 2 * shortfall_m / a_mps2
        # The discriminant is NaN if the margin is extremely large.
        if not discriminant >= 0:
            return None
        t1_s = until_s - math.sqrt(discriminant)
        if ego.speed_mps + a_mps2 * t1_s < 0:
            return None
        return _Plan(a_mps2, now_s + t1_s, now_s + until_s)


def _follow(plan: _Plan, observation: Observation) -> float:
    """The acceleration that follows a plan on the time grid; its pass time is within 1e-3 s."""
    now_s, step_s = observation.time_s, observation.step_s
    if plan.acceleration_mps2 == 0:
        return 0.0
    if plan.decelerate_until_s - now_s >= step_s:
        return plan.acceleration_mps2
    range_m, speed_mps = observation.ego.range_m, observation.ego.speed_mps
    until_arrival_s = plan.arrival_s - now_s
    if plan.decelerate_until_s > now_s:
        if until_arrival_s <= step_s:
            return 2 * (range_m - speed_mps * until_arrival_s) / until_arrival_s**2
        return (_coasting_mps(observation, until_arrival_s) - speed_mps) / step_s
    if until_arrival_s < -ROUNDING:
        return towards_v0(observation)
    if until_arrival_s <= step_s:
        # It arrives within this step; the gain at a0 from then on is spread over the whole step.
        return _gain_mps(observation, step_s - until_arrival_s, speed_mps) / step_s
    return 0.0


def _coasting_mps(observation: Observation, until_arrival_s: float) -> float:
    """The speed that it needs at the end of the step in which T1 ends to arrive on time.

    If it held ``a`` to the end of the step, it would arrive up to 34 ms late.  The formula includes
    the distance that the ego gains in the step of the arrival before it arrives.
    """
    ego, step_s = observation.ego, observation.step_s
    before_s = math.fmod(until_arrival_s, step_s) or step_s
    share_s = before_s**2 / (2 * step_s)
    distance_m = ego.range_m - ego.speed_mps * step_s / 2
    duration_s = until_arrival_s - step_s / 2
    initial_mps = observation.vehicle.initial_speed_mps
    gain_mps = observation.vehicle.resume_acceleration_mps2 * (step_s - before_s)
    coasting_mps = (distance_m - gain_mps * share_s) / duration_s
    if coasting_mps + gain_mps > initial_mps:
        coasting_mps = (distance_m - initial_mps * share_s) / (duration_s - share_s)
    return coasting_mps


def _gain_mps(observation: Observation, duration_s: float, speed_mps: float) -> float:
    """Speed gained in a time at a0, up to v0."""
    vehicle = observation.vehicle
    return min(vehicle.resume_acceleration_mps2 * duration_s, vehicle.initial_speed_mps - speed_mps)


def _last_to_leave(pedestrians: tuple[PedestrianView, ...]) -> PedestrianView | None:
    last, cleared_s = None, -math.inf
    for pedestrian in pedestrians:
        if pedestrian.on_crossing and (needed_s := clearing_time_s(pedestrian)) > cleared_s:
            last, cleared_s = pedestrian, needed_s
    return last
