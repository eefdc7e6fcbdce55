"""The rows of an episode in the tables of its run."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pyarrow as pa

from harness.encounter import Arm, FloatArray, Side, Trace
from harness.measures import Outcome
from harness.motion.walking import cleared_s, states_at
from harness.results.tables import (
    AUDIT,
    EPISODES,
    PAIRS,
    PEDESTRIANS,
    TRACES,
    Columns,
    columns_of,
)
from harness.results.walk_rows import pedestrian_row

_RECORD_COLUMNS = EPISODES.names[EPISODES.get_field_index("ending") :]


def _keys(cell: int, outcome: Outcome) -> dict[str, Any]:
    """The columns that say which episode a row is of."""
    return {"cell": cell, "pair": outcome.pair, "arm": outcome.arm.value}


def episode_rows(cell: int, outcomes: Iterable[Outcome]) -> Columns:
    """Columns of ``episodes.parquet``."""
    return columns_of(
        EPISODES,
        (
            _keys(cell, outcome)
            | {"strategy": outcome.strategy}
            | {name: getattr(outcome.record, name) for name in _RECORD_COLUMNS}
            for outcome in outcomes
        ),
    )


def pedestrian_rows(cell: int, outcomes: Iterable[Outcome]) -> Columns:
    """Columns of ``pedestrians.parquet``: everyone who arrived within the record."""
    return columns_of(
        PEDESTRIANS,
        (
            _keys(cell, outcome)
            | pedestrian_row(walk, cleared_s(walk, outcome.trace.crossing), outcome.record.end_s)
            for outcome in outcomes
            for walk in outcome.trace.walks
            if walk.arrival.arrival_s <= outcome.record.end_s
        ),
    )


def audit_rows(
    cell: int, audited: Iterable[tuple[Outcome, tuple[str | None, float | None]]]
) -> Columns:
    """Columns of ``audit.parquet``: every episode that was repeated in SUMO, and what differs.

    Args:
        cell: its number.
        audited: the episodes, each with what differs and when a tie of its strategy made it so.
    """
    return columns_of(
        AUDIT,
        (
            _keys(cell, outcome) | {"difference": difference, "tie_s": tie_s}
            for outcome, (difference, tie_s) in audited
        ),
    )


def pair_rows(cell: int, episodes: pa.Table) -> Columns:
    """Columns of ``pairs.parquet`` from the episodes of one cell."""
    times: dict[int, dict[str, float | None]] = {}
    columns = (episodes[name].to_pylist() for name in ("pair", "arm", "pass_time_s"))
    for pair, arm, time in zip(*columns, strict=True):
        times.setdefault(pair, {})[arm] = time
    rows: list[dict[str, Any]] = []
    for pair, arms in times.items():
        av, human = arms[Arm.AV], arms[Arm.HUMAN]
        tau = None if av is None or human is None else av / human
        rows.append(
            {"cell": cell, "pair": pair, "av_time_s": av, "human_time_s": human, "tau": tau}
        )
    return columns_of(PAIRS, rows)


def trace_rows(cell: int, outcomes: Iterable[Outcome]) -> Columns:
    """Columns of ``traces.parquet``: the ego's bumper and every pedestrian's centre.

    There is a row at each step of the record, with the acceleration of the step that begins there
    (null at the last).  A pedestrian has rows from when they stepped off until they reach the other
    kerb.  Where perception errs, ``shown-<index>`` is a pedestrian as the strategy was shown them.
    """
    rows = columns_of(TRACES, ())
    for outcome in outcomes:
        trace, end_s = outcome.trace, outcome.record.end_s
        if not len(trace.x_m):
            continue  # failed before there was a state
        count = outcome.record.steps + 1
        times = np.arange(count, dtype=np.float64) * trace.step_s
        speeds = trace.speed_mps[:count]
        accelerations: list[float | None] = (np.diff(speeds) / trace.step_s).tolist()
        lane = [trace.crossing.lane_centre_m] * count
        _extend(
            rows,
            cell,
            outcome,
            "ego",
            [
                times.tolist(),
                trace.x_m[:count].tolist(),
                lane,
                speeds.tolist(),
                [*accelerations, None],
            ],
        )
        for walk in trace.walks:
            if walk.start_s is None or walk.start_s >= end_s:
                continue
            since = times[times >= walk.start_s]
            x, y, speed, gain = states_at(walk, trace.crossing, since)
            near = walk.arrival.side is Side.NEAR
            on = y <= trace.crossing.length_m if near else y >= 0
            columns = [values[on].tolist() for values in (since, x, y, speed, gain)]
            _extend(rows, cell, outcome, f"pedestrian-{walk.arrival.index}", columns)
        for index, columns in _shown(trace, times).items():
            _extend(rows, cell, outcome, f"shown-{index}", columns)
    return rows


def _shown(trace: Trace, times: FloatArray) -> dict[int, list[list[Any]]]:
    """Columns of everyone a strategy was shown, by index, at the times when they were."""
    columns: dict[int, list[list[Any]]] = {}
    for time, views in zip(times.tolist(), trace.shown or (), strict=False):
        for view in views:
            y_m = trace.crossing.place_of(view.side, view.remaining_m)
            values = (time, 0.0, y_m, view.speed_mps, None)
            for column, value in zip(
                columns.setdefault(view.index, [[] for _ in values]), values, strict=True
            ):
                column.append(value)
    return columns


def _extend(
    rows: Columns, cell: int, outcome: Outcome, name: str, columns: list[list[Any]]
) -> None:
    count = len(columns[0])
    rows["cell"] += [cell] * count
    rows["pair"] += [outcome.pair] * count
    rows["arm"] += [outcome.arm.value] * count
    rows["object"] += [name] * count
    for key, column in zip(
        ("time_s", "x_m", "y_m", "speed_mps", "acceleration_mps2"), columns, strict=True
    ):
        rows[key] += column
