"""Outcomes of episodes in, or columns of a simulation; the rows of a run's tables out."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pyarrow as pa

from harness.core.vocabulary import Arm, Crossing, FloatArray, Side, Trace, Walk
from harness.measures import Outcome
from harness.measures.motion.walking import cleared_s, states_at
from harness.results.tables import EPISODES, PEDESTRIANS, TABLES_OF, TRACES, Row, Tables

_RECORDED = EPISODES.schema.names[EPISODES.schema.get_field_index("ending") :]
_NUMBERS = TRACES.schema.names[TRACES.schema.get_field_index("x_m") :]

StateColumns = tuple[FloatArray | Sequence[float | None], ...]
"""Aligned columns of one object: time, x, y, speed and acceleration."""


def encounter_rows(cell: int, outcomes: Sequence[Outcome], *, traces: bool) -> Tables:
    """The rows of some episodes of a cell in every table of a run."""
    tables = {EPISODES.name: episode_rows(cell, outcomes)}
    tables[PEDESTRIANS.name] = pedestrian_rows(cell, outcomes)
    return tables | ({TRACES.name: trace_rows(cell, outcomes)} if traces else {})


def simulation_rows(
    cell: int, pair: int, arm: Arm, columns: Mapping[str, Mapping[str, Sequence[object]]]
) -> Tables:
    """The rows of one simulation in every table of a run.

    Args:
        cell, pair, arm: which simulation.
        columns: the columns of each table by name, without cell, pair and arm.  A simulation that
            failed has only ``arms``.
    """
    keys, tables = {"cell": cell, "pair": pair, "arm": arm.value}, {}
    for table in TABLES_OF["simulations"]:
        own = columns.get(table.name, {})
        rows = zip(*own.values(), strict=True)
        tables[table.name] = table.of([keys | dict(zip(own, row, strict=True)) for row in rows])
    return tables


def episode_rows(cell: int, outcomes: Sequence[Outcome]) -> pa.Table:
    """The rows of ``episodes``."""

    def row(outcome: Outcome) -> Row:
        recorded = {name: getattr(outcome.record, name) for name in _RECORDED}
        return {**_keys(cell, outcome), "strategy": outcome.strategy, **recorded}

    return EPISODES.of([*map(row, outcomes)])


def pedestrian_rows(cell: int, outcomes: Sequence[Outcome]) -> pa.Table:
    """The rows of ``pedestrians``: everyone who arrived within the record."""
    rows = [
        _keys(cell, outcome) | _pedestrian(walk, outcome.trace.crossing, end_s)
        for outcome in outcomes
        if (end_s := outcome.record.end_s) is not None
        for walk in outcome.trace.walks
        if walk.arrival.arrival_s <= end_s
    ]
    return PEDESTRIANS.of(rows)


def trace_rows(cell: int, outcomes: Sequence[Outcome]) -> pa.Table:
    """The rows of ``traces``: the ego's bumper and every pedestrian's centre.

    There is a row for each step of the record, with the acceleration of the step that begins there
    (null in the last row).  Pedestrians have rows from stepping off until the other kerb.
    ``shown-<index>`` is a pedestrian as the strategy perceived them, if it did with errors.
    """
    parts = [TRACES.schema.empty_table()]
    for outcome in outcomes:
        for name, motion in _motions(outcome):
            columns = {
                key: pa.repeat(pa.scalar(value, TRACES.schema.field(key).type), len(motion[0]))
                for key, value in {**_keys(cell, outcome), "object": name}.items()
            }
            numbers = zip(("time_s", *_NUMBERS), motion, strict=True)
            columns |= {key: pa.array(values, pa.float64()) for key, values in numbers}
            parts.append(pa.table(columns, schema=TRACES.schema))
    return pa.concat_tables(parts).combine_chunks()


def _keys(cell: int, outcome: Outcome) -> Row:
    return {"cell": cell, "pair": outcome.pair, "arm": outcome.arm.value}


def _pedestrian(walk: Walk, crossing: Crossing, end_s: float) -> Row:
    """The row of a pedestrian of an episode whose record ends at ``end_s``, without the keys."""
    arrival, start_s = walk.arrival, walk.start_s
    waited = ("index", "arrival_s", "quantile", "critical_gap_s", "threshold_s", "latency_s")
    row: Row = {name: getattr(arrival, name) for name in waited} | {"side": arrival.side.value}
    if start_s is None or start_s >= end_s:
        return row
    over_s = cleared_s(walk, crossing)
    started = ("start_s", "speed_mps", "range_m", "vehicle_speed_mps")
    return {**row, **{name: getattr(walk, name) for name in started}} | {
        "cleared_s": over_s if over_s is not None and over_s <= end_s else None,
        "legs": walk.legs and [leg._asdict() for leg in walk.legs],
        "delay_s": start_s - arrival.arrival_s,
    }


def _motions(outcome: Outcome) -> Iterator[tuple[str, StateColumns]]:
    """Yield each object of an episode's record with its states at the steps."""
    trace, record = outcome.trace, outcome.record
    if record.end_s is None or record.steps is None:
        return  # the episode failed before its first state
    count = record.steps + 1
    times = np.arange(count, dtype=np.float64) * trace.step_s
    speeds = trace.speed_mps[:count]
    accelerations = [*(np.diff(speeds) / trace.step_s).tolist(), None]
    lane = np.full(count, trace.crossing.lane_centre_m)
    yield "ego", (times, trace.x_m[:count], lane, speeds, accelerations)
    for walk in trace.walks:
        if walk.start_s is None or walk.start_s >= record.end_s:
            continue
        since = times[times >= walk.start_s]
        x, y, speed, gain = states_at(walk, trace.crossing, since)
        on = y <= trace.crossing.length_m if walk.arrival.side is Side.NEAR else y >= 0
        motion = tuple(values[on] for values in (since, x, y, speed, gain))
        yield f"pedestrian-{walk.arrival.index}", motion
    for index, states in _shown_states(trace, times).items():
        yield f"shown-{index}", tuple(zip(*states, strict=True))


def _shown_states(trace: Trace, times: FloatArray) -> dict[int, list[tuple[float | None, ...]]]:
    """The perceived states of each pedestrian by index, for the times at which they were shown."""
    states: dict[int, list[tuple[float | None, ...]]] = {}
    for time, views in zip(times.tolist(), trace.shown or (), strict=False):
        for view in views:
            y_m = trace.crossing.place_of(view.side, view.remaining_m)
            states.setdefault(view.index, []).append((time, 0.0, y_m, view.speed_mps, None))
    return states
