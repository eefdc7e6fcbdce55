"""Takes raw trajectories and returns rows of the model's variables."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from harness.core.errors import InputError, unknown_name
from harness.core.files import write_file
from harness.model.trajectories import mobileye, ready_rows, vci
from harness.model.trajectories.counting import Tally
from harness.model.trajectories.csv_input import as_paths
from harness.model.trajectories.encounters import CANDIDATE_COLUMNS, candidate_rows
from harness.model.trajectories.extraction_rules import (
    ROW_COLUMNS,
    TEXT_COLUMNS,
    ExtractionRules,
    kept_rows,
    split_options,
    with_times,
)
from harness.model.trajectories.mobileye import MobileyeOptions
from harness.model.trajectories.ready_rows import TableOptions
from harness.model.trajectories.tracks import Clip
from harness.model.trajectories.vci import VciOptions

VEHICLE_KEY = ("source", "clip", "vehicle")
ENCOUNTER_KEY = (*VEHICLE_KEY, "pedestrian")
EXTRACTION_KEY = b"harness.extraction"
"""Key of the command and the counts in the metadata of a Parquet file of rows."""


class Format(NamedTuple):
    """The reader of a data format.

    Attributes:
        words: a description in one line.
        options: the class of the reader's options.
        clips: yields the clips (tracks); None if the data are no tracks.
        rows: returns candidate rows; None if rows come from tracks.
    """

    words: str
    options: type[Any]
    clips: Callable[[Sequence[Path], Any, Tally], Iterator[Clip]] | None = None
    rows: Callable[[Sequence[Path], Any, ExtractionRules, Tally], pd.DataFrame] | None = None


FORMATS: Mapping[str, Format] = {
    "vci": Format("fixed camera, DUT and sets like it", VciOptions, vci.read_clips),
    "mobileye": Format("the paper's sensor", MobileyeOptions, rows=mobileye.read_rows),
    "table": Format("ready-made rows, csv or parquet", TableOptions, rows=ready_rows.read_rows),
}


@dataclass(frozen=True, eq=False)
class Extraction:
    """The rows of an extraction and the counts of what was left out.

    Attributes:
        rows: one row per encounter and sampling instant, with ``ROW_COLUMNS``, sorted by source
            path, clip, vehicle, pedestrian and time. Missing values are null.
        counts: numbers of used and excluded items.
    """

    rows: pd.DataFrame
    counts: Tally


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
        candidates = _typed(known.rows(files, reader, rules, tally))
    else:
        # Without pairs there are no rows, but the columns are the same.
        frames = [pd.DataFrame(columns=CANDIDATE_COLUMNS)]
        for clip in known.clips(files, reader, tally) if known.clips else ():
            frames += candidate_rows(clip, rules, tally)
        candidates = _typed(with_times(pd.concat(frames[1:] or frames, ignore_index=True)))
    rows, seen = kept_rows(candidates, rules, tally), _groups(candidates, ENCOUNTER_KEY)
    tally.rows, tally.pairs = len(rows), _groups(rows, ENCOUNTER_KEY)
    tally.vehicles = _groups(rows, VEHICLE_KEY)
    if tally.pairs is not None and seen is not None:
        tally.drop("pairs", "no_row_kept", seen - tally.pairs)
    return Extraction(rows, tally)


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
    about = {"command": command, "counts": asdict(extraction.counts)}
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
    """The tracks of recordings.

    Args:
        paths, format, **options: as for ``extract``.
        tally: counts what is left out and notes assumptions.

    Returns:
        The usable clips in their fixed order.

    Raises:
        InputError: as for ``extract``, or the format has no tracks.
    """
    known = _known_format(format)
    if known.clips is None:
        raise InputError(f"format {format}", "has rows, not tracks")
    _, reader = split_options(options, known.options, f"format {format}")
    return list(known.clips(as_paths(paths), reader, Tally() if tally is None else tally))


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
