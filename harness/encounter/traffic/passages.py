"""An hour's log in; a passage of each vehicle out, with a trace in the frame of its own lane."""

import math
from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np

from harness.core.encounter import Crossing, Ending, Trace, Walk
from harness.encounter.cell_constants import CellConstants
from harness.encounter.traffic.lanes import Lane
from harness.encounter.traffic.vehicles import HourLog, HourVehicle
from harness.measures import EpisodeRecord, measure
from harness.measures.efficiency import beyond
from harness.measures.ego import crossing_time

CHUNK = 200
"""Number of passages that are measured together; results do not depend on it."""


@dataclass(frozen=True, slots=True)
class Passage:
    """The passage of a vehicle: its times, delays, record and trace.

    Times are in s from the beginning of the warm-up.  A value is None if the vehicle did not get
    that far.

    Attributes:
        vehicle: the vehicle.
        scheduled_s: scheduled time of entering the road.
        due_s: time at which its rear would leave the crosswalk if it drove at v0 from then on.
        inserted_s: time at which it entered the road.
        edge_s: time at which its front reached the near edge of the crosswalk.
        passed_s: time at which its rear had left the crosswalk.
        delay_s: ``passed_s`` − ``due_s``.
        control_delay_s: the same delay up to the place where vehicles leave the road.
        record: its measures.
        trace: its trace.
    """

    vehicle: HourVehicle
    scheduled_s: float | None
    due_s: float | None
    inserted_s: float | None
    edge_s: float | None
    passed_s: float | None
    delay_s: float | None
    control_delay_s: float | None
    record: EpisodeRecord
    trace: Trace


def passages_of(
    log: HourLog, rules: CellConstants, end_x_m: dict[int, float], saturated: bool
) -> list[Passage]:
    """The passages of an hour, by number of the vehicle.

    Args:
        log: the log of the hour.
        rules: the cell's constants.
        end_x_m: x at which vehicles leave the road, by number of their lane (``number`` % lanes).
        saturated: whether lanes are saturated; there is no schedule then, and delays are undefined.
    """
    by_lane: dict[tuple[Lane, int], list[HourVehicle]] = defaultdict(list)
    for car in sorted(log.vehicles, key=lambda car: car.plan.number):
        by_lane[car.plan.lane, car.plan.kind].append(car)
    passages = []
    for (lane, _), vehicles in by_lane.items():
        for begin in range(0, len(vehicles), CHUNK):
            part = vehicles[begin : begin + CHUNK]
            traces = [_trace(car, lane, log, rules) for car in part]
            for car, trace, record in zip(part, traces, measure(traces), strict=True):
                end_x = end_x_m[car.plan.number % len(end_x_m)]
                passages.append(_passage(car, trace, record, end_x, saturated))
    return sorted(passages, key=lambda passage: passage.vehicle.plan.number)


def _passage(
    car: HourVehicle, trace: Trace, record: EpisodeRecord, end_x_m: float, saturated: bool
) -> Passage:
    step_s, vehicle, half_m = trace.step_s, trace.vehicle, trace.crossing.width_m / 2
    v0, rear_m = vehicle.initial_speed_mps, vehicle.length_m + half_m
    begin_s = (car.first_step or 0) * step_s
    scheduled_s = None if saturated else car.plan.step * step_s
    due_s = None if scheduled_s is None else scheduled_s + (rear_m - car.insert_x_m) / v0
    within_s = crossing_time(trace, -half_m)
    edge_s = None if within_s is None else begin_s + within_s
    passed_s = delay_s = control_s = None
    if car.passed:
        within_s = crossing_time(trace, min(rear_m, float(trace.x_m[-1])))
        assert within_s is not None
        passed_s = begin_s + within_s
        delay_s = None if due_s is None else float(beyond(passed_s, due_s))
    if car.gone_step is not None and scheduled_s is not None:
        # Leaving is recorded in whole steps, so the time at v0 is rounded up to steps too.
        free_steps = math.ceil((end_x_m - car.insert_x_m) / (v0 * step_s) - 1e-6)
        control_s = max(0, car.gone_step - car.plan.step - free_steps) * step_s
    inserted_s = None if car.inserted_step is None else car.inserted_step * step_s
    times = (scheduled_s, due_s, inserted_s, edge_s, passed_s)
    return Passage(car, *times, delay_s, control_s, record, trace)


def _trace(car: HourVehicle, lane: Lane, log: HourLog, rules: CellConstants) -> Trace:
    begin_s = (car.first_step or 0) * rules.step_s
    walks = []
    if car.first_step is not None:
        until = car.came_until
        met = [walker.walk for walker in car.met]
        walks = [*met, *log.walks[car.came_from : until]]
    return Trace(
        vehicle=car.vehicle,
        crossing=lane.crossing,
        step_s=rules.step_s,
        x_m=np.array(car.xs),
        speed_mps=np.array(car.speeds),
        walks=tuple(as_seen(walk, lane, begin_s, rules.crossing) for walk in walks),
        ending=Ending.CROSSED if car.passed else Ending.TIMED_OUT,
        reason=None,
        sumo_collision=car.collided,
        fallback=bool(getattr(car.strategy, "fallback", False)),
        trace_offset_s=car.trace_offset_s,
        shown=None if car.shown is None else tuple(car.shown),
    )


def as_seen(walk: Walk, lane: Lane, begin_s: float, crossing: Crossing) -> Walk:
    """A walk in a passage's own time, in the frame of its lane."""
    arrival = walk.arrival._replace(
        arrival_s=walk.arrival.arrival_s - begin_s, side=lane.own_side(walk.arrival.side)
    )
    legs = walk.legs
    if legs is not None:
        sign = lane.direction.sign
        base = 0.0 if sign > 0 else crossing.length_m
        legs = tuple(
            leg._replace(
                time_s=leg.time_s - begin_s,
                x_m=sign * leg.x_m,
                y_m=base + sign * leg.y_m,
                x_mps=sign * leg.x_mps,
                y_mps=sign * leg.y_mps,
                y_mps2=sign * leg.y_mps2,
            )
            for leg in legs
        )
    start_s = None if walk.start_s is None else walk.start_s - begin_s
    return replace(walk, arrival=arrival, start_s=start_s, legs=legs)
