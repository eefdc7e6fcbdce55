"""A scenario and a pair's number in; the schedule of the pair's vehicles out.

The schedule is the same in both arms and in all cells.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from harness.core.seeding import stream
from harness.episode.arrivals import SECONDS_PER_HOUR
from harness.episode.traffic.lanes import Direction, Lane, lanes_of
from harness.scenario import QUARTER_S, Scenario, TrafficSection

_BLOCK = 64


@dataclass(frozen=True, slots=True)
class Scheduled:
    """A scheduled vehicle.

    Attributes:
        number: k · lanes + number of its lane, for the k-th vehicle of the lane.  So it is the same
            in every arm and every cell with these lanes.
        lane: its lane.
        step: when it is due at the road's upstream end, in steps from the beginning of the warm-up.
        uniform: the vehicle is an AV if this is below the share of AVs.  So a greater share only
            adds AVs.
    """

    number: int
    lane: Lane
    step: int
    uniform: float


def scheduled_vehicles(scenario: Scenario, pair: int, lane: Lane) -> Iterator[Scheduled]:
    """The vehicles of a lane, by time.

    The lanes of a direction share its flow equally.  Headways in a lane of flow q are shifted
    exponential: at least h (the following headway at v0), then with the hazard 1/(1/q − h), so the
    mean headway is 1/q.  q may change every quarter of an hour.  Times are rounded up to steps.
    In a saturated lane there is always a next vehicle.

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
    if traffic.saturated:
        steps: Iterator[int] = iter(lambda: 0, None)
    else:
        lanes = sum(other.direction is lane.direction for other in road)
        units = _uniforms(stream(seed, "vehicle_arrival", pair, *key))
        steps = _steps(traffic, lane.direction, lanes, scenario.least_headway_s(), step_s, units)
    for count, (step, uniform) in enumerate(zip(steps, automated, strict=False)):
        yield Scheduled(count * len(road) + place, lane, step, uniform)


def flow_per_hour(traffic: TrafficSection, direction: Direction, time_s: float) -> float:
    """Scheduled vehicles per hour of a direction, at a time since the end of the warm-up."""
    forward = direction is Direction.FORWARD
    flow = traffic.flow_per_hour if forward else traffic.oncoming_per_hour
    if not isinstance(flow, tuple):
        return flow
    return flow[min(max(0, math.floor(time_s / QUARTER_S)), len(flow) - 1)]


def _steps(
    traffic: TrafficSection,
    direction: Direction,
    lanes: int,
    headway_s: float,
    step_s: float,
    uniforms: Iterator[float],
) -> Iterator[int]:
    """Times of a lane's vehicles, in steps from the beginning of the warm-up."""
    begin, end, headway = -traffic.warm_up_s, traffic.duration_s, round(headway_s / step_s)
    time_s, earliest = begin, 0
    for uniform in uniforms:
        left = -math.log1p(-uniform)
        while True:
            per_s = flow_per_hour(traffic, direction, time_s) / lanes / SECONDS_PER_HOUR
            hazard = per_s / (1 - per_s * headway_s)
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
        earliest = step + headway
        time_s += headway_s
        if time_s >= end:
            return


def _uniforms(generator: np.random.Generator) -> Iterator[float]:
    while True:
        yield from generator.random(_BLOCK).tolist()
