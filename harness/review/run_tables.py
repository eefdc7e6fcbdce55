"""The tables of a run: of its files where it is finished, of its shards where it is not."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from harness.errors import InputError, resume_command
from harness.results.reading import read_table
from harness.results.rows import LARGEST_NUMBER
from harness.results.shards import DamagedShardError, Shard, check_planned, read_shard, shards_of
from harness.results.summaries import summary_columns
from harness.results.tables import TABLES
from harness.scenario import Study


class RunTables:
    """Reads a run's tables when they are asked for and keeps all but the big one, ``traces``.

    Args:
        path: the run folder.
        finished: whether its tables are written.
        shards: the finished work of an unfinished run.
    """

    def __init__(self, path: Path, finished: bool, shards: Sequence[Shard], cells: int) -> None:
        self._path, self._finished, self._shards, self._cells = path, finished, shards, cells
        self._kept: dict[str, pa.Table] = {}

    def read(self, name: str) -> pa.Table:
        """All rows of a table.

        Raises:
            InputError: it is missing or damaged.
        """
        if name == "traces":
            return self._table(name, self._shards)
        if name not in self._kept:
            self._kept[name] = self._table(name, self._shards)
        return self._kept[name]

    def rows_of(self, name: str, cell: int, pair: int) -> pa.Table:
        """The rows of one pair in ``episodes``, ``pedestrians`` or ``traces``.

        Raises:
            InputError: the table is missing or damaged.
        """
        if name == "traces" and self._finished:
            return read_table(self._path, name, cell, pair)
        if name == "traces":
            holding = [one for one in self._shards if one.cell == cell and pair in one.numbers]
            table = self._table(name, holding)
        else:
            table = self.read(name)
        own = pc.and_(pc.equal(table["cell"], cell), pc.equal(table["pair"], pair))
        return table.filter(own)

    def _table(self, name: str, shards: Sequence[Shard]) -> pa.Table:
        if self._finished:
            table = read_table(self._path, name)
            if name in TABLES and (pc.max(table["cell"]).as_py() or 0) >= self._cells:
                where = str(self._path / f"{name}.parquet")
                raise InputError(
                    f"{where}: cell", "a cell this run has not", f"0 to {self._cells - 1}"
                )
            return table
        parts = []
        for shard in shards:
            try:
                parts.append(read_shard(shard)[name])
            except FileNotFoundError:
                what = "has been finished or resumed meanwhile"
                raise InputError(str(self._path), what, "load it again") from None
            except (OSError, DamagedShardError, KeyError):
                raise InputError(
                    str(shard.path), "is damaged", f"go on with: {resume_command(self._path)}"
                ) from None
        return pa.concat_tables([TABLES[name].empty_table(), *parts])


def readable_shards(folder: Path, study: Study) -> tuple[Shard, ...]:
    """The shards that can be read; one that cannot does not count, as when a run is resumed.

    Raises:
        InputError: a shard is of another study.
    """
    readable = []
    for shard in shards_of(folder):
        try:
            read_shard(shard)
        except (OSError, DamagedShardError):
            continue
        readable.append(shard)
    planned = {cell.number: cell.scenario.experiment.pairs for cell in study.cells}
    check_planned(folder, readable, planned)
    return tuple(readable)


def read_summary(folder: Path, study: Study) -> dict[str, Sequence[Any]]:
    """The columns of ``summary.csv``, led by the cell's number; NaN where undefined.

    Raises:
        InputError: it is missing, or not that of this study.
    """
    path = folder / "summary.csv"
    if path.exists() and not path.is_file():
        raise InputError(str(path), "is no regular file", "a run's table")
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file, strict=True))
        columns = {name: _numbers([row[name] for row in rows]) for name in (rows or [{}])[0]}
    except FileNotFoundError:
        raise InputError(str(path), "is missing", "a finished run's table") from None
    except (OSError, ValueError, TypeError, csv.Error):
        raise InputError(str(path), "cannot be read", "a run's table") from None
    if len(rows) != len(study.cells) or not {*study.varied_keys} <= set(columns):
        raise InputError(str(path), "is damaged", f"a row for each of {len(study.cells)} cells")
    for name, kind in summary_columns().items():
        if not all(_is_value(value, kind) for value in columns.get(name, [None])):
            raise InputError(f"{path}: {name}", "is damaged", "numbers as a run writes them")
    for key in study.varied_keys:
        # CSV knows no types: a strategy may be called "nan".
        columns[key] = [cell.varied[key] for cell in study.cells]
    return {"cell": range(len(rows)), **columns}


def _is_value(value: Any, kind: type) -> bool:
    if kind is int:
        return isinstance(value, int) and 0 <= value <= LARGEST_NUMBER
    # An empty cell was read as NaN.
    return isinstance(value, int | float) and not abs(value) > LARGEST_NUMBER


def _numbers(texts: Sequence[str]) -> list[Any]:
    """A column of the summary: whole numbers, floats with NaN for empty, or else text."""
    for read in (int, lambda text: float(text) if text else math.nan):
        try:
            return [read(text) for text in texts]
        except ValueError:
            continue
    return list(texts)
