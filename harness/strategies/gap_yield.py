"""Gap-Yield: goes first through a gap that is long enough, yields smoothly otherwise."""

import math
from typing import ClassVar, NamedTuple

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Observation
from harness.strategies.driving import (
    CLEARANCE_M,
    COMFORTABLE_MPS2,
    ROUNDING,
    anybody_waits,
    can_stop_at_line,
    full_braking_distance,
    half_path,
    lane_free_in,
    resume,
    speeding_up,
    stop_after,
    stop_at_line,
    time_in_path,
)

ROLLING_MPS = 1.0
"""Slowest speed at which it rolls up to the edge; where it would be slower, it stops before."""


class GapYield:
    """Goes first where that leaves a gap, else yields smoothly; can always stop for a newcomer.

    *Gap.*  From now on each pedestrian on the crossing is in the ego's path (half its width plus
    0.25 m either side of its centre) from t_in on, and has left the ego's lane (disc and all) at
    t_free, at their present speed.  The ego, driving on, reaches the near edge at t_edge, and its
    rear bumper leaves their line (x = 0.25 m) at t_out.  Somebody is in the way if t_free > t_edge
    and the time advantage t_in − t_out is not above ``critical_gap_s``.  With nobody in the way it
    goes.  With the bumper over the near edge it has decided: then only those with t_in ≤ t_out are
    in the way.

    *Yielding.*  It reaches the near edge when the last one in the way has left its lane, with one
    constant deceleration 2 (s − v t_free)/t_free², s to the edge; where it would get there slower
    than 1 m/s it stops 1 m before the edge like Hard-Yield, and starts so as to be at the edge at
    t_free.  Since yielding makes it later, whoever it would have passed before may now be in the
    way too: all are looked at again until nobody is.

    *Approach.*  Nobody can be seen before they step off.  From the near kerb the path is a second
    away or less (1.1 m at the CCTC), while at v = 5 m/s the ego takes 1.5 s to get out of the way.
    So only stopping helps, and it has to help until the bumper is over the near edge: from there on
    nobody walks in front of the car any more (the rule at the kerb that holds in every scenario;
    ``kerb_wait_s`` is not relied on).  Therefore at every step that begins before the edge,
    R' − d(v') ≥ 0.35 m at its end: d(v') = v'²/2b + b step²/8 is what full braking takes on the
    time grid.  Held over one more step at the edge this allows v_e = b (sqrt(step² + 2 c/b) −
    step), c = width/2 − 0.35 m − b step²/8: 3.42 m/s with a 4 m crosswalk and b = 4.5 m/s².  It
    slows down to v_e with 3 m/s² and goes back to v0 with a0 from the edge on.

    *Limits.*  It trusts in constant walking speeds, except for the gap; it slows down for an empty
    crosswalk too, by 5 % of the time at the CCTC; someone who stands on the crossing outside its
    path is not waited for.  Where not even full braking stops it before x = −0.25 m it goes on.

    Sources: time advantage, Laureshyn, Svensson, Hydén 2010 (gaps under 1.5 s count as conflicts);
    the speed from which one can still stop, as in Krauss 1998 and the assured clear distance.

    Args:
        critical_gap_s: the time advantage above which it goes first, s; below 0 it also goes where
            it would be late.  Its aggressiveness is −critical_gap_s.
    """

    AGGRESSIVENESS: ClassVar = {"critical_gap_s": -1.0}  # a smaller gap is bolder

    def __init__(self, *, critical_gap_s: float = 1.5, yield_to_waiting: bool = False) -> None:
        self._critical_gap_s, self._yield_to_waiting = critical_gap_s, yield_to_waiting

    def decide(self, observation: Observation, /) -> float:
        """Wanted acceleration in m/s²."""
        go = _within_stopping(observation, resume(observation))
        if self._yield_to_waiting and anybody_waits(observation) and can_stop_at_line(observation):
            return min(go, stop_at_line(observation))
        people = _people(observation)
        if not people or observation.ego.range_m <= PEDESTRIAN_RADIUS_M + ROUNDING:
            return go
        until = _lane_free(observation, people, self._critical_gap_s)
        return go if until is None else min(go, _yield(observation, until, go))


class _Person(NamedTuple):
    """When someone comes into the ego's path and when they have left its lane, s from now."""

    enters_s: float
    frees_s: float


def _people(observation: Observation) -> list[_Person]:
    """Everyone on the crossing who is in the ego's lane or will be."""
    half = half_path(observation.vehicle)
    people = []
    for pedestrian in observation.pedestrians:
        if not pedestrian.on_crossing:
            continue
        enters, leaves = time_in_path(pedestrian, half)
        if pedestrian.speed_mps > 0:
            leaves = lane_free_in(observation, pedestrian)
        if leaves > 0 and enters < math.inf:
            people.append(_Person(enters, leaves))
    return people


def _lane_free(
    observation: Observation, people: list[_Person], critical_gap_s: float
) -> float | None:
    """In how many seconds to be at the near edge; None if nobody is in the way."""
    ego = observation.ego
    to_edge = _to_edge(observation)
    needed = critical_gap_s if to_edge > 0 else min(0.0, critical_gap_s)
    at_edge, speed = _run_up(observation, max(0.0, to_edge), ego.speed_mps)
    clear = at_edge + _passage(observation, min(0.0, to_edge), speed)
    until = None
    while True:
        # Whoever leaves within this step is as good as gone.
        patience = max(at_edge, observation.step_s)
        in_the_way = [
            person.frees_s
            for person in people
            if person.frees_s > patience and person.enters_s - clear <= needed
        ]
        if not in_the_way or until == math.inf:
            return until
        until = at_edge = max(in_the_way)
        clear = until + _passage(observation, 0.0, _arrival_speed(observation, until))


def _arrival_speed(observation: Observation, until_s: float) -> float:
    """Speed at the near edge when it gets there in ``until_s``, by rolling or after a stop."""
    ego, crossing = observation.ego, observation.crossing
    to_edge = max(0.0, _to_edge(observation))
    rolling = 2 * to_edge / until_s - ego.speed_mps
    if rolling >= ROLLING_MPS:
        return rolling
    start = min(to_edge, crossing.stop_line_m - crossing.width_m / 2)
    return math.sqrt(2 * observation.vehicle.resume_acceleration_mps2 * start)


def _yield(observation: Observation, until_s: float, go: float) -> float:
    """Be at the near edge in ``until_s``, or stop; ``go`` where neither is possible."""
    ego, step = observation.ego, observation.step_s
    limit = observation.vehicle.max_deceleration_mps2
    to_edge = _to_edge(observation)
    if ego.speed_mps <= ROUNDING:
        # It stands; a stop may leave 1e-17 m/s, which must not send it rolling.
        return 0.0
    if 2 * to_edge / until_s - ego.speed_mps >= ROLLING_MPS:
        rolling = 2 * (to_edge - ego.speed_mps * until_s) / until_s**2
        if rolling >= -limit:
            return rolling
    for stand_at in (observation.crossing.stop_line_m, CLEARANCE_M):
        distance = ego.range_m - stand_at
        if distance > 0 and ego.speed_mps**2 <= 2 * limit * distance:
            return max(-limit, stop_after(distance, ego.speed_mps, step))
    needed = full_braking_distance(ego.speed_mps, limit, step)
    can_stop = needed < ego.range_m - PEDESTRIAN_RADIUS_M
    return -min(limit, ego.speed_mps / step) if can_stop else go


def _within_stopping(observation: Observation, wanted: float) -> float:
    """``wanted``, or what leads to the edge's speed at the edge.

    v' after this step from v'² = v_e² + 2 a (s − (v + v') step/2), with a = 3 m/s² or the
    vehicle's maximum if that is less: being able to stop at the edge then means being able to stop
    at every step before.
    """
    speed, step = observation.ego.speed_mps, observation.step_s
    to_edge = _to_edge(observation)
    if to_edge <= 0:
        return wanted
    slowing = _slowing(observation)
    half, left = slowing * step / 2, to_edge - speed * step / 2
    squared = half**2 + _edge_speed(observation) ** 2 + 2 * slowing * left
    return min(wanted, (math.sqrt(max(0.0, squared)) - half - speed) / step)


def _to_edge(observation: Observation) -> float:
    """Distance to the near edge in m, negative once the bumper is over it."""
    distance = observation.ego.range_m - observation.crossing.width_m / 2
    return distance if abs(distance) > ROUNDING else 0.0


def _edge_speed(observation: Observation) -> float:
    """v_e: held over one more step at the near edge it still allows to stop."""
    limit, step = observation.vehicle.max_deceleration_mps2, observation.step_s
    room = observation.crossing.width_m / 2 - CLEARANCE_M - limit * step**2 / 8
    return limit * (math.sqrt(step**2 + 2 * max(0.0, room) / limit) - step)


def _slowing(observation: Observation) -> float:
    return min(COMFORTABLE_MPS2, observation.vehicle.max_deceleration_mps2)


def _run_up(observation: Observation, distance_m: float, speed_mps: float) -> tuple[float, float]:
    """(time to the near edge, speed there) of the free approach: a0, v0, then down to v_e."""
    vehicle, slowing, edge = observation.vehicle, _slowing(observation), _edge_speed(observation)
    a0, top = vehicle.resume_acceleration_mps2, vehicle.initial_speed_mps
    # Squared speed from which slowing down has to begin at this distance.
    on_curve = edge**2 + 2 * slowing * distance_m
    if speed_mps**2 >= on_curve:
        return 2 * distance_m / (speed_mps + edge) if distance_m > 0 else 0.0, edge
    # Where a0 would meet that curve.
    run = (on_curve - speed_mps**2) / (2 * (a0 + slowing))
    if top <= edge or run >= distance_m:
        return speeding_up(observation, distance_m, speed_mps)
    peak = min(math.sqrt(speed_mps**2 + 2 * a0 * run), top)
    ramps = (peak**2 - speed_mps**2) / (2 * a0) + (peak**2 - edge**2) / (2 * slowing)
    return (peak - speed_mps) / a0 + (peak - edge) / slowing + (distance_m - ramps) / peak, edge


def _passage(observation: Observation, to_edge_m: float, speed_mps: float) -> float:
    """Time from the near edge, or ``to_edge_m`` ≤ 0 past it, until the rear is past x = 0.25 m."""
    length, width = observation.vehicle.length_m, observation.crossing.width_m
    distance = width / 2 + to_edge_m + length + PEDESTRIAN_RADIUS_M
    return speeding_up(observation, distance, speed_mps)[0]
