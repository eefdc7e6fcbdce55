"""Raw trajectories in; rows of the model's variables, and counts of what was left out, out."""

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from harness.core.documents import as_plain, check_form
from harness.core.errors import InputError, refused_at, unknown_name
from harness.core.files import write_file
from harness.model.trajectories.encounters import candidate_rows
from harness.model.trajectories.formats import FORMATS, File, Format
from harness.model.trajectories.rules import (
    ROW_COLUMNS,
    TEXT_COLUMNS,
    Counts,
    ExtractionRules,
    Tally,
    kept_rows,
    with_times,
)
from harness.model.trajectories.table import EmptyTableError
from harness.model.trajectories.tracks import Clip

VEHICLE_KEY = ("source", "clip", "vehicle")
ENCOUNTER_KEY = (*VEHICLE_KEY, "pedestrian")
"""The columns that identify a vehicle, and an encounter."""
EXTRACTION_KEY = b"harness.extraction"
"""Key of the command and the counts in the metadata of a Parquet file of rows."""

Paths = str | Path | Sequence[str | Path]


@dataclass(frozen=True, eq=False)
class Extraction:
    """The rows of an extraction and the counts of what was left out.

    Attributes:
        rows: one row per encounter and sampling instant, with ``ROW_COLUMNS``, sorted by source
            path, clip, vehicle, pedestrian and time.  Missing values are null.  The frame belongs
            to whoever asked for it.
        counts: numbers of used and excluded items.
    """

    rows: pd.DataFrame
    counts: Counts


def extract(paths: Paths, format_: str, **options: Any) -> Extraction:
    """Read raw data and return the rows of the model's variables.

    A pair is a vehicle and a pedestrian whose paths cross at an allowed angle.  The conflict point
    is the first crossing along the vehicle's path.  R is the path length from the front bumper to
    the conflict point.  L is the pedestrian's distance from the line of the vehicle's path there;
    it is positive before they pass the line.  v and v_p are the rates at which R and L decrease.
    The arrival time is R / v, and the time advantage is T_adv = |R/v − L/v_p| (the paper's section
    on variables).  The ``mobileye`` format takes R, L, v and v_p from the sensor, ``table`` from
    the file.

    Args:
        paths: files or folders; the format determines which files are read.
        format_: a key of ``FORMATS``.
        **options: fields of ``ExtractionRules``, or of the format's own options.

    Returns:
        Rows and counts; ``rows`` is empty if nothing passes the rules.

    Raises:
        InputError: the format or an option is unknown, there is no data, or the data has another
            format.
    """
    tally, frames = Tally(), list[pd.DataFrame]()
    rules, contents = _contents(paths, format_, options, tally)
    for content in contents:
        frames += candidate_rows(content, rules, tally) if isinstance(content, Clip) else [content]
    candidates = pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()
    types = {name: "str" if name in TEXT_COLUMNS else "float64" for name in ROW_COLUMNS}
    candidates = with_times(candidates.reindex(columns=list(ROW_COLUMNS)).astype(types))
    rows, seen = kept_rows(candidates, rules, tally), _groups(candidates, ENCOUNTER_KEY)
    pairs, vehicles = (_groups(rows, key) for key in (ENCOUNTER_KEY, VEHICLE_KEY))
    if pairs is not None and seen is not None:
        tally.drop("pairs", "no_row_kept", seen - pairs)
    return Extraction(rows, Counts(**vars(tally), rows=len(rows), vehicles=vehicles, pairs=pairs))


def read_clips(paths: Paths, format_: str, tally: Tally, **options: Any) -> list[Clip]:
    """The tracks of recordings.

    Args:
        paths, format_, **options: as for ``extract``.
        tally: counts what is left out and notes assumptions.

    Returns:
        The usable clips in their fixed order.

    Raises:
        InputError: as for ``extract``, or the format has no tracks.
    """
    _, contents = _contents(paths, format_, options, tally)
    if not FORMATS[format_].clips:
        raise InputError(f"format {format_}", "has rows, not tracks")
    return [content for content in contents if isinstance(content, Clip)]


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
    about = {"command": command, "counts": as_plain(vars(extraction.counts))}
    metadata = {**(table.schema.metadata or {}), EXTRACTION_KEY: json.dumps(about).encode()}
    buffer = pa.BufferOutputStream()
    pq.write_table(table.replace_schema_metadata(metadata), buffer)
    write_file(path, buffer.getvalue().to_pybytes())


def _contents(
    paths: Paths, format_: str, options: Mapping[str, Any], tally: Tally
) -> tuple[ExtractionRules, list[Clip | pd.DataFrame]]:
    """The rules, and what the files contain; empty files are skipped and counted."""
    if format_ not in FORMATS:
        raise unknown_name("format", "format", format_, FORMATS)
    known = FORMATS[format_]
    with refused_at(f"format {format_}:"):
        rules = check_form(known.options, options, f"format {format_}")
    given = [paths] if isinstance(paths, str | Path) else list(paths)
    if not given:
        raise InputError("paths", "no file or folder given", "at least one")
    contents, files = [], [file for path in given for file in _files(path, known)]
    times = Counter(file.name for file in files)
    for file in files:
        if times[file.name] > 1:  # equal names get their path
            file = file._replace(name=_without(file.path.as_posix(), known))
        try:
            contents.append(known.read(file, rules, tally))
        except EmptyTableError as problem:
            tally.skipped[file.name] = f"{Path(problem.where).name}: {problem.problem}"
    if not contents:
        why = "; ".join(tally.skipped.values())
        raise InputError(str(given[0]), f"no file can be used ({why})")
    return rules, contents


def _files(given: str | Path, known: Format) -> list[File]:
    """The file itself, or the matching files of a folder by name."""
    # Unlike Path.exists, this is False for a name that is too long or contains a NUL.
    if not os.path.exists(given):  # noqa: PTH110
        raise InputError(str(given), "no such file or folder")
    path, allowed = Path(given), " or ".join(f"*{ending}" for ending in known.endings)
    if path.is_file():
        if not path.name.endswith(known.endings):
            raise InputError(str(path), "not a file of this format", allowed)
        return [File(path, _without(path.name, known), path)]
    files = [file for ending in known.endings for file in path.rglob(f"*{ending}")]
    if not files:
        raise InputError(str(path), "has no such file", allowed)
    pairs = sorted((_without(file.name, known), file) for file in files)
    return [File(path, *pair) for pair in pairs]


def _without(name: str, known: Format) -> str:
    """A file's name without the ending of its format."""
    return name[: -max(len(ending) for ending in known.endings if name.endswith(ending))]


def _groups(rows: pd.DataFrame, key: Sequence[str]) -> int | None:
    """Number of distinct vehicles or encounters; None if a row does not identify them."""
    if rows[list(key)].isna().any(axis=None):
        return None
    return len(rows[list(key)].drop_duplicates())
