"""The folder of a run that is running: claimed, locked, filled shard by shard, finished.

The result of each task is written at once as a shard (an Arrow file), so that after an interruption
nothing is lost and nothing runs twice.  At the end the shards become the tables, with a fixed order
and fixed row groups, so equal results give equal bytes for every division of the work.
"""

import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import Any

import filelock
import pyarrow as pa

from harness.core.errors import InputError, resume_command
from harness.core.files import cannot_write, write_file
from harness.old.store.reading import MANIFEST, kind_of_folder
from harness.old.store.schemas import TABLES
from harness.old.store.shards import (
    SHARDS,
    DamagedShardError,
    Shard,
    check_planned,
    encode_shard,
    read_shard,
    shard_name,
    shards_of,
)
from harness.old.store.tables import write_parquet
from harness.scenario import Scenario

_LOCK = ".lock"
_LOG = "log.jsonl"


class RunFolder:
    """The folder of a run, locked by this process until ``close``.

    Args:
        path: an existing folder.

    Raises:
        InputError: another process works on this run, or the folder cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = filelock.FileLock(path / _LOCK, timeout=0)
        try:
            # The operating system releases the lock when the process ends, even if it is killed.
            self._lock.acquire()
        except filelock.Timeout:
            raise InputError(str(path), "another process is working on this run") from None
        except OSError as error:
            raise InputError(str(path), f"cannot be written ({error.strerror})") from None

    def close(self) -> None:
        """Release the folder."""
        # The file is removed while the lock is held; later it could be the next process's lock.
        (self.path / _LOCK).unlink(missing_ok=True)
        self._lock.release()

    def note(self, event: str, **details: Any) -> None:
        """Append a line to ``log.jsonl``, the only file of a run with time stamps."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"time": now, "event": event, **details})
        try:
            with (self.path / _LOG).open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        except OSError as error:
            raise cannot_write(self.path, error) from None

    def write_manifest(self, document: Mapping[str, Any]) -> None:
        """Write ``manifest.json`` with the keys in the given order."""
        content = json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
        write_file(self.path / MANIFEST, content.encode())

    def outputs_of(self, scenario: Scenario) -> Path | None:
        """The folder for SUMO's own outputs of a user's simulation; None if none are kept."""
        if scenario.simulation is None or not scenario.simulation.outputs:
            return None
        return self.path.resolve() / "sumo"

    def stack_file(self, task: str) -> Path:
        """The file to which a hung worker of that task writes its stack."""
        # The path is absolute: workers of a cluster have other working directories.
        return self._shard_folder().resolve() / f"stack-{task}.txt"

    def write_shard(
        self, cell: int, first: int, count: int, tables: Mapping[str, pa.Table]
    ) -> None:
        """Store the results of one task."""
        path = self._shard_folder() / shard_name(cell, first, count)
        write_file(path, encode_shard(tables))

    def done_pairs(self, planned: Mapping[int, int], names: Iterable[str]) -> dict[int, set[int]]:
        """The finished pairs of each cell; a damaged shard is removed and does not count.

        Args:
            planned: number of pairs by the cell's number.
            names: the tables that each shard must hold.

        Raises:
            InputError: a shard holds pairs that are not planned.
        """
        done: dict[int, set[int]] = {}
        for shard in shards_of(self.path):
            try:
                tables = read_shard(shard)
                if not {*names} <= {*tables}:
                    raise DamagedShardError(shard.path)
            except (OSError, DamagedShardError):
                shard.path.unlink()
                continue
            check_planned(self.path, [shard], planned)
            done.setdefault(shard.cell, set()).update(shard.numbers)
        return done

    def rows_by_cell(self, name: str) -> Iterator[tuple[int, pa.Table]]:
        """Yield the number of each cell and its rows of a table, in order."""
        for cell, shards in groupby(shards_of(self.path), key=lambda shard: shard.cell):
            yield cell, _rows(name, shards)

    def finish_tables(self, names: Iterable[str]) -> None:
        """Write the run's tables of these names from the shards."""
        shards = shards_of(self.path)
        for name in names:
            parts = (read_shard(shard)[name] for shard in shards)
            write_parquet(self.path / f"{name}.parquet", TABLES[name], parts)

    def finish_derived(
        self, name: str, rows: str, derive: Callable[[int, pa.Table], pa.Table]
    ) -> None:
        """Write a table that is computed from the rows of another table, cell by cell."""
        parts = (derive(cell, table) for cell, table in self.rows_by_cell(rows))
        write_parquet(self.path / f"{name}.parquet", TABLES[name], parts)

    def drop_shards(self) -> None:
        """Remove the shards and half-written files of a killed process.

        The content of the shards is in the tables.  A folder without a run may hold shards of a run
        that ended before its manifest was written.
        """
        shutil.rmtree(self.path / SHARDS, ignore_errors=True)
        for name in (MANIFEST, "*.parquet", "*.csv"):
            for path in self.path.glob(f".{name}.*.partial"):
                path.unlink(missing_ok=True)

    def _shard_folder(self) -> Path:
        folder = self.path / SHARDS
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            raise cannot_write(folder, error) from None
        return folder


def _rows(name: str, shards: Iterable[Shard]) -> pa.Table:
    parts = [read_shard(shard)[name] for shard in shards]
    return pa.concat_tables([TABLES[name].empty_table(), *parts])


def claim_folder(out: Path | str | None, name: str) -> Path:
    """Make the folder of a new run.

    Args:
        out: the user's choice, or None for ``runs/<name>-<next free number>``.
        name: the scenario's name.

    Raises:
        InputError: the folder already holds a run, is a file, or cannot be written.
    """
    if out is not None:
        chosen = Path(out)
        _make(chosen, exist_ok=True)
        return chosen
    number = 1
    while True:
        folder = Path("runs") / f"{name}-{number}"
        try:
            _make(folder, exist_ok=False)
        except FileExistsError:
            number += 1
        else:
            return folder


def _make(folder: Path, exist_ok: bool) -> None:
    where = f"--out {folder}"
    try:
        if exist_ok and folder.exists() and not folder.is_dir():
            raise InputError(where, "is a file", "a new or empty folder")
        if exist_ok and (folder / MANIFEST).exists():
            raise InputError(
                where, "already holds a run", f"a new or empty folder, or {resume_command(folder)}"
            )
        if exist_ok and kind_of_folder(folder) == "risk":
            raise InputError(where, "already contains a risk estimate", "a new or empty folder")
        folder.mkdir(parents=True, exist_ok=exist_ok)
        probe = folder / f".{os.getpid()}.probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        if isinstance(error, FileExistsError) and not exist_ok:
            raise
        why = f"cannot be written ({error.strerror})"
        raise InputError(where, why, "a writable folder") from None
