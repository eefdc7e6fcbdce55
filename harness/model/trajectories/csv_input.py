"""Reads tables with named columns and units from the user's files."""

import difflib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
import pyarrow as pa

from harness.core.errors import InputError
from harness.model.trajectories.counting import Tally

# Larger coordinates, speeds and times are errors, and would overflow later.
LARGEST_NUMBER = 1e12


Content = TypeVar("Content")


class EmptyTableError(InputError):
    """A file is missing or has no record; its clip is skipped and counted."""


def as_paths(paths: str | Path | Sequence[str | Path]) -> list[Path]:
    """The user's paths.

    Raises:
        InputError: there is no path, or a path does not exist.
    """
    names = [paths] if isinstance(paths, str | Path) else list(paths)
    if not names:
        raise InputError("paths", "no file or folder given", "at least one")
    for name in names:
        # Unlike Path.exists, this is False for a name that is too long or contains a NUL.
        if not os.path.exists(name):  # noqa: PTH110
            raise InputError(str(name), "no such file or folder")
    return [Path(name) for name in names]


def files_in(path: Path, *patterns: str) -> list[Path]:
    """The file itself, or the matching files of a folder, sorted by name.

    Raises:
        InputError: the folder has no such file.
    """
    if not path.is_dir():
        return [path]
    files = sorted(file for pattern in patterns for file in path.glob(pattern))
    if not files:
        raise InputError(str(path), "has no such file", " or ".join(patterns))
    return files


def contents_of(
    files: Iterable[tuple[str, Path]],
    read: Callable[[str, Path], list[Content]],
    tally: Tally,
    what: str,
) -> Iterator[Content]:
    """Yield what ``read`` returns for each named file; empty files are skipped and counted.

    Raises:
        InputError: no file has usable contents; ``what`` is their name, such as "clip".
    """
    where, used = "", False
    for name, file in files:
        where = where or str(file)
        try:
            contents = read(name, file)
        except EmptyTableError as problem:
            file_name = Path(problem.where).name
            tally.skipped[name] = f"{file_name}: " * (file_name != name) + problem.problem
            continue
        used = used or bool(contents)
        yield from contents
    if not used:
        why = "; ".join(f"{name}: {reason}" for name, reason in tally.skipped.items())
        raise InputError(where, f"no {what} can be used ({why or 'no record is left'})")


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
    except (OSError, ValueError, pa.ArrowException) as problem:  # ParserError is a ValueError
        first_line = (str(problem).splitlines() or [type(problem).__name__])[0]
        raise InputError(str(path), f"cannot be read as a table: {first_line}") from None
    table.columns = pd.Index([str(name).strip() for name in table.columns])
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


def read_records(
    path: Path, columns: Mapping[str, tuple[str, float]], tally: Tally, names: Sequence[str] = ()
) -> pd.DataFrame:
    """The usable records of a table: named columns of numbers in SI units.

    A record with an unusable number is counted as ``not_a_number``, ``missing_value`` or
    ``out_of_scale``.

    Args:
        path: the file.
        columns: name here → name in the file, and by what its numbers are divided.
        tally: counts what is left out.
        names: further columns, which are not read as numbers.

    Raises:
        InputError: the file is no table, lacks a column, or a column contains no number at all.
    """
    table, units = read_table(path), [unit for _, unit in columns.values()]
    require_columns(path, table, [*names, *(name for name, _ in columns.values())])
    values = pd.DataFrame({of: as_numbers(path, table[name]) for of, (name, _) in columns.items()})
    given = table[[name for name, _ in columns.values()]].notna().to_numpy()
    text = (values.isna() & given).any(axis=1)
    finite = pd.Series(np.isfinite(values.to_numpy()).all(axis=1), index=values.index)
    usable = finite & (values.abs() <= LARGEST_NUMBER).all(axis=1)
    tally.drop("records", "not_a_number", text.sum())
    tally.drop("records", "missing_value", (~finite & ~text).sum())
    tally.drop("records", "out_of_scale", (finite & ~usable).sum())
    scaled = values / units
    return table[[*names]].assign(**{of: scaled[of] for of in columns})[usable]


def as_numbers(path: Path, column: pd.Series) -> pd.Series:
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


def once_each(records: pd.DataFrame, clock: str, tally: Tally) -> pd.DataFrame:
    """Records sorted by time; the first of each instant is kept, the others are counted."""
    records = records.sort_values(clock, kind="stable")
    repeated = records[clock].duplicated()
    tally.drop("records", "duplicated", repeated.sum())
    return records.loc[~repeated]


def identifiers(column: pd.Series) -> pd.Series:
    """Identifiers as text; a missing identifier stays missing.

    Whole numbers lose the ``.0`` that a missing cell elsewhere in the column adds.

    Raises:
        InputError: the column has bytes that are not text.
    """
    try:
        text = column.astype("str")
    except UnicodeDecodeError:
        raise InputError(f"column {column.name!r}", "contains bytes", "text or numbers") from None
    if pd.api.types.is_float_dtype(column):
        values = column.to_numpy(dtype=np.float64, na_value=np.nan)
        with np.errstate(invalid="ignore"):
            whole = (values % 1 == 0) & (np.abs(values) < 2**53)
        text[whole] = column[whole].astype("Int64").astype("str")
    return text.where(column.notna())


def in_order(names: Iterable[str]) -> list[str]:
    """Identifiers in a fixed order: numbers by value first, then text."""

    def key(name: str) -> tuple[bool, float, str]:
        try:
            return False, float(name), name
        except ValueError:
            return True, 0.0, name

    return sorted(names, key=key)
