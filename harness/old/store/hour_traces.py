"""Writes the motion of vehicles and people in an hour as rows.

The columns are described in docs/files.md.  Times count from the end of the warm-up.  x and y are
in the axes of the forward direction, so oncoming vehicles drive towards smaller x.
"""

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np

from harness.core.encounter import FloatArray
from harness.encounter.traffic.lanes import Direction
from harness.encounter.traffic.pairing import HourOutcome
from harness.encounter.traffic.passages import Passage
from harness.encounter.traffic.vehicles import HourVehicle
from harness.measures.motion.walking import cleared_s, states_at
from harness.old.store.hour_tables import walk_row
from harness.old.store.tables import Motion, Row, Tables, table_of, traces_table
from harness.old.store.walk_rows import shown_states

_ROUNDING_S = 1e-9


def hour_trace_rows(cell: int, outcomes: Iterable[HourOutcome]) -> Tables:
    """The tables ``traces`` and ``walks`` of everyone simulated, including warm-up and clearing.

    A vehicle has a row for each step from R0 until its rear has left the crosswalk; before and
    after that it has one row per second.
    """
    outcomes = [*outcomes]

    def keys_of(outcome: HourOutcome) -> Row:
        return {"cell": cell, "pair": outcome.pair, "arm": outcome.arm.value}

    walks = [
        keys_of(outcome) | walk_row(outcome, walk, outcome.scenario.known_traffic.warm_up_s)
        for outcome in outcomes
        for walk in outcome.log.walks
    ]
    motions = (
        (keys_of(outcome), name, motion)
        for outcome in outcomes
        for name, motion in _motions(outcome)
    )
    return {"traces": traces_table(motions), "walks": table_of("walks", walks)}


def _motions(outcome: HourOutcome) -> Iterator[tuple[str, Motion]]:
    """Name and motion of every vehicle and pedestrian."""
    step_s, begin_s = outcome.scenario.experiment.step_s, outcome.scenario.known_traffic.warm_up_s
    for passage in outcome.passages:
        columns = _vehicle(passage.vehicle, step_s, begin_s)
        if columns[0]:
            yield f"vehicle-{passage.vehicle.plan.number}", columns
        yield from _shown(passage, step_s, begin_s)
    crossing, last = outcome.scenario.crosswalk(), outcome.log.last_step
    for walk in outcome.log.walks:
        if walk.start_s is None:
            continue
        ends_s = cleared_s(walk, crossing)
        until = last if ends_s is None else min(last, math.floor(ends_s / step_s))
        steps = np.arange(math.ceil(walk.start_s / step_s), until + 1)
        times: FloatArray = (steps * step_s).astype(np.float64)
        x, y, speed, gain = states_at(walk, crossing, times)
        yield f"pedestrian-{walk.arrival.index}", (times - begin_s, x, y, speed, gain)


def _shown(passage: Passage, step_s: float, begin_s: float) -> Iterator[tuple[str, Motion]]:
    """The pedestrians whom a vehicle's driver was shown, in the axes of the forward direction."""
    vehicle, trace = passage.vehicle, passage.trace
    if vehicle.first_step is None or trace.shown is None:
        return
    steps = vehicle.first_step + np.arange(len(trace.shown), dtype=np.float64)
    oncoming = vehicle.plan.lane.direction is Direction.ONCOMING
    for index, states in shown_states(trace, steps * step_s - begin_s).items():
        times, x_m, y_m, speed, gain = zip(*states, strict=True)
        if oncoming:
            y_m = tuple(trace.crossing.length_m - each for each in y_m)
        yield f"vehicle-{vehicle.plan.number}-shown-{index}", (times, x_m, y_m, speed, gain)


def _vehicle(vehicle: HourVehicle, step_s: float, begin_s: float) -> Motion:
    lane, first = vehicle.plan.lane, vehicle.first_step
    driven: list[tuple[int, float, float]] = []
    if first is not None:
        states = zip(vehicle.xs, vehicle.speeds, strict=True)
        driven = [(first + number, x, speed) for number, (x, speed) in enumerate(states)]
    before = [state for state in vehicle.path if first is None or state[0] < first]
    after = [state for state in vehicle.path if driven and state[0] > driven[-1][0]]
    gains: list[float | None] = [
        (later[2] - state[2]) / step_s for state, later in pairwise(driven)
    ]
    rows = [*before, *driven, *after]
    accelerations = [
        *[None] * len(before),
        *gains,
        *[None] * (len(rows) - len(before) - len(gains)),
    ]
    sign = lane.direction.sign
    return (
        [step * step_s - begin_s for step, _, _ in rows],
        [sign * x for _, x, _ in rows],
        [lane.centre_m] * len(rows),
        [speed for _, _, speed in rows],
        accelerations,
    )
