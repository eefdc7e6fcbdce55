"""The run folder on disk: claimed, locked, filled shard by shard, finished.

Finished work is written as it comes, one shard (an Arrow file) for each task, so that nothing is
lost and nothing runs twice after an interruption.  At the end the shards become the tables, in
fixed order and row groups: equal results are equal bytes whatever the tasks were.  Files appear
complete or not at all (written beside, synced, then renamed).  Columns: docs/files.md.
"""

import csv
import io
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import filelock
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from harness.errors import HarnessError, InputError
from harness.results import SCHEMA, TABLES, pair_rows, table_of
from harness.shards import (
    SHARDS,
    DamagedShardError,
    Shard,
    encode_shard,
    read_shard,
    shard_name,
    shards_of,
)

MANIFEST = "manifest.json"

_LOCK = ".lock"
_ROW_GROUP = 100_000


class _Manifest(BaseModel):
    """The form of ``manifest.json``; what its scenario means is ``study_from``'s business."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)

    name: str
    scenario: dict[str, Any]
    cells: Annotated[list[dict[str, Any]], Field(min_length=1)]
    traces: bool
    until: dict[str, Annotated[float, Field(gt=0)]] | None
    seed: int
    versions: dict[str, str]
    models: list[dict[str, str]]
    counts: dict[str, int] | None


class RunFolder:
    """One run's folder, held by this process alone until ``close``.

    Args:
        path: an existing folder.

    Raises:
        InputError: another process works on it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = filelock.FileLock(path / _LOCK, timeout=0)
        try:
            # The operating system lets go of it when the process dies, however it dies.
            self._lock.acquire()
        except filelock.Timeout:
            raise InputError(str(path), "another process is working on this run") from None
        except OSError as error:
            raise InputError(str(path), f"cannot be written ({error.strerror})") from None

    def close(self) -> None:
        """Let go of the folder."""
        # While it is still held: afterwards it could be the next process's lock.
        (self.path / _LOCK).unlink(missing_ok=True)
        self._lock.release()

    def note(self, event: str, **details: Any) -> None:
        """Append a line to ``log.jsonl``, the only file of a run with a clock in it."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"time": now, "event": event, **details})
        try:
            with (self.path / "log.jsonl").open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        except OSError as error:
            raise _cannot_write(self.path, error) from None

    def read_manifest(self) -> dict[str, Any]:
        """See ``read_manifest``."""
        return read_manifest(self.path)

    def write_manifest(self, document: Mapping[str, Any]) -> None:
        """Write ``manifest.json``, keys in the order given."""
        content = json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
        write_file(self.path / MANIFEST, content.encode())

    def stack_file(self, task: str) -> Path:
        """Where a hung worker of that task leaves its stack."""
        # Workers of a cluster have other working directories.
        return self._shard_folder().resolve() / f"stack-{task}.txt"

    def write_shard(
        self, cell: int, first: int, count: int, rows: Mapping[str, Mapping[str, Sequence[Any]]]
    ) -> None:
        """Keep the results of one task."""
        tables = {name: table_of(name, columns) for name, columns in rows.items()}
        path = self._shard_folder() / shard_name(cell, first, count)
        write_file(path, encode_shard(tables))

    def done_pairs(self) -> dict[int, set[int]]:
        """Which pairs of which cell are finished; a shard that cannot be read does not count."""
        done: dict[int, set[int]] = {}
        for shard in shards_of(self.path):
            try:
                read_shard(shard.path)
            except (OSError, DamagedShardError):
                shard.path.unlink()
                continue
            done.setdefault(shard.cell, set()).update(shard.numbers)
        return done

    def episodes_of(self, cell: int) -> pa.Table:
        """The ``episodes`` rows of a cell so far, by pair."""
        return _episodes(shard for shard in shards_of(self.path) if shard.cell == cell)

    def episodes_by_cell(self) -> Iterator[tuple[int, pa.Table]]:
        """Number and ``episodes`` rows of every cell, in order; the folder is searched once."""
        for cell, own in groupby(shards_of(self.path), key=lambda shard: shard.cell):
            yield cell, _episodes(own)

    def finish_tables(self, traces: bool) -> None:
        """Turn the shards into the run's tables."""
        names = ["episodes", "pedestrians", *(["traces"] if traces else [])]
        shards = shards_of(self.path)
        for name in names:
            parts = (read_shard(shard.path)[name] for shard in shards)
            write_parquet(self.path / f"{name}.parquet", TABLES[name], parts)
        by_cell = self.episodes_by_cell()
        pairs = (table_of("pairs", pair_rows(cell, episodes)) for cell, episodes in by_cell)
        write_parquet(self.path / "pairs.parquet", TABLES["pairs"], pairs)

    def drop_shards(self) -> None:
        """Remove the shards; their content is in the tables."""
        shutil.rmtree(self.path / SHARDS, ignore_errors=True)

    def _shard_folder(self) -> Path:
        folder = self.path / SHARDS
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            raise _cannot_write(folder, error) from None
        return folder


def _episodes(shards: Iterable[Shard]) -> pa.Table:
    parts = [read_shard(shard.path)["episodes"] for shard in shards]
    return pa.concat_tables([TABLES["episodes"].empty_table(), *parts])


def claim_folder(out: Path | None, name: str) -> Path:
    """Make the folder of a new run.

    Args:
        out: the user's choice, or None for ``runs/<name>-<next free number>``.
        name: of the scenario.

    Raises:
        InputError: it holds a run already, is a file, or cannot be written.
    """
    if out is not None:
        _make(out, exist_ok=True)
        return out
    number = 1
    while True:
        folder = Path("runs") / f"{name}-{number}"
        try:
            _make(folder, exist_ok=False)
        except FileExistsError:
            number += 1
        else:
            return folder


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a run folder.

    Raises:
        InputError: the folder holds no run, or its manifest is damaged.
    """
    path = folder / MANIFEST
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise InputError(str(folder), "is no run folder", f"a folder with {MANIFEST}") from None
    except (ValueError, RecursionError):
        raise InputError(str(path), "is damaged", "a manifest as a run writes it") from None
    if not isinstance(document, dict):
        raise InputError(str(path), "is damaged", "a manifest as a run writes it")
    if document.get("schema") == SCHEMA:
        # Of another format version nothing is known but that.
        try:
            _Manifest.model_validate(document)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            key = ".".join(str(part) for part in first["loc"])
            raise InputError(f"{path}: {key}", "is damaged", first["msg"]) from None
    return document


def read_finished_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a run that is finished.

    Raises:
        InputError: as ``read_manifest``, or the run was broken off or is still going on.
    """
    document = read_manifest(folder)
    if document.get("schema") == SCHEMA and document.get("counts") is None:
        finishes = f"`harness run --resume {folder}` finishes it"
        raise InputError(str(folder), "is not finished", finishes)
    return document


def read_table(
    folder: Path, name: str, cell: int | None = None, pair: int | None = None
) -> pa.Table:
    """One table of a finished run: all of it, one cell's rows, or one pair's.

    Raises:
        InputError: the table is missing, damaged, or of another format.
    """
    wanted = [(key, "=", value) for key, value in (("cell", cell), ("pair", pair))]
    filters = [condition for condition in wanted if condition[2] is not None]
    with _reading(folder, name) as path:
        table = pq.read_table(path, filters=filters or None)
        if name not in TABLES:
            return table
        missing = [column for column in TABLES[name].names if column not in table.column_names]
        if missing:
            raise InputError(str(path), f"lacks {missing[0]}", "a run of this version")
        return table.select(TABLES[name].names).cast(TABLES[name])


def count_rows(folder: Path, name: str) -> int:
    """Number of rows of a finished run's table, from its footer alone.

    Raises:
        InputError: the table is missing or damaged.
    """
    with _reading(folder, name) as path:
        return int(pq.read_metadata(path).num_rows)


@contextmanager
def _reading(folder: Path, name: str) -> Iterator[Path]:
    """The path of a table; what goes wrong with it becomes one line."""
    path = folder / f"{name}.parquet"
    try:
        yield path
    except FileNotFoundError:
        raise InputError(str(path), "is missing", "a finished run's table") from None
    except (OSError, pa.ArrowException, ValueError) as error:
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(str(path), f"cannot be read ({why})", "a run's table") from None


def write_file(path: Path, content: bytes) -> None:
    """Write beside, sync, then rename.

    Raises:
        HarnessError: the file system refuses (full, read-only).
    """
    beside = path.with_name(f".{path.name}.partial")
    try:
        with beside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise _cannot_write(path, error) from None


def write_parquet(path: Path, schema: pa.Schema, parts: Iterator[pa.Table]) -> None:
    """Write one Parquet table from parts of any size, in row groups of a fixed size."""
    beside = path.with_name(f".{path.name}.partial")
    try:
        with pq.ParquetWriter(beside, schema) as writer:
            rest = schema.empty_table()
            for part in parts:
                rest = pa.concat_tables([rest, part.cast(schema)])
                while rest.num_rows >= _ROW_GROUP:
                    writer.write_table(rest.slice(0, _ROW_GROUP).combine_chunks())
                    rest = rest.slice(_ROW_GROUP)
            if rest.num_rows:
                writer.write_table(rest.combine_chunks())
        with beside.open("rb+") as file:
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        raise _cannot_write(path, error) from None
    finally:
        beside.unlink(missing_ok=True)


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a CSV file; undefined values are empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_file(path, text.getvalue().encode())


def export_csv(folder: Path) -> list[Path]:
    """Write every table of a run folder as CSV beside it.

    Raises:
        InputError: no finished run, or a table cannot be read.
    """
    read_finished_manifest(folder)
    written = []
    for source in sorted(folder.glob("*.parquet")):
        table = read_table(folder, source.stem)
        target = source.with_suffix(".csv")
        write_file(target, table.to_pandas().to_csv(index=False, lineterminator="\n").encode())
        written.append(target)
    return written


def _make(folder: Path, exist_ok: bool) -> None:
    where = f"--out {folder}"
    try:
        if exist_ok and folder.exists() and not folder.is_dir():
            raise InputError(where, "is a file", "a new or empty folder")
        if exist_ok and (folder / MANIFEST).exists():
            raise InputError(where, "holds a run already", "a new or empty folder, or --resume")
        folder.mkdir(parents=True, exist_ok=exist_ok)
        probe = folder / f".{os.getpid()}.probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        if isinstance(error, FileExistsError) and not exist_ok:
            raise
        why = f"cannot be written ({error.strerror})"
        raise InputError(where, why, "a writable folder") from None


def _cannot_write(path: Path, error: OSError) -> HarnessError:
    return HarnessError(f"{path}: cannot be written ({error.strerror})")
