"""Reads a table with named columns and units from a user's file."""

import difflib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from harness.core.errors import InputError
from harness.model.trajectories.rules import Tally

_LARGEST_NUMBER = 1e12
"""Larger coordinates, speeds and times are errors, and would overflow later."""

Columns = Mapping[str, tuple[str, float]]
"""Name here → name in the file, and by what its numbers are divided to have SI units."""


class EmptyTableError(InputError):
    """A file is missing or has no record; its clip is skipped and counted."""


def read_table(path: Path) -> pd.DataFrame:
    """The table of a csv or parquet file, with stripped column names.

    Raises:
        EmptyTableError: the file has no record.
        InputError: the file cannot be read as a table.
    """
    try:
        if path.suffix.lower() == ".parquet":
            table = pd.read_parquet(path)
        else:
            table = pd.read_csv(path, encoding="utf-8-sig", low_memory=False)
    except pd.errors.EmptyDataError:
        raise EmptyTableError(str(path), "the file is empty") from None
    except Exception as problem:  # what a damaged file's metadata make Pandas raise may be anything
        first_line = (str(problem).splitlines() or [type(problem).__name__])[0]
        raise InputError(str(path), f"cannot be read as a table: {first_line}") from None
    table.columns = pd.Index([str(name).strip() for name in table.columns])
    for name in table.columns[table.columns.duplicated()]:
        raise InputError(str(path), f"column {name!r} occurs twice", "each column once")
    if table.empty:
        raise EmptyTableError(str(path), "the file has no record")
    return table


def require_columns(path: Path, table: pd.DataFrame, needed: Iterable[str]) -> None:
    """Raise if a column is missing; the message names the most similar column of the file."""
    others = {name.lower(): name for name in reversed(table.columns) if name not in needed}
    for name in needed:
        if name not in table:
            near = difflib.get_close_matches(name.lower(), others, 1, 0.6)
            problem = f"column {name!r} is missing"
            if near:
                problem += f" (the file has {others[near[0]]!r})"
            allowed = f"columns {', '.join(needed)}"
            raise InputError(str(path), problem, allowed, name if near else None)


def read_records(path: Path, columns: Columns, tally: Tally, *names: str) -> pd.DataFrame:
    """The usable records of a file.

    A record with an unusable number is counted as ``not_a_number``, ``missing_value`` or
    ``out_of_scale``.

    Args:
        path: the file.
        columns: its needed columns of numbers.
        tally: counts what is left out.
        names: further needed columns, of identifiers; they may be missing in a record.

    Raises:
        InputError: the file is no table, lacks a column, or a column contains no number at all.
    """
    table, units = read_table(path), [unit for _, unit in columns.values()]
    require_columns(path, table, [*names, *(name for name, _ in columns.values())])
    values = pd.DataFrame({key: numbers(path, table[name]) for key, (name, _) in columns.items()})
    given = table[[name for name, _ in columns.values()]].notna().to_numpy()
    text = (values.isna() & given).any(axis=1)
    finite = pd.Series(np.isfinite(values.to_numpy()).all(axis=1), index=values.index)
    usable = finite & (values.abs() <= _LARGEST_NUMBER).all(axis=1)
    tally.drop("records", "not_a_number", text.sum())
    tally.drop("records", "missing_value", (~finite & ~text).sum())
    tally.drop("records", "out_of_scale", (finite & ~usable).sum())
    identified = {name: identifiers(path, table[name]) for name in names}
    return (values / units).assign(**identified)[usable]


def numbers(path: Path, column: pd.Series) -> pd.Series:
    """A column as floats; cells that are not numbers become NaN.

    Raises:
        InputError: no cell is a number.
    """
    try:
        values = pd.to_numeric(column, errors="coerce")
    except OverflowError:
        # An integer beyond the range of floats becomes infinite if it is parsed as text.
        values = pd.to_numeric(column.astype(str), errors="coerce")
    if values.isna().all() and column.notna().any():
        sample = column.dropna().iloc[0]
        raise InputError(str(path), f"column {column.name!r} contains {sample!r}", "numbers")
    return values.astype(np.float64)


def identifiers(path: Path, column: pd.Series) -> pd.Series:
    """Identifiers as text; a missing identifier stays missing.

    Whole numbers lose the ``.0`` that a missing cell elsewhere in the column adds.

    Raises:
        InputError: the column has bytes that are not text.
    """
    try:
        text = column.astype("str")
    except UnicodeDecodeError:
        problem = f"column {column.name!r} contains bytes"
        raise InputError(path, problem, "text or numbers") from None
    if pd.api.types.is_float_dtype(column):
        values = column.to_numpy(dtype=np.float64, na_value=np.nan)
        with np.errstate(invalid="ignore"):
            whole = (values % 1 == 0) & (np.abs(values) < 2**53)
        text[whole] = column[whole].astype("Int64").astype("str")
    return text.where(column.notna())


def objects(records: pd.DataFrame, name: str, tally: Tally) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield the records of each object in order of time, with the first of each instant.

    Objects come in the order of their identifiers, numbers by value before text.

    Args:
        records: usable records with ``time_s``.
        name: the column with the object's identifier.
        tally: counts records without an identifier, and repeated ones.
    """
    tally.drop("records", "missing_value", records[name].isna().sum())
    groups = {str(key): group for key, group in records.groupby(name)}
    order = pd.DataFrame({"name": list(groups), "number": pd.to_numeric([*groups], "coerce")})
    for key in order.sort_values(["number", "name"])["name"]:
        group = groups[key].sort_values("time_s", kind="stable")
        repeated = group["time_s"].duplicated()
        tally.drop("records", "duplicated", repeated.sum())
        yield key, group.loc[~repeated]
