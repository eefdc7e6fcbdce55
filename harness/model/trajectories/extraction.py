"""Takes raw trajectories and returns rows of the model's variables."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from harness.core.errors import InputError, unknown_name
from harness.core.files import write_file
from harness.model.trajectories.counting import Counts, Tally, freeze
from harness.model.trajectories.csv_input import as_paths
from harness.model.trajectories.encounters import CANDIDATE_COLUMNS, candidate_rows
from harness.model.trajectories.extraction_rules import (
    ROW_COLUMNS,
    TEXT_COLUMNS,
    kept_rows,
    split_options,
    with_times,
)
from harness.model.trajectories.formats import FORMATS, Format
from harness.model.trajectories.tracks import Clip

VEHICLE_KEY = ("source", "clip", "vehicle")
ENCOUNTER_KEY = (*VEHICLE_KEY, "pedestrian")
EXTRACTION_KEY = b"harness.extraction"
"""Key of the command and the counts in the metadata of a Parquet file of rows."""

SUMMARISED = (
    "range_m", "lateral_m", "vehicle_speed_mps", "pedestrian_speed_mps",
    "arrival_time_s", "time_advantage_s", "crossing_angle_deg", "pet_s",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Extraction:
    """The rows of an extraction and the counts of what was left out.

    Attributes:
        rows: one row per encounter and sampling instant, with ``ROW_COLUMNS``, sorted by source
            path, clip, vehicle, pedestrian and time. Missing values are null.
        counts: numbers of used and excluded items, see ``Counts``.
    """

    rows: pd.DataFrame
    counts: Counts


def extract(paths: str | Path | Sequence[str | Path], format: str, **options: Any) -> Extraction:
    """Read raw data and return the rows of the model's variables.

    A pair is a vehicle and a pedestrian whose paths cross at an allowed angle. The conflict point
    is the first crossing along the vehicle's path. R is the path length from the front bumper to
    the conflict point. L is the pedestrian's distance from the line of the vehicle's path there; it
    is positive before they pass the line. v and v_p are the rates at which R and L decrease. The
    arrival time is R / v, and the time advantage is T_adv = |R/v − L/v_p| (the paper's section on
    variables). The ``mobileye`` format takes R, L, v and v_p from the sensor, ``table`` from the
    file.

    Args:
        paths: files or folders; the format determines which files are read.
        format: a key of ``FORMATS``.
        **options: fields of ``ExtractionRules``, or of the format's own options.

    Returns:
        Rows and counts; ``rows`` is empty if nothing passes the rules.

    Raises:
        InputError: the format or an option is unknown, there is no data, or the data has another
            format.
    """
    known = _known_format(format)
    rules, reader = split_options(options, known.options, f"format {format}")
    tally, files = Tally(), as_paths(paths)
    if known.rows is not None:
        candidates = _typed(known.rows(files, reader, tally))
    else:
        # Without pairs there are no rows, but the columns are the same.
        frames = [pd.DataFrame(columns=CANDIDATE_COLUMNS)]
        for clip in known.clips(files, reader, tally) if known.clips else ():
            frames += candidate_rows(clip, rules, tally)
        candidates = _typed(with_times(pd.concat(frames[1:] or frames, ignore_index=True)))
    rows = kept_rows(candidates, rules, tally)
    vehicles, pairs = _groups(rows, VEHICLE_KEY), _groups(rows, ENCOUNTER_KEY)
    candidate_pairs = _groups(candidates, ENCOUNTER_KEY)
    if pairs is not None and candidate_pairs is not None:
        tally.drop("pairs", "no_row_kept", candidate_pairs - pairs)
    return Extraction(rows, freeze(tally, len(rows), vehicles, pairs))


def write_rows(path: Path, extraction: Extraction, command: str) -> None:
    """Write the rows as Parquet, with the command and the counts in its metadata.

    Args:
        path: the file; it is written completely or not at all.
        extraction: rows and counts.
        command: the command that made the rows, for a model's card.

    Raises:
        HarnessError: the file cannot be written.
    """
    table = pa.Table.from_pandas(extraction.rows, preserve_index=False)
    about = {"command": command, "counts": extraction.counts.as_dict()}
    metadata = {**(table.schema.metadata or {}), EXTRACTION_KEY: json.dumps(about).encode()}
    buffer = pa.BufferOutputStream()
    pq.write_table(table.replace_schema_metadata(metadata), buffer)
    write_file(path, buffer.getvalue().to_pybytes())


def read_clips(
    paths: str | Path | Sequence[str | Path],
    format: str,
    tally: Tally | None = None,
    **options: Any,
) -> list[Clip]:
    """The tracks of an extraction, for figures.

    Args:
        paths, format, **options: as for ``extract``.
        tally: counts what is left out and notes assumptions.

    Returns:
        The usable clips in their fixed order.

    Raises:
        InputError: as for ``extract``, or the format is ``table``, which has no tracks.
    """
    known = _known_format(format)
    if known.clips is None:
        raise InputError(f"format {format}", "has rows, not tracks")
    _, reader = split_options(options, known.options, f"format {format}")
    return list(known.clips(as_paths(paths), reader, Tally() if tally is None else tally))


def summary(extraction: Extraction) -> dict[str, Any]:
    """Figures of an extraction as plain data (JSON-ready).

    Returns:
        ``rows``, ``vehicles``, ``encounters``; ``quartiles``: column → n, min, q25, median, q75,
        max over its rows (null where a column is empty); ``rows_per_vehicle``: min, median, max;
        ``five_busiest_vehicles``: their share of the rows and of the encounters, 0–1;
        ``passed_first``: encounters by who passed first; ``counts``: everything that was left out.
        Figures that need identifiers are null if the rows have none.
    """
    rows, counts = extraction.rows, extraction.counts
    encounters = rows.drop_duplicates(list(ENCOUNTER_KEY))
    rows_each = rows.groupby(list(VEHICLE_KEY)).size()
    encounters_each = encounters.groupby(list(VEHICLE_KEY)).size()
    first = encounters["passed_first"].fillna("unknown").value_counts()
    by_vehicle: dict[str, Any] = {
        "rows_per_vehicle": rows_each.agg(["min", "median", "max"]).astype(float).to_dict(),
        "five_busiest_vehicles": {
            "rows": float(rows_each.nlargest(5).sum() / max(len(rows), 1)),
            "encounters": float(encounters_each.nlargest(5).sum() / max(len(encounters), 1)),
        },
        "passed_first": {
            name: int(first.get(name, 0)) for name in ("vehicle", "pedestrian", "unknown")
        },
    }
    if counts.vehicles is None or counts.pairs is None or rows.empty:
        by_vehicle = dict.fromkeys(by_vehicle)
    return {
        "rows": counts.rows,
        "vehicles": counts.vehicles,
        "encounters": counts.pairs,
        "quartiles": {name: _quartiles(rows[name]) for name in SUMMARISED},
        **by_vehicle,
        "counts": counts.as_dict(),
    }


def _known_format(name: str) -> Format:
    """The format of that name; an error names the most similar one."""
    if name not in FORMATS:
        raise unknown_name("format", "format", name, FORMATS)
    return FORMATS[name]


def _typed(rows: pd.DataFrame) -> pd.DataFrame:
    """The columns in their order with fixed types, also if there are no rows."""
    types = {name: "str" if name in TEXT_COLUMNS else "float64" for name in ROW_COLUMNS}
    return rows[list(ROW_COLUMNS)].astype(types).reset_index(drop=True)


def _groups(rows: pd.DataFrame, key: Sequence[str]) -> int | None:
    """Number of distinct vehicles or encounters; None if a row does not identify them."""
    if rows[list(key)].isna().any(axis=None):
        return None
    return len(rows[list(key)].drop_duplicates())


def _quartiles(column: pd.Series[float]) -> dict[str, float | int | None]:
    """Count, minimum, quartiles and maximum of a column; null if it is empty."""
    shares = {"min": 0.0, "q25": 0.25, "median": 0.5, "q75": 0.75, "max": 1.0}
    quartiles = column.quantile([*shares.values()]).tolist() if column.notna().any() else [None] * 5
    return {"n": int(column.count()), **dict(zip(shares, quartiles, strict=True))}
