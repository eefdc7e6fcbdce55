"""Takes the user's own rows (csv or parquet) and returns candidate rows of the model's variables.

A file has one row per encounter and instant, in SI units. It needs the columns ``range_m`` (R),
``vehicle_speed_mps`` (v), ``pedestrian_speed_mps`` (v_p), and ``time_advantage_s`` (T_adv) or
``lateral_m`` (L), from which T_adv is computed. Optional columns are ``source``, ``clip``,
``vehicle`` and ``pedestrian`` (rows cannot be weighted by encounter or vehicle without them),
``time_s``, ``crossing_angle_deg``, ``passed_first`` (vehicle, pedestrian or empty), ``pet_s``, and
``track`` (from ``harness extract``). Other columns are ignored and listed in the counts. Rows are
not resampled; the bounds on R, L, v, v_p and T_adv apply.
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
    ExtractionRules,
    Options,
    with_times,
)

NEEDED = ("range_m", "vehicle_speed_mps", "pedestrian_speed_mps")
# The file's T_adv may be rounded, or computed from speeds over another window.
RELATIVE_TOLERANCE, ABSOLUTE_TOLERANCE_S = 0.05, 0.05


class TableOptions(Options):
    """``source`` names the data set of rows without a source; the default is the file's name."""

    source: str | None = None


def read_rows(
    paths: Sequence[Path], options: TableOptions, _: ExtractionRules, tally: Tally
) -> pd.DataFrame:
    """Read the candidate rows of csv or parquet files, or of folders of them, in their order.

    Returns:
        A frame with ``ROW_COLUMNS``; a missing optional column is null.

    Raises:
        InputError: there is no file, a file is unreadable, or a needed column is missing or has no
            number.
    """

    def read(_: str, file: Path) -> list[pd.DataFrame]:
        return [_read_file(file, options.source or file.stem, tally)]

    files = [(file.name, file) for path in paths for file in files_in(path, "*.csv", "*.parquet")]
    frames: list[pd.DataFrame] = list(contents_of(files, read, tally, "row"))
    return pd.concat(frames, ignore_index=True)


def _read_file(path: Path, source: str, tally: Tally) -> pd.DataFrame:
    """The rows of one file, with all of ``ROW_COLUMNS``."""
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
        problem = f"column 'passed_first' contains {word!r}"
        raise InputError(str(path), problem, "vehicle, pedestrian, empty")
    return _complete(rows, tally)


def _complete(rows: pd.DataFrame, tally: Tally) -> pd.DataFrame:
    """Rows with arrival time and time advantage; incomplete and contradictory rows are dropped."""
    recorded = rows["time_advantage_s"]
    rows = with_times(rows)
    computed = rows["time_advantage_s"]
    tolerance = ABSOLUTE_TOLERANCE_S + RELATIVE_TOLERANCE * computed
    contradictory = (recorded - computed).abs() > tolerance
    rows["time_advantage_s"] = recorded.fillna(computed)
    incomplete = rows[[*NEEDED, "time_advantage_s"]].isna().any(axis=1) & ~contradictory
    tally.candidates += int((incomplete | contradictory).sum())
    tally.drop("candidates", "incomplete", incomplete.sum())
    tally.drop("candidates", "contradictory", contradictory.sum())
    return rows.loc[~(incomplete | contradictory), list(ROW_COLUMNS)]
