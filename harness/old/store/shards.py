"""Shards: the results of one task, stored in the run folder until the run is finished.

A shard is a checksum followed by Arrow data, one stream for each table.  Its name gives the cell
and the pairs that it holds.  Files appear complete or not at all, so a run can be read while
another process works on it.
"""

import io
import re
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa

from harness.core.errors import InputError
from harness.old.store.schemas import ROWS_BY_PAIR
from harness.old.store.tables import with_schema

SHARDS = "shards"
"""The folder of the shards inside a run folder."""

_NAME = re.compile(r"(\d+)-(\d+)-(\d+)\.arrows")
_TABLE = b"table"
"""The key of the table's name in the metadata of a stream."""

_CHECKSUM = 4
"""Bytes of the CRC-32 with which each shard begins."""


class DamagedShardError(Exception):
    """The content of a shard has changed since it was written."""


class Shard(NamedTuple):
    """The file of ``pairs`` pairs of a cell, which begin with pair ``first``."""

    cell: int
    first: int
    pairs: int
    path: Path

    @property
    def numbers(self) -> range:
        """The numbers of its pairs."""
        return range(self.first, self.first + self.pairs)


def shards_of(run: Path) -> list[Shard]:
    """The shards of a run folder, in the order of the tables."""
    shards = []
    for path in (run / SHARDS).glob("*.arrows"):
        match = _NAME.fullmatch(path.name)
        if match and path.is_file():
            cell, first, pairs = (int(part) for part in match.groups())
            shards.append(Shard(cell, first, pairs, path))
    return sorted(shards)


def shard_name(cell: int, first: int, pairs: int) -> str:
    """The file name of a shard."""
    return f"{cell}-{first}-{pairs}.arrows"


def encode_shard(tables: Mapping[str, pa.Table]) -> bytes:
    """The content of a shard's file.

    Args:
        tables: the tables by name.
    """
    buffer = io.BytesIO()
    for name, table in tables.items():
        schema = table.schema.with_metadata({_TABLE: name.encode()})
        with pa.ipc.new_stream(buffer, schema) as stream:
            stream.write_table(table)
    content = buffer.getvalue()
    return zlib.crc32(content).to_bytes(_CHECKSUM) + content


def read_shard(shard: Shard) -> dict[str, pa.Table]:
    """The tables of a shard by name.

    Raises:
        OSError: the file cannot be read.
        DamagedShardError: the content has changed, or holds fewer pairs than the name says.
    """
    content = shard.path.read_bytes()
    checksum, content = content[:_CHECKSUM], content[_CHECKSUM:]
    # Arrow notices neither an empty file nor a changed number.
    if checksum != zlib.crc32(content).to_bytes(_CHECKSUM):
        raise DamagedShardError(shard.path)
    tables = {}
    file = io.BytesIO(content)
    try:
        while file.tell() < len(content):
            table = pa.ipc.open_stream(file).read_all()
            name = table.schema.metadata[_TABLE].decode()
            tables[name] = with_schema(table, name, str(shard.path))
    except (pa.ArrowException, InputError, OSError, ValueError, KeyError, TypeError):
        raise DamagedShardError(shard.path) from None
    # The number of pairs in the name is not covered by the checksum.
    arms = next((tables[name] for name in ROWS_BY_PAIR if name in tables), None)
    if arms is None or arms.num_rows != 2 * shard.pairs:
        raise DamagedShardError(shard.path)
    return tables


def check_planned(run: Path, shards: Iterable[Shard], planned: Mapping[int, int]) -> None:
    """Refuse shards with pairs that a run does not plan.

    Args:
        run: the folder.
        shards: the readable shards.
        planned: number of pairs by the cell's number.

    Raises:
        InputError: a shard belongs to another run.
    """
    for shard in shards:
        if shard.first + shard.pairs > planned.get(shard.cell, 0):
            where = str(run / SHARDS / shard.path.name)
            raise InputError(where, "holds pairs that this run does not plan", "shards of this run")
