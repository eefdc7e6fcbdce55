"""Reader of rows a user already has: csv or parquet, one row per encounter and instant.

Needed columns, SI units: ``range_m`` (R), ``vehicle_speed_mps`` (v), ``pedestrian_speed_mps``
(v_p), and ``time_advantage_s`` (T_adv) or ``lateral_m`` (L) to compute it from. Optional:
``source``, ``clip``, ``vehicle``, ``pedestrian`` (without them rows cannot be weighted by encounter
or vehicle), ``time_s``, ``crossing_angle_deg``, ``passed_first`` (vehicle, pedestrian or empty),
``pet_s``, ``track`` (as ``harness extract`` writes it). Other columns are ignored and named in the
counts. Rows are taken as they are, not resampled; the bounds on R, L, v, v_p and T_adv apply.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from harness.core.errors import InputError
from harness.model.trajectories.counting import Tally
from harness.model.trajectories.csv_input import (
    LARGEST_NUMBER,
    as_numbers,
    contents_of,
    files_in,
    identifiers,
    read_table,
    require_columns,
)
from harness.model.trajectories.extraction_rules import (
    ROW_COLUMNS,
    TEXT_COLUMNS,
    Options,
    with_times,
)

NEEDED = ("range_m", "vehicle_speed_mps", "pedestrian_speed_mps")
# A given T_adv may have been rounded, or computed from speeds of another window.
RELATIVE_TOLERANCE, ABSOLUTE_TOLERANCE_S = 0.05, 0.05


class TableOptions(Options):
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

    def read(_: str, file: Path) -> list[pd.DataFrame]:
        return [_read_file(file, options.source or file.stem, tally)]

    files = [(file.name, file) for path in paths for file in files_in(path, "*.csv", "*.parquet")]
    frames: list[pd.DataFrame] = list(contents_of(files, read, tally, "row"))
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
        elif name in table:
            values = as_numbers(path, table[name])
            rows[name] = values.where(values.abs() <= LARGEST_NUMBER)
        else:
            rows[name] = np.nan
    rows["source"] = rows["source"].fillna(source)
    passed = rows["passed_first"].dropna()
    for word in passed[~passed.isin(["vehicle", "pedestrian"])]:
        problem = f"column 'passed_first' holds {word!r}"
        raise InputError(str(path), problem, "vehicle, pedestrian, empty")
    return _complete(rows, tally)


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
