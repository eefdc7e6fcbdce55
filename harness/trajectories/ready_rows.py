"""Reader of rows a user already has: csv or parquet, one row per encounter and instant.

Needed columns, SI units: ``range_m`` (R), ``vehicle_speed_mps`` (v), ``pedestrian_speed_mps``
(v_p), and ``time_advantage_s`` (T_adv) or ``lateral_m`` (L) to compute it from. Optional:
``source``, ``clip``, ``vehicle``, ``pedestrian`` (without them rows cannot be weighted by encounter
or vehicle), ``time_s``, ``crossing_angle_deg``, ``passed_first`` (vehicle, pedestrian or empty),
``pet_s``, ``track`` (as ``harness extract`` writes it). Other columns are ignored and named in the
counts. Rows are taken as they are, not resampled; the bounds on R, L, v, v_p and T_adv apply.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from harness.errors import InputError
from harness.trajectories.counting import Tally
from harness.trajectories.csv_input import (
    LARGEST_NUMBER,
    EmptyTableError,
    identifiers,
    read_table,
    refuse_no_number,
    require_columns,
)
from harness.trajectories.extraction_rules import ROW_COLUMNS, TEXT_COLUMNS, with_times

NEEDED = ("range_m", "vehicle_speed_mps", "pedestrian_speed_mps")
# A given T_adv may have been rounded, or computed from speeds of another window.
RELATIVE_TOLERANCE, ABSOLUTE_TOLERANCE_S = 0.05, 0.05


@dataclass(frozen=True)
class TableOptions:
    """Nothing but a name.

    Attributes:
        source: name of the data set for rows that have none; by default the file's name.
    """

    source: str | None = None


def read_rows(paths: Sequence[Path], options: TableOptions, tally: Tally) -> pd.DataFrame:
    """The candidate rows of the given files, in the files' order.

    Args:
        paths: csv or parquet files, or folders whose csv and parquet files are read by name.
        options: name of the data set.
        tally: counts what is left out.

    Returns:
        A frame with ``ROW_COLUMNS``; an optional column that is not there is null.

    Raises:
        InputError: no file, an unreadable one, a needed column missing or without any number.
    """
    frames = []
    for path in paths:
        files = [path]
        if path.is_dir():
            files = sorted([*path.glob("*.csv"), *path.glob("*.parquet")])
        if not files:
            raise InputError(str(path), "folder without tables", "*.csv or *.parquet files")
        for file in files:
            try:
                frames.append(_read_file(file, options.source or file.stem, tally))
            except EmptyTableError as problem:
                tally.skipped[file.name] = problem.problem
    if not frames:
        raise InputError(str(paths[0]), f"no row can be used ({tally.why_skipped()})")
    return pd.concat(frames, ignore_index=True)


def _read_file(path: Path, source: str, tally: Tally) -> pd.DataFrame:
    """The rows of one file with all columns of the common form."""
    table = read_table(path)
    require_columns(path, table, NEEDED)
    if "lateral_m" not in table and "time_advantage_s" not in table:
        neither = "has neither column 'time_advantage_s' nor 'lateral_m'"
        raise InputError(str(path), neither, "at least one of them")
    ignored = [name for name in table.columns if name not in ROW_COLUMNS]
    if ignored:
        tally.note(f"{path.name}: columns not used: {', '.join(ignored)}")
    rows = pd.DataFrame(index=table.index)
    for name in ROW_COLUMNS:
        if name in TEXT_COLUMNS:
            text = table[name] if name in table else pd.Series(pd.NA, table.index, dtype="str")
            rows[name] = identifiers(text)
        else:
            rows[name] = _number(path, table, name)
    rows["source"] = rows["source"].fillna(source)
    _check_passed_first(path, rows["passed_first"])
    return _complete(rows, tally)


def _number(path: Path, table: pd.DataFrame, name: str) -> pd.Series:
    """A numeric column, null where a cell is unusable; refused when it holds no number at all."""
    if name not in table:
        return pd.Series(np.nan, table.index)
    values = pd.to_numeric(table[name], errors="coerce").astype(np.float64)
    refuse_no_number(path, table[name], values)
    return values.where(values.abs() <= LARGEST_NUMBER)


def _check_passed_first(path: Path, passed: pd.Series) -> None:
    """Refuse a value that is neither of the two words nor empty."""
    wrong = passed.dropna()[~passed.dropna().isin(["vehicle", "pedestrian"])]
    if len(wrong):
        raise InputError(
            str(path),
            f"column 'passed_first' holds {wrong.iloc[0]!r}",
            "vehicle, pedestrian, empty",
        )


def _complete(rows: pd.DataFrame, tally: Tally) -> pd.DataFrame:
    """Rows with arrival time and time advantage; incomplete or contradictory ones are counted."""
    given = rows["time_advantage_s"]
    rows = with_times(rows)
    computed = rows["time_advantage_s"]
    tolerance = ABSOLUTE_TOLERANCE_S + RELATIVE_TOLERANCE * computed
    contradictory = (given - computed).abs() > tolerance
    rows["time_advantage_s"] = given.fillna(computed)
    incomplete = rows[[*NEEDED, "time_advantage_s"]].isna().any(axis=1) & ~contradictory
    tally.candidates += int((incomplete | contradictory).sum())
    tally.drop("candidates", "incomplete", int(incomplete.sum()))
    tally.drop("candidates", "contradictory", int(contradictory.sum()))
    return rows.loc[~(incomplete | contradictory), list(ROW_COLUMNS)]
