"""Recomputes the measures of hours of traffic from their traces."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from harness.core.encounter import Arm, FloatArray, Trace
from harness.core.errors import InputError
from harness.measures import measure
from harness.scenario import Cell
from harness.store.hour_tables import passage_counts, record_row
from harness.store.hour_traces import stored_traces
from harness.store.reading import read_table
from harness.store.schemas import hour_tables
from harness.store.tables import Row, table_of

_States = dict[str, tuple[FloatArray, FloatArray, FloatArray]]
Tables = dict[str, pa.Table]


def score_hours(run: Path, cell: Cell, traced: bool) -> Iterator[tuple[int, int, Tables]]:
    """Yield the tables of a cell pair by pair, with recomputed measures and counts.

    Args:
        run: a finished run of hours of traffic.
        cell: the cell with the new conflict thresholds.
        traced: whether the run kept traces; without traces the measures stay as they are.

    Yields:
        The first pair, the number of pairs, and their tables.

    Raises:
        InputError: a table cannot be read, or a passage has no trace.
    """
    names = hour_tables(traces=traced)
    hours = read_table(run, "hours", cell.number)
    for pair in dict.fromkeys(hours["pair"].to_pylist()):
        tables = {name: read_table(run, name, cell.number, pair) for name in names}
        passages = tables["passages"].to_pylist()
        if traced:
            passages = _measured(run, cell, tables, passages)
        counted = [
            row if row["reason"] is not None else row | _counts(cell, passages, row["arm"])
            for row in tables["hours"].to_pylist()
        ]
        tables["passages"] = table_of("passages", passages)
        tables["hours"] = table_of("hours", counted)
        yield pair, 1, tables


def _counts(cell: Cell, passages: Sequence[Row], arm: str) -> dict[str, float | None]:
    arm_passages = [row for row in passages if row["arm"] == arm]
    return passage_counts(arm_passages, cell.scenario.conflicts)


def _measured(
    run: Path, cell: Cell, tables: dict[str, pa.Table], passages: Sequence[Row]
) -> list[Row]:
    """Return the rows of ``passages`` in order, with the measures of their traces."""
    scored: dict[tuple[str, int], Row] = {}
    walks = tables["walks"].to_pylist()
    for arm in Arm:
        arm_passages = [row for row in passages if row["arm"] == arm.value]
        arm_walks = [row for row in walks if row["arm"] == arm.value]
        try:
            states = _states(tables["traces"], arm)
            traces = list(stored_traces(cell.scenario, arm_passages, arm_walks, states))
        except (KeyError, IndexError):
            raise InputError(str(run), "a passage has no trace", "a whole run") from None
        for alike in _by_lane_and_type(traces):
            records = measure([trace for _, trace in alike])
            for (row, _), record in zip(alike, records, strict=True):
                scored[arm.value, row["vehicle"]] = dict(row) | record_row(record)
    return [scored.get((row["arm"], row["vehicle"]), row) for row in passages]


def _by_lane_and_type(
    traces: Sequence[tuple[Any, Trace | None]],
) -> Iterator[list[tuple[Any, Trace]]]:
    """Group rows with a trace by lane and type, because each group is measured together."""
    groups: dict[tuple[str, int, str | None], list[tuple[Any, Trace]]] = {}
    for row, trace in traces:
        if trace is not None:
            key = row["direction"], row["lane"], row["type"]
            groups.setdefault(key, []).append((row, trace))
    yield from groups.values()


def _states(traces: pa.Table, arm: Arm) -> _States:
    """Return time, x and speed of every object of one arm, by the object's name."""
    arms, objects = traces["arm"].to_pylist(), traces["object"].to_pylist()
    columns = [traces[name].to_numpy() for name in ("time_s", "x_m", "speed_mps")]
    rows_by_object: dict[str, list[int]] = {}
    for number, (row_arm, name) in enumerate(zip(arms, objects, strict=True)):
        if row_arm == arm.value:
            rows_by_object.setdefault(name, []).append(number)
    return {
        name: (columns[0][rows], columns[1][rows], columns[2][rows])
        for name, rows in ((name, np.array(numbers)) for name, numbers in rows_by_object.items())
    }
