"""The rows of the table ``passages``: a simulation's states and walks in; measures out.

A passage is measured as an encounter in its straight frame, where x = s − centre and the path is
straight.  Only contacts are found in the plane, by the vehicle's oriented outline.
"""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from harness.core.vocabulary import (
    LIMITED_BY,
    PEDESTRIAN_RADIUS_M,
    Contact,
    Ending,
    StepMotion,
    Trace,
    Walk,
)
from harness.measures import EpisodeRecord, crossing_time_s, measure
from harness.measures.contacts import Strike
from harness.measures.efficiency import beyond
from harness.measures.ego import ego_positions, ego_state
from harness.simulation.cars import Passage
from harness.simulation.walk import Walked, moved
from harness.site.path import FrontPath
from harness.site.town import Town

SimulatedRow = Mapping[str, Any]

_SAMPLE_S = 0.0125
"""Longest time between two outlines that are compared with people."""
_NEAR_M = 2.0
"""No person touches a vehicle whose outline is this far from the crosswalk."""


def passages(
    simulated: Sequence[Passage],
    people: Mapping[str, Sequence[Walked]],
    town: Town,
    step_s: float,
    motion: StepMotion,
) -> list[SimulatedRow]:
    """The rows of the table ``passages``.

    Args:
        simulated: the passages; what one of a single state measures is undefined.
        people: everybody at each crosswalk.
        town: has the vehicles' paths.
        step_s: time between two states.
        motion: how vehicles move between two states.
    """
    traces, strikes, ids = [], [], []
    for each in simulated:
        end_s = each.begin_s + (len(each.xs_m) - 1) * step_s
        here = [
            person
            for person in people[each.at.crosswalk.id]
            if person.walk.arrival.arrival_s < end_s and person.until_s > each.begin_s
        ]
        trace, walkers = _trace(each, here, step_s, motion)
        ids.append({person.walk.arrival.index: person.id for person in here})
        traces.append(trace)
        path = town.path(each.at.connection)
        strikes.append(strike_of(trace, each, path, walkers))
    records = _records(traces, strikes)
    free_s = [free_pass_s(each, town.path(each.at.connection)) for each in simulated]
    return [*map(_row, simulated, traces, records, ids, free_s)]


def _row(
    passage: Passage, trace: Trace, record: EpisodeRecord, names: Mapping[int, str], free_s: float
) -> SimulatedRow:
    """The row of a passage, with its measures."""
    car, begin_s, driven = passage.car, passage.begin_s, sum(passage.limited)
    edge_m = -trace.crossing.width_m / 2
    # A vehicle that came onto the road beyond the edge never reached it.
    front_s = None if trace.x_m[0] > edge_m else crossing_time_s(trace, edge_m)
    rear_s = record.pass_time_ignoring_contact_s
    trigger_s = begin_s - passage.trace_offset_s
    values = record.values
    if record.pass_time_s is not None:
        values["delay_s"] = float(beyond(record.pass_time_s, free_s))
    return {
        "crosswalk": passage.at.crosswalk.id,
        "vehicle": car.name,
        "type": car.facts.type_id,
        "connection": passage.at.connection.id,
        "manoeuvre": passage.at.connection.manoeuvre,
        "automated": car.facts.automated,
        "driver": passage.driver,
        "driven": passage.not_driven is None,
        "not_driven_because": passage.not_driven,
        "trigger_s": trigger_s,
        "front_s": None if front_s is None else begin_s + front_s,
        "rear_s": None if rear_s is None else trigger_s + rear_s,
        "ended": passage.ended,
        "min_speed_mps": float(trace.speed_mps.min()),
        "steps": len(trace.x_m) - 1,
        **{
            f"share_{name}": count / driven if driven else None
            for name, count in zip(LIMITED_BY, passage.limited, strict=True)
        },
        "pedestrians": record.pedestrians,
        "contact": record.contact,
        "contact_person": None if record.contact_index is None else names[record.contact_index],
        "sumo_contact": passage.collided,
        "fallback": passage.fallback,
        **values,
    }


def _trace(
    passage: Passage, people: Sequence[Walked], step_s: float, motion: StepMotion
) -> tuple[Trace, list[Walked]]:
    """The trace of a passage, and those of the people in it who stepped off."""
    begin_s, zone = passage.begin_s, passage.at.zone
    base = Trace(
        vehicle=passage.vehicle,
        crossing=passage.crossing,
        step_s=step_s,
        x_m=passage.xs_m,
        speed_mps=passage.speeds_mps,
        walks=(),
        ending=Ending.CROSSED if passage.passed else Ending.TIMED_OUT,
        sumo_collision=passage.collided,
        trace_offset_s=passage.trace_offset_s,
        shown=None if passage.driven_by is None else passage.driven_by.shown,
        motion=motion,
    )
    length_s = (len(base.x_m) - 1) * step_s
    walks: list[Walk] = []
    walkers: list[Walked] = []
    for each in people:
        far_m = zone.crossing.length_m if zone.reverse else None
        leads_left = zone.reverse == passage.at.crosswalk.left_hand
        walk = moved(each.walk, begin_s, step_s, far_m, leads_left=leads_left)
        start_s = walk.start_s
        if start_s is not None and start_s >= length_s:
            walk = replace(walk, start_s=None, speed_mps=None, legs=None)
        elif start_s is not None:
            walkers.append(each)
            if start_s >= 0.0:
                x_m, speed_mps = ego_state(base, start_s)
                walk = replace(walk, range_m=-x_m, vehicle_speed_mps=speed_mps)
        walks.append(walk)
    return replace(base, walks=tuple(walks)), walkers


def strike_of(
    trace: Trace, passage: Passage, path: FrontPath, walkers: Sequence[Walked]
) -> Strike | None:
    """The first contact of a vehicle's oriented outline with a person's disc between the kerbs.

    Between two outlines that are compared, the time is interpolated.

    Args:
        trace: the trace of the passage.
        passage: has the time at which the trace begins, and the vehicle's size.
        path: the vehicle's path.
        walkers: those who stepped off, in the trace's order.
    """
    length_m, width_m = passage.car.facts.vehicle.length_m, passage.car.facts.vehicle.width_m
    half_m = trace.crossing.width_m / 2
    # A rear that cuts a corner leaves later than a straight body would.
    leaves_m = max(half_m + length_m, passage.at.zone.last_m - passage.at.zone.centre_m)
    ends_m = (-half_m - _NEAR_M, leaves_m + _NEAR_M)
    low, high = np.searchsorted(trace.x_m, ends_m).tolist()
    low, high = max(low - 1, 0), min(high, len(trace.x_m) - 1)
    if low >= high:  # it was never near the crosswalk
        return None
    count = math.ceil((high - low) * max(trace.step_s / _SAMPLE_S, 1.0))
    time_s = np.linspace(low, high, count + 1) * trace.step_s
    strikes: list[Strike] = []
    for number, each in enumerate(walkers):
        places = each.places(passage.begin_s + time_s, passage.at.crosswalk)
        on = np.flatnonzero(np.isfinite(places))
        s = passage.at.zone.centre_m + ego_positions(trace, time_s[on])
        right, left, rear = (path.outline(s, length_m, width_m) @ [1, 1j])[:, :3].T
        # Ahead of the front and to its left; then, the distance from the outline, 0 inside.
        off = (places[on] - (right + left) / 2) * length_m / (left - rear)
        past, beside = np.maximum(off.real, -length_m - off.real), np.abs(off.imag) - width_m / 2
        off_m = np.hypot(np.maximum(past, 0.0), np.maximum(beside, 0.0))
        hits = np.flatnonzero(off_m <= PEDESTRIAN_RADIUS_M)
        if not len(hits):
            continue
        at = int(hits[0])
        hit_s = float(time_s[on[at]])
        if at:
            inside, outside = PEDESTRIAN_RADIUS_M - off_m[at], off_m[at - 1] - PEDESTRIAN_RADIUS_M
            hit_s -= float((hit_s - time_s[on[at - 1]]) * inside / (inside + outside))
        where = Contact.FRONT if off.real[at] >= 0.0 else Contact.SIDE
        strikes.append(Strike(hit_s, number, where, max(0.0, ego_state(trace, hit_s)[1])))
    return min(strikes, key=lambda each: each.time_s, default=None)


def _records(traces: Sequence[Trace], strikes: Sequence[Strike | None]) -> list[EpisodeRecord]:
    """The record of every trace; those that differ only in v0 and R0 are measured together."""
    groups = defaultdict(list)
    for number, trace in enumerate(traces):
        alike = replace(trace.vehicle, initial_speed_mps=1.0, trigger_range_m=1.0)
        groups[alike, trace.crossing].append(number)
    records: dict[int, EpisodeRecord] = {}
    for numbers in groups.values():
        found = measure([traces[each] for each in numbers], [strikes[each] for each in numbers])
        records |= zip(numbers, found, strict=True)
    return [records[number] for number in range(len(traces))]


def free_pass_s(passage: Passage, path: FrontPath) -> float:
    """The time of a free passage from R0 until the rear has left, at the limits of its lanes."""
    vehicle, zone = passage.vehicle, passage.at.zone
    begin_m = zone.centre_m - vehicle.trigger_range_m
    accelerations = vehicle.max_acceleration_mps2, vehicle.max_deceleration_mps2
    return path.free_drive_s(begin_m, zone.last_m, *accelerations, passage.car.facts.limit_mps)
