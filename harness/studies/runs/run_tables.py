"""Reads the tables of a run, from its files if it is finished and otherwise from its shards."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from harness.core.errors import InputError, resume_command
from harness.scenario import Cell, Study
from harness.store.reading import read_table
from harness.store.schemas import TABLES
from harness.store.shards import DamagedShardError, Shard, check_planned, read_shard, shards_of


class RunTables:
    """Reads a run's tables on first use and keeps all except the large table ``traces``.

    Args:
        path: the run folder.
        finished: whether the run's tables are written.
        shards: the finished work of an unfinished run.
        cells: all cells of the run.
    """

    def __init__(
        self, path: Path, finished: bool, shards: Sequence[Shard], cells: Sequence[Cell]
    ) -> None:
        self._path, self._finished, self._shards, self._cells = path, finished, shards, cells
        self._kept: dict[str, pa.Table] = {}

    def read(self, name: str) -> pa.Table:
        """Return all rows of a table.

        Raises:
            InputError: the table is missing or damaged.
        """
        if name == "traces":
            return self._table(name, self._shards)
        if name not in self._kept:
            self._kept[name] = self._table(name, self._shards)
        return self._kept[name]

    def rows_of(self, name: str, cell: int, pair: int) -> pa.Table:
        """Return the rows of one pair in ``episodes``, ``pedestrians`` or ``traces``.

        Raises:
            InputError: the table is missing or damaged.
        """
        if name == "traces" and self._finished:
            return read_table(self._path, name, cell, pair)
        if name == "traces":
            shards = [
                shard for shard in self._shards if shard.cell == cell and pair in shard.numbers
            ]
            table = self._table(name, shards)
        else:
            table = self.read(name)
        selected = pc.and_(pc.equal(table["cell"], cell), pc.equal(table["pair"], pair))
        return table.filter(selected)

    def by_cell(self, name: str) -> Iterator[tuple[Cell, pa.Table]]:
        """Yield every cell that has rows, with its rows."""
        table = self.read(name)
        numbers = table["cell"].to_numpy()
        for cell in self._cells:
            of_cell = numbers == cell.number
            # The rows of a single cell may be large, so they are not copied.
            rows = table if of_cell.all() else table.filter(pa.array(of_cell))
            if rows.num_rows:
                yield cell, rows

    def _table(self, name: str, shards: Sequence[Shard]) -> pa.Table:
        if self._finished:
            table = read_table(self._path, name)
            if name in TABLES and (pc.max(table["cell"]).as_py() or 0) >= len(self._cells):
                where = str(self._path / f"{name}.parquet")
                raise InputError(
                    f"{where}: cell",
                    "names a cell that does not exist",
                    f"0 to {len(self._cells) - 1}",
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
                    str(shard.path), "is damaged", f"to continue: {resume_command(self._path)}"
                ) from None
        return pa.concat_tables([TABLES[name].empty_table(), *parts])


def readable_shards(folder: Path, study: Study) -> tuple[Shard, ...]:
    """Return the readable shards.  Unreadable shards are ignored, as when a run is resumed.

    Raises:
        InputError: a shard belongs to another study.
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
