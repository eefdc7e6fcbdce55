"""Reading tables of numbers that other people wrote."""

import difflib
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
import pyarrow as pa

from harness.core.errors import InputError
from harness.model.trajectories.counting import Tally

# No coordinate, speed or clock reading of such data is larger; what is would only overflow later.
LARGEST_NUMBER = 1e12


Content = TypeVar("Content")


class EmptyTableError(InputError):
    """A file that is missing or has no record; its clip is skipped, and the counts say so."""


def as_paths(paths: str | Path | Sequence[str | Path]) -> list[Path]:
    """The user's paths, each of which must exist."""
    given = [paths] if isinstance(paths, str | Path) else list(paths)
    if not given:
        raise InputError("paths", "no file or folder given", "at least one")
    found = [Path(path) for path in given]
    for path in found:
        try:
            exists = path.exists()
        except (OSError, ValueError):
            # A name that no file can have: too long, or with a NUL in it.
            exists = False
        if not exists:
            raise InputError(str(path), "no such file or folder")
    return found


def files_in(path: Path, *patterns: str) -> list[Path]:
    """The file itself, or the files of a folder whose names match, sorted.

    Raises:
        InputError: the folder has none.
    """
    if not path.is_dir():
        return [path]
    files = sorted(file for pattern in patterns for file in path.glob(pattern))
    if not files:
        raise InputError(str(path), "folder without such files", " or ".join(patterns))
    return files


def contents_of(
    files: Iterable[tuple[str, Path]],
    read: Callable[[str, Path], list[Content]],
    tally: Tally,
    what: str,
) -> Iterator[Content]:
    """What is in named files, one after the other; empty files are skipped and counted.

    Args:
        files: name for the counts, and path.
        read: gives the clips or tables of a file.
        tally: counts the files that are skipped.
        what: a clip, a trip or a row, for the message.

    Raises:
        InputError: nothing in any of the files can be used.
    """
    where, used = "", False
    for name, file in files:
        where = where or str(file)
        try:
            contents = read(name, file)
        except EmptyTableError as problem:
            culprit = Path(problem.where).name
            tally.skipped[name] = f"{culprit}: " * (culprit != name) + problem.problem
            continue
        used = used or bool(contents)
        yield from contents
    if not used:
        why = "; ".join(f"{name}: {reason}" for name, reason in tally.skipped.items())
        raise InputError(where, f"no {what} can be used ({why or 'no record is left'})")


def read_table(path: Path) -> pd.DataFrame:
    """A csv or parquet file as it is, column names stripped.

    Raises:
        EmptyTableError: the file holds no record.
        InputError: it cannot be read as a table.
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
        raise EmptyTableError(str(path), "the file holds no record")
    return table


def require_columns(path: Path, table: pd.DataFrame, needed: Iterable[str]) -> None:
    """Refuse a table that lacks a column, naming the one in the file that comes nearest."""
    present = list(table.columns)
    for name in needed:
        if name not in present:
            taken = set(needed)
            near = difflib.get_close_matches(
                name.lower(), [have.lower() for have in present if have not in taken], 1, 0.6
            )
            nearest = next((have for have in present if near and have.lower() == near[0]), None)
            raise InputError(
                str(path),
                f"column {name!r} is missing" + (f" (the file has {nearest!r})" if nearest else ""),
                f"columns {', '.join(needed)}",
                name if nearest else None,
            )


def numbers(path: Path, table: pd.DataFrame, names: Sequence[str], tally: Tally) -> pd.DataFrame:
    """The named columns as floats; records with an unusable cell are dropped and counted.

    Args:
        path: the file, for messages.
        table: as read.
        names: columns that must hold numbers.
        tally: counts ``not_a_number``, ``missing_value`` and ``out_of_scale``.

    Returns:
        The remaining records, other columns unchanged, original order and index.

    Raises:
        InputError: a column holds not a single number.
    """
    values = pd.DataFrame({name: as_numbers(path, table[name]) for name in names})
    text = (values.isna() & table[list(names)].notna()).any(axis=1)
    finite = pd.Series(np.isfinite(values.to_numpy()).all(axis=1), index=values.index)
    usable = finite & (values.abs() <= LARGEST_NUMBER).all(axis=1)
    tally.drop("records", "not_a_number", int(text.sum()))
    tally.drop("records", "missing_value", int((~finite & ~text).sum()))
    tally.drop("records", "out_of_scale", int((finite & ~usable).sum()))
    table = table.assign(**{name: values[name] for name in names})
    return table[usable]


def as_numbers(path: Path, column: pd.Series) -> pd.Series:
    """A column as floats, NaN where a cell is no number.

    Raises:
        InputError: not a single cell is a number.
    """
    try:
        values = pd.to_numeric(column, errors="coerce")
    except OverflowError:
        # A whole number beyond a float's range; as text it becomes infinite.
        values = pd.to_numeric(column.astype(str), errors="coerce")
    if values.isna().all() and column.notna().any():
        sample = column.dropna().iloc[0]
        raise InputError(str(path), f"column {column.name!r} holds {sample!r}", "numbers")
    return values.astype(np.float64)


def once_each(records: pd.DataFrame, clock: str, tally: Tally) -> pd.DataFrame:
    """Records in the order of their clock, the first of each instant; the others are counted."""
    tally.out_of_order += int((records[clock].diff() < 0).sum())
    records = records.sort_values(clock, kind="stable")
    repeated = records[clock].duplicated()
    tally.drop("records", "duplicated", int(repeated.sum()))
    return records.loc[~repeated]


def identifiers(column: pd.Series) -> pd.Series:
    """Identifiers as text; whole numbers lose the ``.0`` that an odd cell elsewhere gives them.

    A missing identifier stays missing.

    Raises:
        InputError: they are bytes that are no text.
    """
    try:
        text = column.astype("str")
    except UnicodeDecodeError:
        raise InputError(f"column {column.name!r}", "holds bytes", "text or numbers") from None
    if pd.api.types.is_float_dtype(column):
        values = column.to_numpy(dtype=np.float64, na_value=np.nan)
        with np.errstate(invalid="ignore"):
            whole = (values % 1 == 0) & (np.abs(values) < 2**53)
        text[whole] = column[whole].astype("Int64").astype("str")
    return text.where(column.notna())


def in_order(names: Iterable[str]) -> list[str]:
    """Identifiers in a fixed order: numbers by value first, then text."""

    def key(name: str) -> tuple[int, float, str]:
        try:
            return (0, float(name), name)
        except ValueError:
            return (1, 0.0, name)

    return sorted(names, key=key)
