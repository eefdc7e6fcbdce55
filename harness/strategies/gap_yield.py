"""Gap-Yield: a strategy that goes first if the gap is long enough and otherwise yields smoothly."""

import math
from typing import ClassVar, NamedTuple

from harness.core.vocabulary import PEDESTRIAN_RADIUS_M, ROUNDING, Observation
from harness.strategies.manoeuvres import (
    CLEARANCE_M,
    COMFORTABLE_MPS2,
    anybody_waits,
    can_stop_at_line,
    can_stop_before_disc,
    full_braking,
    half_path_width_m,
    lane_free_in_s,
    speeding_up,
    stop_at,
    stop_at_line,
    time_in_path,
    towards_v0,
)

ROLLING_MPS = 1.0
"""Least speed for rolling up to the edge; if the ego would be slower, it stops before the edge."""


class GapYield:
    """Goes first if the gap is long enough, otherwise yields smoothly, and can always stop.

    *Gap.*  At their present speed each pedestrian on the crossing enters the ego's path (half its
    width plus 0.25 m on either side of its centre) at t_in, and their disc has left the ego's lane
    at t_free.  An ego that drives on reaches the near edge at t_edge, and its rear bumper leaves
    their line (x = 0.25 m) at t_out.  A pedestrian is in the way if t_free > t_edge and the time
    advantage t_in − t_out is not above ``critical_gap_s``.  If nobody is in the way, the ego drives
    on.  Once its bumper is over the near edge, only pedestrians with t_in ≤ t_out are in the way.

    *Yielding.*  It reaches the near edge when the last pedestrian in the way has left its lane,
    with one constant deceleration 2 (s − v t_free)/t_free², where s is the distance to the edge.
    If it would get there slower than 1 m/s it stops 1 m before the edge like Hard-Yield, and starts
    so that it is at the edge at t_free.  Yielding delays it, so pedestrians whom it would have
    passed first may now be in the way too: it checks all of them again until nobody is.

    *Approach.*  It cannot detect pedestrians before they step off.  From the near kerb they reach
    its path within one second (1.1 m at the CCTC), but at v = 5 m/s it takes 1.5 s to clear the
    crosswalk.  So it must be able to stop until its bumper is over the near edge.  From there on
    nobody steps off in front of it (the kerb rule of every scenario, whatever ``kerb_wait_s`` is).
    Therefore at the end of every step that begins before the edge, R' − d(v') ≥ 0.35 m, where
    d(v') = v'²/2b + b step²/8 is the distance of full braking on the time grid.  Applied to one
    more step at the edge, this allows v_e = b (sqrt(step² + 2 c/b) − step) with
    c = width/2 − 0.35 m − b step²/8: 3.42 m/s for a 4 m crosswalk and b = 4.5 m/s².  It slows down
    to v_e with 3 m/s² and returns to v0 with a0 from the edge on.

    *Limits.*  Apart from the gap it relies on constant walking speeds.  It slows down for an empty
    crosswalk too, which takes 5 % of the time at the CCTC.  It does not wait for a pedestrian who
    stands on the crossing outside its path.  If not even full braking stops it before x = −0.25 m,
    it drives on.

    Sources: time advantage, Laureshyn, Svensson, Hydén 2010 (gaps under 1.5 s count as conflicts);
    the speed from which a vehicle can still stop, as in Krauss 1998 and the assured clear distance.

    Args:
        critical_gap_s: the time advantage above which it goes first, s; if negative, it also goes
            first if it would arrive second.  Its aggressiveness is −critical_gap_s.
        yield_to_waiting: also stop for pedestrians who wait at a kerb, if 3 m/s² are enough.
    """

    AGGRESSIVENESS: ClassVar = {"critical_gap_s": -1.0}  # a smaller gap is bolder

    def __init__(self, *, critical_gap_s: float = 1.5, yield_to_waiting: bool = False) -> None:
        self._critical_gap_s, self._yield_to_waiting = critical_gap_s, yield_to_waiting

    def decide(self, observation: Observation, /) -> float:
        """Commanded acceleration in m/s²."""
        go_mps2 = _within_stopping(observation, towards_v0(observation))
        if self._yield_to_waiting and anybody_waits(observation) and can_stop_at_line(observation):
            return min(go_mps2, stop_at_line(observation))
        people = _people(observation)
        if not people or observation.ego.range_m <= PEDESTRIAN_RADIUS_M + ROUNDING:
            return go_mps2
        until_s = _lane_free_s(observation, people, self._critical_gap_s)
        return go_mps2 if until_s is None else min(go_mps2, _yield(observation, until_s, go_mps2))


class _Person(NamedTuple):
    """When a pedestrian enters the ego's path and when they have left its lane, in s from now."""

    enters_s: float
    frees_s: float


def _people(observation: Observation) -> list[_Person]:
    """All pedestrians on the crossing who are or will be in the ego's lane."""
    half_m = half_path_width_m(observation.vehicle)
    people = []
    for pedestrian in observation.pedestrians:
        if not pedestrian.on_crossing:
            continue
        _, enters_s, leaves_s = time_in_path(pedestrian, half_m)
        if pedestrian.speed_mps > 0:
            leaves_s = lane_free_in_s(observation, pedestrian)
        if leaves_s > 0 and enters_s < math.inf:
            people.append(_Person(enters_s, leaves_s))
    return people


def _lane_free_s(
    observation: Observation, people: list[_Person], critical_gap_s: float
) -> float | None:
    """Time in s after which the ego may be at the near edge; None if nobody is in the way."""
    ego = observation.ego
    to_edge_m = _to_edge_m(observation)
    needed_s = critical_gap_s if to_edge_m > 0 else min(0.0, critical_gap_s)
    at_edge_s, speed_mps = _run_up(observation, max(0.0, to_edge_m), ego.speed_mps)
    clear_s = at_edge_s + _passage_s(observation, min(0.0, to_edge_m), speed_mps)
    until_s = None
    while True:
        # A pedestrian who leaves within this step does not count.
        patience_s = max(at_edge_s, observation.step_s)
        in_the_way = [
            person.frees_s
            for person in people
            if person.frees_s > patience_s and person.enters_s - clear_s <= needed_s
        ]
        if not in_the_way or until_s == math.inf:
            return until_s
        until_s = at_edge_s = max(in_the_way)
        clear_s = until_s + _passage_s(observation, 0.0, _arrival_speed_mps(observation, until_s))


def _arrival_speed_mps(observation: Observation, until_s: float) -> float:
    """Speed at the near edge if it gets there in ``until_s``, by rolling or after a stop."""
    ego, crossing = observation.ego, observation.crossing
    to_edge_m = max(0.0, _to_edge_m(observation))
    rolling_mps = 2 * to_edge_m / until_s - ego.speed_mps
    if rolling_mps >= ROLLING_MPS:
        return rolling_mps
    start_m = min(to_edge_m, crossing.stop_line_m - crossing.width_m / 2)
    return math.sqrt(2 * observation.vehicle.resume_acceleration_mps2 * start_m)


def _yield(observation: Observation, until_s: float, go_mps2: float) -> float:
    """The acceleration that reaches the near edge in ``until_s``, or stops; else ``go_mps2``."""
    ego, to_edge_m = observation.ego, _to_edge_m(observation)
    if ego.speed_mps <= ROUNDING:
        # The ego stands; a stop may leave 1e-17 m/s, which must not count as rolling.
        return 0.0
    if 2 * to_edge_m / until_s - ego.speed_mps >= ROLLING_MPS:
        rolling_mps2 = 2 * (to_edge_m - ego.speed_mps * until_s) / until_s**2
        if rolling_mps2 >= -observation.vehicle.max_deceleration_mps2:
            return rolling_mps2
    for range_m in (observation.crossing.stop_line_m, CLEARANCE_M):
        stopping_mps2 = stop_at(observation, range_m)
        if stopping_mps2 is not None:
            return stopping_mps2
    return full_braking(observation) if can_stop_before_disc(observation) else go_mps2


def _within_stopping(observation: Observation, wanted_mps2: float) -> float:
    """``wanted_mps2``, limited so that the ego can slow down to v_e before the edge.

    The speed v' after this step solves v'² = v_e² + 2 a (s − (v + v') step/2), with a = 3 m/s² or
    the vehicle's maximum if that is less.  An ego that can stop at the edge can then stop at every
    step before it.
    """
    speed_mps, step_s = observation.ego.speed_mps, observation.step_s
    to_edge_m = _to_edge_m(observation)
    if to_edge_m <= 0:
        return wanted_mps2
    slowing_mps2 = _slowing_mps2(observation)
    half_mps, left_m = slowing_mps2 * step_s / 2, to_edge_m - speed_mps * step_s / 2
    squared = half_mps**2 + 2 * slowing_mps2 * left_m
    if (speed_mps + wanted_mps2 * step_s + half_mps) ** 2 < squared:
        return wanted_mps2  # far away even v_e = 0 limits nothing
    squared += _edge_speed_mps(observation) ** 2
    return min(wanted_mps2, (math.sqrt(max(0.0, squared)) - half_mps - speed_mps) / step_s)


def _to_edge_m(observation: Observation) -> float:
    """Distance to the near edge in m, negative once the bumper is over it."""
    distance_m = observation.ego.range_m - observation.crossing.width_m / 2
    return distance_m if abs(distance_m) > ROUNDING else 0.0


def _edge_speed_mps(observation: Observation) -> float:
    """v_e: the speed at the near edge from which the ego can still stop one step later."""
    limit_mps2, step_s = observation.vehicle.max_deceleration_mps2, observation.step_s
    room_m = observation.crossing.width_m / 2 - CLEARANCE_M - limit_mps2 * step_s**2 / 8
    return limit_mps2 * (math.sqrt(step_s**2 + 2 * max(0.0, room_m) / limit_mps2) - step_s)


def _slowing_mps2(observation: Observation) -> float:
    return min(COMFORTABLE_MPS2, observation.vehicle.max_deceleration_mps2)


def _run_up(observation: Observation, distance_m: float, speed_mps: float) -> tuple[float, float]:
    """(time to the near edge, speed there) of the free approach: a0, v0, then down to v_e."""
    slowing_mps2, edge_mps = _slowing_mps2(observation), _edge_speed_mps(observation)
    vehicle = observation.vehicle
    a0_mps2, top_mps = vehicle.resume_acceleration_mps2, vehicle.initial_speed_mps
    # Squared speed at which slowing down has to begin at this distance.
    on_curve = edge_mps**2 + 2 * slowing_mps2 * distance_m
    if speed_mps**2 >= on_curve:
        return 2 * distance_m / (speed_mps + edge_mps) if distance_m > 0 else 0.0, edge_mps
    # Distance after which accelerating with a0 would meet that curve.
    run_m = (on_curve - speed_mps**2) / (2 * (a0_mps2 + slowing_mps2))
    if top_mps <= edge_mps or run_m >= distance_m:
        return speeding_up(observation, distance_m, speed_mps)
    peak_mps = min(math.sqrt(speed_mps**2 + 2 * a0_mps2 * run_m), top_mps)
    rising_m = (peak_mps**2 - speed_mps**2) / (2 * a0_mps2)
    falling_m = (peak_mps**2 - edge_mps**2) / (2 * slowing_mps2)
    changing_s = (peak_mps - speed_mps) / a0_mps2 + (peak_mps - edge_mps) / slowing_mps2
    return changing_s + (distance_m - (rising_m + falling_m)) / peak_mps, edge_mps


def _passage_s(observation: Observation, to_edge_m: float, speed_mps: float) -> float:
    """Time until the rear is past x = 0.25 m, from ``to_edge_m`` ≤ 0: the near edge or beyond."""
    length, width = observation.vehicle.length_m, observation.crossing.width_m
    distance_m = width / 2 + to_edge_m + length + PEDESTRIAN_RADIUS_M
    return speeding_up(observation, distance_m, speed_mps)[0]
