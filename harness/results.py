"""The run folder: tables, summary, manifest, log.  The one place that knows its files.

Files appear complete or not at all (written beside, then renamed).  Tables have fixed schemas and
row groups, so equal results are equal bytes on one set of versions.  Columns: docs/files.md.
"""

import csv
import importlib.metadata
import io
import json
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from harness.comparison import Interval, PairColumns, Summary
from harness.encounter import Arm, Contact, Ending, Side
from harness.errors import InputError
from harness.measures import EpisodeRecord, Outcome

SCHEMA = 1
"""Version of the run folder's format."""

MANIFEST = "manifest.json"

_ROW_GROUP = 100_000

_KEYS = [("cell", pa.int32()), ("pair", pa.int64()), ("arm", pa.string())]

EPISODES = pa.schema(
    [
        *_KEYS,
        ("strategy", pa.string()),
        ("ending", pa.string()),
        ("reason", pa.string()),
        ("pass_time_s", pa.float64()),
        ("contact", pa.string()),
        ("contact_index", pa.int32()),
        ("contact_time_s", pa.float64()),
        ("contact_speed_mps", pa.float64()),
        ("sumo_collision", pa.bool_()),
        ("fallback", pa.bool_()),
        ("steps", pa.int32()),
        ("pedestrians", pa.int32()),
        ("min_gap_m", pa.float64()),
        ("min_ttc_s", pa.float64()),
        ("min_time_advantage_s", pa.float64()),
        ("pet_s", pa.float64()),
        ("max_deceleration_mps2", pa.float64()),
        ("stopped_s", pa.float64()),
        ("delay_s", pa.float64()),
    ]
)

PEDESTRIANS = pa.schema(
    [
        *_KEYS,
        ("index", pa.int32()),
        ("arrival_s", pa.float64()),
        ("start_s", pa.float64()),
        ("side", pa.string()),
        ("quantile", pa.float64()),
        ("speed_mps", pa.float64()),
        ("range_m", pa.float64()),
        ("vehicle_speed_mps", pa.float64()),
        ("cleared_s", pa.float64()),
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

CELLS = pa.schema([("cell", pa.int32())])
"""Before the varied keys of a sweep, which follow as further columns."""

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

_RECORD_COLUMNS = [field.name for field in fields(EpisodeRecord) if field.name in EPISODES.names]


def new_run_folder(out: Path | None, scenario_name: str) -> Path:
    """The folder a run may write into; made if it is missing.

    Args:
        out: the user's choice, or None for ``runs/<scenario>-<next free number>``.
        scenario_name: used for the default.

    Raises:
        InputError: it holds a run already, is a file, or cannot be written.
    """
    if out is not None:
        _claim(out, exist_ok=True)
        return out
    number = 1
    while True:
        folder = Path("runs") / f"{scenario_name}-{number}"
        if not folder.exists():
            _claim(folder, exist_ok=False)
            return folder
        number += 1


def _claim(folder: Path, exist_ok: bool) -> None:
    where = f"--out {folder}"
    if folder.exists() and not folder.is_dir():
        raise InputError(where, "is a file", "a new or empty folder")
    if (folder / MANIFEST).exists():
        raise InputError(where, "holds a run already", "a new or empty folder")
    try:
        folder.mkdir(parents=True, exist_ok=exist_ok)
        probe = folder / f".{os.getpid()}.probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            where, f"cannot be written ({error.strerror})", "a writable folder"
        ) from None


def write_file(path: Path, content: bytes) -> None:
    """Write beside, then rename."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        beside.write_bytes(content)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def write_table(path: Path, schema: pa.Schema, rows: Mapping[str, Sequence[Any]]) -> None:
    """Write one Parquet table with a fixed schema and row groups."""
    table = pa.table(
        [pa.array(rows[name], type=schema.field(name).type) for name in schema.names], schema=schema
    )
    buffer = io.BytesIO()
    pq.write_table(table, buffer, row_group_size=_ROW_GROUP)
    write_file(path, buffer.getvalue())


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
            cleared = None
            if went and walk.start_s is not None and walk.speed_mps is not None:
                cleared = walk.start_s + outcome.trace.crossing.length_m / walk.speed_mps
            values = {
                "cell": cell,
                "pair": outcome.pair,
                "arm": outcome.arm.value,
                "index": arrival.index,
                "arrival_s": arrival.arrival_s,
                "start_s": walk.start_s if went else None,
                "side": arrival.side.value,
                "quantile": arrival.quantile,
                "speed_mps": walk.speed_mps if went else None,
                "range_m": walk.range_m if went else None,
                "vehicle_speed_mps": walk.vehicle_speed_mps if went else None,
                "cleared_s": cleared if cleared is not None and cleared <= end_s else None,
            }
            for name, value in values.items():
                rows[name].append(value)
    return rows


def pair_rows(cell: int, episodes: Mapping[str, Sequence[Any]]) -> dict[str, list[Any]]:
    """Columns of ``pairs.parquet`` from those of ``episodes.parquet``."""
    rows: dict[str, list[Any]] = {name: [] for name in PAIRS.names}
    times: dict[int, dict[str, float | None]] = {}
    for pair, arm, time in zip(
        episodes["pair"], episodes["arm"], episodes["pass_time_s"], strict=True
    ):
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
    last); a pedestrian has rows while he is on the crossing.
    """
    rows: dict[str, list[Any]] = {name: [] for name in TRACES.names}
    for outcome in outcomes:
        trace, end_s = outcome.trace, outcome.record.end_s
        count = outcome.record.steps + 1
        times = np.arange(count) * trace.step_s
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
            if walk.start_s is None or walk.speed_mps is None or walk.start_s >= end_s:
                continue
            progress = walk.speed_mps * (times - walk.start_s)
            on = (progress >= 0) & (progress <= trace.crossing.length_m)
            far = walk.arrival.side is Side.FAR
            y = trace.crossing.length_m - progress[on] if far else progress[on]
            number = int(on.sum())
            columns = [
                times[on].tolist(),
                [0.0] * number,
                y.tolist(),
                [walk.speed_mps] * number,
                [0.0] * number,
            ]
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


def pair_columns(episodes: Mapping[str, Sequence[Any]]) -> PairColumns:
    """What the comparison needs, from the columns of ``episodes.parquet``."""
    arms = np.array(episodes["arm"])
    ending = np.array(episodes["ending"])
    contact = np.array(episodes["contact"], dtype=object)
    passed = np.array(episodes["pass_time_s"], dtype=float)
    av, human = arms == Arm.AV, arms == Arm.HUMAN
    crashed = ending == Ending.CRASHED
    pedestrians = np.array(episodes["pedestrians"], dtype=np.int64)
    return PairColumns(
        av_time_s=passed[av],
        human_time_s=passed[human],
        av_crashed=crashed[av],
        av_front=crashed[av] & (contact[av] == Contact.FRONT),
        av_timed_out=ending[av] == Ending.TIMED_OUT,
        av_failed=ending[av] == Ending.ENGINE_FAILED,
        human_crashed=crashed[human],
        human_timed_out=ending[human] == Ending.TIMED_OUT,
        human_failed=ending[human] == Ending.ENGINE_FAILED,
        av_fallback=np.array(episodes["fallback"], dtype=bool)[av],
        met=pedestrians[av] + pedestrians[human],
    )


def summary_row(summary: Summary) -> dict[str, float | int | None]:
    """A summary as the columns of ``summary.csv``; an interval becomes three."""
    row: dict[str, float | int | None] = {}
    for field in fields(Summary):
        value = getattr(summary, field.name)
        if isinstance(value, Interval):
            row[field.name] = value.value
            row[f"{field.name}_ci_low"] = value.low
            row[f"{field.name}_ci_high"] = value.high
        else:
            row[field.name] = value
    return row


def write_summary(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write ``summary.csv``; undefined values are empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_file(path, text.getvalue().encode())


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a JSON file, keys in the order given."""
    write_file(path, (json.dumps(document, indent=1, allow_nan=False) + "\n").encode())


class EventLog:
    """``log.jsonl``: what happened when.  The only file of a run folder with a clock in it."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "log.jsonl"

    def write(self, event: str, **details: Any) -> None:
        """Append one line."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"time": now, "event": event, **details})
        with self._path.open("a", encoding="utf-8") as file:
            file.write(line + "\n")


def versions() -> dict[str, str]:
    """Versions that decide what a run computes."""
    packages = ("crosswalk-harness", "libsumo", "numpy", "scipy", "pandas", "pyarrow")
    found = {name: importlib.metadata.version(name) for name in packages}
    return {
        "harness": found.pop("crosswalk-harness"),
        "sumo": found.pop("libsumo"),
        "python": platform.python_version(),
        **found,
    }


def export_csv(folder: Path) -> list[Path]:
    """Write every table of a run folder as CSV beside it.

    Raises:
        InputError: no run folder, or a table cannot be read.
    """
    if not (folder / MANIFEST).is_file():
        raise InputError(str(folder), "is no run folder", f"a folder with {MANIFEST}")
    written = []
    for source in sorted(folder.glob("*.parquet")):
        try:
            table = pq.read_table(source)
        except (OSError, pa.ArrowException) as error:
            raise InputError(str(source), f"cannot be read ({error})") from None
        target = source.with_suffix(".csv")
        write_file(target, table.to_pandas().to_csv(index=False, lineterminator="\n").encode())
        written.append(target)
    return written
