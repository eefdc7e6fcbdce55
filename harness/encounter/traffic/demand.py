"""A scenario and a pair's number in; the schedule of the pair's vehicles out.

The schedule is the same in both arms and in all cells.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, pairwise, repeat

import numpy as np

from harness.core.seeding import stream
from harness.encounter.arrivals import SECONDS_PER_HOUR
from harness.encounter.traffic.lanes import Direction, Lane, lanes_of
from harness.scenario import QUARTER_S, Scenario, TrafficSection, by_quarter

_BLOCK = 64


@dataclass(frozen=True, slots=True)
class Scheduled:
    """A scheduled vehicle.

    Attributes:
        number: k · lanes + number of its lane, for the k-th vehicle of the lane.  So it is the same
            in every arm and every cell with these lanes.
        lane: its lane.
        step: the step in which it is due at the road's upstream end; step 0 begins the warm-up.
        uniform: the vehicle is an AV if this is below the share of AVs.  So a greater share only
            adds AVs.  It is 1 if no vehicle of its type may be an AV.
        kind: number of its type in the vehicle mix; 0 without a mix.
    """

    number: int
    lane: Lane
    step: int
    uniform: float
    kind: int = 0


def scheduled_vehicles(scenario: Scenario, pair: int, lane: Lane) -> Iterator[Scheduled]:
    """The vehicles of a lane, by time.

    The lanes of a direction share its flow equally.  Headways in a lane of flow q are shifted
    exponential: at least h (the following headway of these two vehicles at v0), and beyond h with
    the hazard 1/(1/q − E[h]).  So the mean headway is 1/q.  q may change every quarter of an hour.
    Times are rounded up to steps.  In a saturated lane there is always a next vehicle.  Types are
    drawn one by one, each with the probability of its share.

    Args:
        scenario: a scenario with ``[traffic]``.
        pair: index of the pair.
        lane: one of ``lanes_of(scenario)``.

    Yields:
        Vehicles due in [0, warm-up + duration); without end if the lanes are saturated.
    """
    traffic = scenario.known_traffic
    seed, step_s = scenario.experiment.seed, scenario.experiment.step_s
    road = lanes_of(scenario)
    place, key = road.index(lane), (list(Direction).index(lane.direction), lane.index)
    automated = _uniforms(stream(seed, "automation", pair, *key))
    kinds = _kinds(traffic, seed, pair, key)
    if traffic.saturated:
        steps: Iterator[int] = iter(lambda: 0, None)
    else:
        lanes = sum(other.direction is lane.direction for other in road)
        units = _uniforms(stream(seed, "vehicle_arrival", pair, *key))
        mean_s = scenario.least_headway_s()
        headways: Iterator[float] = repeat(mean_s)
        if traffic.types:
            headways = _headways(scenario, _kinds(traffic, seed, pair, key))
        steps = _steps(traffic, lane.direction, lanes, mean_s, headways, step_s, units)
    may_be = [kind.automated for kind in traffic.types] or [True]
    for count, (step, uniform, kind) in enumerate(zip(steps, automated, kinds, strict=False)):
        drawn = uniform if may_be[kind] else 1.0
        yield Scheduled(count * len(road) + place, lane, step, drawn, kind)


def scheduled_vehicle(scenario: Scenario, pair: int, number: int) -> Scheduled:
    """The vehicle of that number."""
    road = lanes_of(scenario)
    vehicles = scheduled_vehicles(scenario, pair, road[number % len(road)])
    return next(islice(vehicles, number // len(road), None))


def flow_per_hour(traffic: TrafficSection, direction: Direction, time_s: float) -> float:
    """Scheduled vehicles per hour of a direction, at a time since the end of the warm-up."""
    forward = direction is Direction.FORWARD
    flow = traffic.flow_per_hour if forward else traffic.oncoming_per_hour
    flows = by_quarter(flow)
    return flows[min(max(0, math.floor(time_s / QUARTER_S)), len(flows) - 1)]


def _steps(
    traffic: TrafficSection,
    direction: Direction,
    lanes: int,
    mean_s: float,
    headways: Iterator[float],
    step_s: float,
    uniforms: Iterator[float],
) -> Iterator[int]:
    """Times of a lane's vehicles, in steps from the beginning of the warm-up.

    ``headways`` are the least headways behind each vehicle, and ``mean_s`` is their expectation.
    """
    begin, end = -traffic.warm_up_s, traffic.duration_s
    time_s, earliest = begin, 0
    for uniform in uniforms:
        left = -math.log1p(-uniform)
        while True:
            per_s = flow_per_hour(traffic, direction, time_s) / lanes / SECONDS_PER_HOUR
            hazard = per_s / (1 - per_s * mean_s)
            until = min(end, (math.floor(time_s / QUARTER_S) + 1) * QUARTER_S)
            if hazard * (until - time_s) > left:
                time_s += left / hazard
                break
            left -= hazard * (until - time_s)
            if until >= end:
                return
            time_s = until
        step = max(earliest, math.ceil((time_s - begin) / step_s - 1e-9))
        if step * step_s >= end - begin - 1e-9:
            return
        yield step
        headway_s = next(headways)
        earliest = step + round(headway_s / step_s)
        time_s += headway_s
        if time_s >= end:
            return


def _kinds(traffic: TrafficSection, seed: int, pair: int, key: tuple[int, int]) -> Iterator[int]:
    """The number of the type of each vehicle of a lane."""
    if not traffic.types:
        return repeat(0)
    ends = np.cumsum(traffic.shares)
    ends[-1] = 1.0  # the shares sum to 1 up to rounding
    units = _uniforms(stream(seed, "vehicle_type", pair, *key))
    return (int(np.searchsorted(ends, unit, side="right")) for unit in units)


def _headways(scenario: Scenario, kinds: Iterator[int]) -> Iterator[float]:
    """The least headway between each vehicle of a lane and the next."""
    vehicles = scenario.vehicles()
    table = [[scenario.headway_s(leader, other) for other in vehicles] for leader in vehicles]
    return (table[leader][follower] for leader, follower in pairwise(kinds))


def _uniforms(generator: np.random.Generator) -> Iterator[float]:
    while True:
        yield from generator.random(_BLOCK).tolist()
