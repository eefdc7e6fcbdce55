"""The tables of a run: schemas, and how outcomes become rows.  Columns: docs/files.md.

Schemas are fixed; a missing value is null, never 0, -1 or infinity.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from harness.encounter import Arm, Leg, Side
from harness.files import cannot_write, whole_file
from harness.measures import MEASURES, Outcome
from harness.motion.walking import cleared_s, states_at

SCHEMA = 2
"""Version of the run folder's format."""

_KEYS = [("cell", pa.int32()), ("pair", pa.int64()), ("arm", pa.string())]

_TYPES = {float: pa.float64(), int: pa.int32(), bool: pa.bool_()}
_MEASURES = {measure.column: _TYPES[measure.kind] for measure in MEASURES}
_FACTS = {
    "strategy": pa.string(),
    "ending": pa.string(),
    "reason": pa.string(),
    "pass_time_s": _MEASURES["pass_time_s"],
    "contact": pa.string(),
    "contact_index": pa.int32(),
    "contact_time_s": pa.float64(),
    "contact_speed_mps": _MEASURES["contact_speed_mps"],
    "sumo_collision": pa.bool_(),
    "fallback": pa.bool_(),
    "steps": pa.int32(),
    "pedestrians": pa.int32(),
}

EPISODES = pa.schema([*_KEYS, *(_FACTS | _MEASURES).items()])

_LEG = pa.struct([(name, pa.float64()) for name in Leg._fields])

PEDESTRIANS = pa.schema(
    [
        *_KEYS,
        ("index", pa.int32()),
        ("arrival_s", pa.float64()),
        ("start_s", pa.float64()),
        ("side", pa.string()),
        ("quantile", pa.float64()),
        ("critical_gap_s", pa.float64()),
        ("speed_mps", pa.float64()),
        ("range_m", pa.float64()),
        ("vehicle_speed_mps", pa.float64()),
        ("cleared_s", pa.float64()),
        ("legs", pa.list_(_LEG)),
    ]
)

PAIRS = pa.schema(
    [
        ("cell", pa.int32()),
        ("pair", pa.int64()),
        ("av_time_s", pa.float64()),
        ("human_time_s", pa.float64()),
        ("tau", pa.float64()),
    ]
)

TRACES = pa.schema(
    [
        *_KEYS,
        ("time_s", pa.float64()),
        ("object", pa.string()),
        ("x_m", pa.float64()),
        ("y_m", pa.float64()),
        ("speed_mps", pa.float64()),
        ("acceleration_mps2", pa.float64()),
    ]
)

TABLES = {
    "episodes": EPISODES,
    "pedestrians": PEDESTRIANS,
    "pairs": PAIRS,
    "traces": TRACES,
}
"""Every table with a fixed schema, by name; ``cells`` depends on what a study varies."""

_ROW_GROUP = 100_000

_RECORD_COLUMNS = EPISODES.names[EPISODES.get_field_index("ending") :]


def table_of(name: str, rows: Mapping[str, Sequence[Any]]) -> pa.Table:
    """Columns as the table of that name in ``TABLES``."""
    schema = TABLES[name]
    columns = [pa.array(rows[field.name], type=field.type) for field in schema]
    return pa.table(columns, schema=schema)


def write_parquet(path: Path, schema: pa.Schema, parts: Iterator[pa.Table]) -> None:
    """Write one Parquet table whole, from parts of any size, in row groups of a fixed size.

    Raises:
        HarnessError: the file system refuses.
    """
    try:
        with whole_file(path) as beside, pq.ParquetWriter(beside, schema) as writer:
            rest = schema.empty_table()
            for part in parts:
                rest = pa.concat_tables([rest, part.cast(schema)])
                while rest.num_rows >= _ROW_GROUP:
                    writer.write_table(rest.slice(0, _ROW_GROUP).combine_chunks())
                    rest = rest.slice(_ROW_GROUP)
            if rest.num_rows:
                writer.write_table(rest.combine_chunks())
    except OSError as error:
        raise cannot_write(path, error) from None


def episode_rows(cell: int, outcomes: Iterable[Outcome]) -> dict[str, list[Any]]:
    """Columns of ``episodes.parquet``."""
    rows: dict[str, list[Any]] = {name: [] for name in EPISODES.names}
    for outcome in outcomes:
        rows["cell"].append(cell)
        rows["pair"].append(outcome.pair)
        rows["arm"].append(outcome.arm.value)
        rows["strategy"].append(outcome.strategy)
        for name in _RECORD_COLUMNS:
            rows[name].append(getattr(outcome.record, name))
    return rows


def pedestrian_rows(cell: int, outcomes: Iterable[Outcome]) -> dict[str, list[Any]]:
    """Columns of ``pedestrians.parquet``: everyone who arrived within the record."""
    rows: dict[str, list[Any]] = {name: [] for name in PEDESTRIANS.names}
    for outcome in outcomes:
        end_s = outcome.record.end_s
        for walk in outcome.trace.walks:
            arrival = walk.arrival
            if arrival.arrival_s > end_s:
                continue
            went = walk.start_s is not None and walk.start_s < end_s
            cleared = cleared_s(walk, outcome.trace.crossing) if went else None
            legs = walk.legs if went else None
            values = {
                "cell": cell,
                "pair": outcome.pair,
                "arm": outcome.arm.value,
                "index": arrival.index,
                "arrival_s": arrival.arrival_s,
                "start_s": walk.start_s if went else None,
                "side": arrival.side.value,
                "quantile": arrival.quantile,
                "critical_gap_s": arrival.critical_gap_s,
                "speed_mps": walk.speed_mps if went else None,
                "range_m": walk.range_m if went else None,
                "vehicle_speed_mps": walk.vehicle_speed_mps if went else None,
                "cleared_s": cleared if cleared is not None and cleared <= end_s else None,
                "legs": legs and [leg._asdict() for leg in legs],
            }
            for name, value in values.items():
                rows[name].append(value)
    return rows


def pair_rows(cell: int, episodes: pa.Table) -> dict[str, list[Any]]:
    """Columns of ``pairs.parquet`` from the episodes of one cell."""
    rows: dict[str, list[Any]] = {name: [] for name in PAIRS.names}
    times: dict[int, dict[str, float | None]] = {}
    columns = (episodes[name].to_pylist() for name in ("pair", "arm", "pass_time_s"))
    for pair, arm, time in zip(*columns, strict=True):
        times.setdefault(pair, {})[arm] = time
    for pair, arms in times.items():
        av, human = arms[Arm.AV], arms[Arm.HUMAN]
        rows["cell"].append(cell)
        rows["pair"].append(pair)
        rows["av_time_s"].append(av)
        rows["human_time_s"].append(human)
        rows["tau"].append(None if av is None or human is None else av / human)
    return rows


def trace_rows(cell: int, outcomes: Iterable[Outcome]) -> dict[str, list[Any]]:
    """Columns of ``traces.parquet``: the ego's bumper and every pedestrian's centre.

    At each step of the record, with the acceleration of the step that begins there (null at the
    last); a pedestrian has rows from when he stepped off to the other kerb.
    """
    rows: dict[str, list[Any]] = {name: [] for name in TRACES.names}
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
    return rows


def _extend(
    rows: dict[str, list[Any]], cell: int, outcome: Outcome, name: str, columns: list[list[Any]]
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
