"""``[traffic]`` in; the vehicles that are due in a pair, and the end of the simulation, out."""

import math
from collections.abc import Iterator

import numpy as np

from harness.core.seeding import stream
from harness.core.vocabulary import ROUNDING, SECONDS_PER_HOUR
from harness.engine.traffic_files import Due
from harness.scenario import Scenario
from harness.scenario.traffic import TrafficSection

_LEAST_CLEARING_S = 900.0
"""Time for the road to empty after the counted time, at least."""
_SATURATED = 0.9
"""In a saturated lane a vehicle is due after this share of the least headway: one always waits."""


def end_s(traffic: TrafficSection) -> float:
    """The end of the simulation: the counted time, then time for the road to empty."""
    clearing_s = 0.0 if traffic.saturated else max(traffic.duration_s, _LEAST_CLEARING_S)
    return traffic.warm_up_s + traffic.duration_s + clearing_s


def vehicles_due(scenario: Scenario, pair: int) -> Iterator[Due]:
    """The vehicles of all lanes, lane by lane; in every cell the same if demand and road are.

    The lanes of a direction share its flow equally.  Headways in a lane of flow q are shifted
    exponential: at least h (the following headway at v0), and beyond h with the hazard 1/(1/q − h).
    So the mean headway is 1/q.  Times are rounded up to steps.

    Args:
        scenario: a scenario with ``[traffic]``.
        pair: index of the pair.
    """
    traffic, experiment = scenario.known_traffic, scenario.experiment
    for direction, way in enumerate(("forward", "oncoming")):
        lanes = len(scenario.crosswalk_from_lanes(oncoming=bool(direction)))
        flow = traffic.oncoming_per_hour if direction else traffic.flow_per_hour
        for lane in range(lanes):
            due = _of_a_flow(scenario, (pair, direction, lane), flow / lanes / SECONDS_PER_HOUR)
            if traffic.saturated:
                apart_s = max(experiment.step_s, _SATURATED * scenario.least_headway_s())
                times = np.arange(0.0, traffic.warm_up_s + traffic.duration_s, apart_s)
                due = iter(times.tolist())
            for number, time_s in enumerate(due):
                yield Due(f"{way}-{lane}-{number}", direction, lane, time_s)


def _of_a_flow(scenario: Scenario, key: tuple[int, ...], per_s: float) -> Iterator[float]:
    """Time from the begin, in whole steps, of each vehicle of the lane with a stream's key."""
    traffic, step_s = scenario.known_traffic, scenario.experiment.step_s
    headway_s = scenario.least_headway_s()
    hazard = per_s / (1 - per_s * headway_s)
    time_s, earliest, last_s = 0.0, 0, traffic.warm_up_s + traffic.duration_s - ROUNDING
    uniforms = stream(scenario.experiment.seed, "vehicle_arrival", *key).random
    while per_s:
        time_s -= math.log1p(-uniforms()) / hazard
        step = max(earliest, math.ceil(time_s / step_s - ROUNDING))
        if step * step_s >= last_s:
            return
        yield step * step_s
        earliest = step + round(headway_s / step_s)
        time_s += headway_s
