"""A vehicle's states and people's walks in; the measures of each passage out.

A passage is measured as an encounter in its straight frame, where x = s − centre and the path is
straight.  Only contacts are found in the plane, by the vehicle's oriented outline.
"""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from harness.core.encounter import (
    PEDESTRIAN_RADIUS_M,
    Contact,
    Crossing,
    Ending,
    FloatArray,
    Trace,
    Walk,
)
from harness.measures import EpisodeRecord, crossing_time, measure
from harness.measures.contacts import Strike
from harness.measures.efficiency import STANDING_MPS, beyond
from harness.measures.ego import ego_state
from harness.measures.motion.walking import states_at
from harness.simulation.arm import PASSED, Log, Setup
from harness.simulation.driving import LIMITS, Passage
from harness.simulation.people import Axis, Walked, moved
from harness.site.path import Path

Columns = dict[str, list[Any]]
"""A table: its columns by name."""

_SAMPLES = 8
"""Number of samples within a step at which outlines are compared."""


def passages(log: Log, setup: Setup, step_s: float) -> Columns:
    """The rows of the table ``passages``: those that began in the counted time."""
    kept = [
        each
        for each in log.passages
        if len(each.xs_m) > 1 and setup.counts(each.time_s[0] - each.trace_offset_s)
    ]
    axes = {name: Axis(setup.town.crosswalks[name]) for name in setup.crosswalks}
    spans = {name: _spans(people) for name, people in log.people.items()}
    traces, strikes, ids = [], [], []
    for each in kept:
        name = each.crosswalk.id
        here = [log.people[name][i] for i in _there(each, spans[name])]
        ids.append({person.walk.arrival.index: person.id for person in here})
        trace, walkers = _trace(each, here, setup, step_s)
        traces.append(trace)
        path = setup.zones.path(each.connection)
        strikes.append(strike_of(trace, each.zone.centre_m, path, walkers, axes[name], each))
    records = _records(traces, strikes)
    table: Columns = defaultdict(list)
    for each, trace, record, names in zip(kept, traces, records, ids, strict=True):
        for column, value in _row(each, trace, record, names, setup).items():
            table[column].append(value)
    return dict(table)


def _row(
    passage: Passage,
    trace: Trace,
    record: EpisodeRecord,
    names: Mapping[int, str],
    setup: Setup,
) -> Mapping[str, object]:
    car, begin_s = passage.car, passage.time_s[0]
    driven = sum(passage.limited)
    front_s = crossing_time(trace, -trace.crossing.width_m / 2)
    rear_s = record.pass_time_ignoring_contact_s
    trigger_s = begin_s - passage.trace_offset_s
    values = record.values._asdict()  # type: ignore[attr-defined]  # a named tuple
    if record.pass_time_s is not None:
        free_s = free_pass_s(passage, setup.zones.path(passage.connection))
        values["delay_s"] = float(beyond(record.pass_time_s, free_s))
    return {
        "crosswalk": passage.crosswalk.id,
        "vehicle": car.name,
        "type": car.type_id,
        "connection": passage.connection.id,
        "manoeuvre": passage.connection.manoeuvre,
        "automated": car.automated,
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
            for name, count in zip(LIMITS, passage.limited, strict=True)
        },
        "pedestrians": record.pedestrians,
        "contact": record.contact,
        "contact_person": None if record.contact_index is None else names[record.contact_index],
        "sumo_contact": passage.collided,
        **_longest_stop(trace, begin_s),
        "fallback": passage.fallback,
        **values,
    }


def _longest_stop(trace: Trace, begin_s: float) -> Mapping[str, float | None]:
    """Begin and end of the longest stop before the crosswalk."""
    stands = (trace.speed_mps < STANDING_MPS) & (trace.x_m <= -trace.crossing.width_m / 2)
    ends = np.flatnonzero(np.diff(np.concatenate(([False], stands, [False])))).reshape(-1, 2)
    if not len(ends):
        return {"stop_begin_s": None, "stop_end_s": None}
    low, high = ends[np.argmax(np.diff(ends, axis=1))].tolist()
    last = min(high, len(stands) - 1)
    return {
        "stop_begin_s": begin_s + low * trace.step_s,
        "stop_end_s": begin_s + last * trace.step_s,
    }


def _spans(people: Sequence[Walked]) -> FloatArray:
    """From when until when each person counts, shape (n, 2)."""
    return np.array(
        [
            (each.walk.arrival.arrival_s, math.inf if each.cleared_s is None else each.cleared_s)
            if each.time_s is None or each.walk.start_s is None
            else (each.walk.arrival.arrival_s, each.cleared_s or float(each.time_s[-1]))
            for each in people
        ]
    ).reshape(-1, 2)


def _there(passage: Passage, spans: FloatArray) -> Sequence[int]:
    """The numbers of the people who are there during a passage."""
    begin_s, end_s = passage.time_s[0], passage.time_s[-1]
    there: list[int] = np.flatnonzero((spans[:, 0] < end_s) & (spans[:, 1] > begin_s)).tolist()
    return there


def _trace(
    passage: Passage, people: Sequence[Walked], setup: Setup, step_s: float
) -> tuple[Trace, list[Walked]]:
    """The trace of a passage, and those of the people in it who stepped off."""
    begin_s, zone = passage.time_s[0], passage.zone
    base = Trace(
        vehicle=passage.vehicle,
        crossing=passage.crossing,
        step_s=step_s,
        x_m=np.array(passage.xs_m),
        speed_mps=np.array(passage.speeds_mps),
        walks=(),
        ending=Ending.CROSSED if passage.ended == PASSED else Ending.TIMED_OUT,
        reason=None,
        sumo_collision=passage.collided,
        fallback=passage.fallback,
        trace_offset_s=passage.trace_offset_s,
        shown=None if passage.shown is None else tuple(passage.shown),
        motion="ballistic" if setup.config.ballistic else "euler",
    )
    length_s = (len(base.x_m) - 1) * step_s
    walks: list[Walk] = []
    walkers: list[Walked] = []
    for each in people:
        walk = moved(each.walk, begin_s, zone.crosswalk_m if zone.reverse else None)
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
    trace: Trace,
    centre_m: float,
    path: Path,
    walkers: Sequence[Walked],
    axis: Axis,
    passage: Passage,
) -> Strike | None:
    """The first contact of a vehicle's oriented outline with a person's disc between the kerbs.

    Outlines are compared eight times in each step; between two of them the time is interpolated.

    Args:
        trace: the passage.
        centre_m: s at x = 0.
        path: the vehicle's path.
        walkers: those who stepped off, in the trace's order.
        axis: the crosswalk's.
        passage: has the time at which the trace begins, and the vehicle's size.
    """
    begin_s, vehicle = passage.time_s[0], passage.car.vehicle
    half_m, radius = trace.crossing.width_m / 2, PEDESTRIAN_RADIUS_M
    steps = len(trace.x_m) - 1
    inside = np.flatnonzero(
        (trace.x_m >= -half_m - 2.0) & (trace.x_m <= half_m + vehicle.length_m + 2.0)
    )
    if not len(inside) or not walkers:
        return None
    low, high = max(int(inside[0]) - 1, 0), min(int(inside[-1]) + 1, steps)
    time_s = np.linspace(low, high, (high - low) * _SAMPLES + 1) * trace.step_s
    x_m = np.interp(time_s, np.arange(steps + 1) * trace.step_s, trace.x_m)
    outlines: FloatArray | None = None
    first: Strike | None = None
    for number, each in enumerate(walkers):
        places = places_of(each, begin_s + time_s, axis)
        there = np.isfinite(places[:, 0])
        if not there.any():
            continue
        if outlines is None:
            outlines = path.outline(x_m + centre_m, vehicle.length_m, vehicle.width_m)
        ahead_m, gap_m = _gap(outlines, places, vehicle.length_m, vehicle.width_m)
        hits = np.flatnonzero(there & (gap_m <= radius))
        if not len(hits):
            continue
        at = int(hits[0])
        within_s = 0.0
        if at and there[at - 1]:
            before, after = gap_m[at - 1] - radius, gap_m[at] - radius
            within_s = float((time_s[at] - time_s[at - 1]) * after / (after - before))
        hit_s = float(time_s[at]) - within_s
        if first is None or hit_s < first.time_s:
            _, speed_mps = ego_state(trace, hit_s)
            where = Contact.FRONT if ahead_m[at] >= 0.0 else Contact.SIDE
            first = Strike(hit_s, number, where, max(0.0, speed_mps))
    return first


def _gap(
    outlines: FloatArray, places: FloatArray, length_m: float, width_m: float
) -> tuple[FloatArray, FloatArray]:
    """How far people are ahead of the front, and their distance from the outline; shapes (n,)."""
    right, left = outlines[:, 0], outlines[:, 1]
    across = (left - right) / width_m
    ahead = np.stack([across[:, 1], -across[:, 0]], axis=-1)
    off = places - (left + right) / 2
    ahead_m, left_m = np.sum(off * ahead, axis=1), np.sum(off * across, axis=1)
    beyond_m = np.maximum(np.maximum(ahead_m, -length_m - ahead_m), 0.0)
    beside_m = np.maximum(np.abs(left_m) - width_m / 2, 0.0)
    return ahead_m, np.hypot(beyond_m, beside_m)


def places_of(person: Walked, time_s: FloatArray, axis: Axis) -> FloatArray:
    """Where a person is between the kerbs at some times, shape (n, 2); NaN at other times."""
    start_s, end_s = person.walk.start_s, person.cleared_s
    assert start_s is not None
    on = (time_s >= start_s) & (time_s <= (math.inf if end_s is None else end_s))
    places = np.full((len(time_s), 2), np.nan)
    if person.time_s is not None and person.places is not None:
        on &= time_s <= person.time_s[-1]
        for column in (0, 1):
            seen = np.interp(time_s[on], person.time_s, person.places[:, column])
            places[on, column] = seen
    elif on.any():
        # The harness's people keep to the axis.
        _, along_m, _, _ = states_at(
            person.walk, Crossing(axis.length_m, 1.0, 0.0, 1.0), time_s[on]
        )
        places[on] = [axis.point(min(max(at_m, 0.0), axis.length_m)) for at_m in along_m.tolist()]
    return places


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


def free_pass_s(passage: Passage, path: Path) -> float:
    """The time of a free passage from R0 until the rear has left, at the limits of its lanes.

    The vehicle slows down for lower limits and curves ahead with its deceleration, and speeds up
    behind them with its acceleration.
    """
    vehicle, zone = passage.vehicle, passage.zone
    begin_m, end_m = zone.centre_m - vehicle.trigger_range_m, zone.last_m
    ends = [each.start_m for each in path.stretches[1:] if begin_m < each.start_m < end_m]
    places = [begin_m, *ends, end_m]
    limits = [
        passage.car.limit_mps(path.lane_at((low + high) / 2).limit_mps)
        for low, high in pairwise(places)
    ]
    gain, loss = vehicle.max_acceleration_mps2, vehicle.max_deceleration_mps2
    speeds = [limits[0], *map(min, limits, limits[1:]), limits[-1]]
    lengths = [high - low for low, high in pairwise(places)]
    for i in reversed(range(len(lengths))):
        speeds[i] = min(speeds[i], math.sqrt(speeds[i + 1] ** 2 + 2 * loss * lengths[i]))
    total_s = 0.0
    for i, (length_m, limit) in enumerate(zip(lengths, limits, strict=True)):
        low = speeds[i]
        high = speeds[i + 1] = min(speeds[i + 1], math.sqrt(low**2 + 2 * gain * length_m))
        crossed = (2 * gain * loss * length_m + loss * low**2 + gain * high**2) / (gain + loss)
        peak = min(limit, math.sqrt(crossed))
        steady_m = length_m - (peak**2 - low**2) / (2 * gain) - (peak**2 - high**2) / (2 * loss)
        total_s += (peak - low) / gain + (peak - high) / loss + max(steady_m, 0.0) / peak
    return total_s
