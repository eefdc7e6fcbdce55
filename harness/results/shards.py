"""Shards: the finished work of one task, as it lies in a run folder until the run is finished.

An Arrow file with a checksum in front, one stream for each table.  Its name says which pairs of
which cell it holds.  Files appear complete or not at all, so a run that is still going on can be
read beside the process that works on it.
"""

import io
import re
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa

SHARDS = "shards"
"""The folder of the shards inside a run folder."""

_NAME = re.compile(r"(\d+)-(\d+)-(\d+)\.arrows")
_CHECKSUM = 4
"""Bytes of the CRC-32 each shard begins with."""


class DamagedShardError(Exception):
    """A shard is not as it was written."""


class Shard(NamedTuple):
    """``pairs`` pairs of a cell from ``first`` on, and the file that holds them."""

    cell: int
    first: int
    pairs: int
    path: Path

    @property
    def numbers(self) -> range:
        """The pairs it holds."""
        return range(self.first, self.first + self.pairs)


def shards_of(run: Path) -> list[Shard]:
    """The shards of a run folder, in the order of the tables."""
    found = []
    for path in (run / SHARDS).glob("*.arrows"):
        match = _NAME.fullmatch(path.name)
        if match:
            cell, first, pairs = (int(part) for part in match.groups())
            found.append(Shard(cell, first, pairs, path))
    return sorted(found)


def shard_name(cell: int, first: int, pairs: int) -> str:
    """The file name of a shard."""
    return f"{cell}-{first}-{pairs}.arrows"


def encode_shard(tables: Mapping[str, pa.Table]) -> bytes:
    """The content of a shard's file.

    Args:
        tables: by name, in the order ``episodes, pedestrians, traces``; the last may be missing.
    """
    buffer = io.BytesIO()
    for table in tables.values():
        with pa.ipc.new_stream(buffer, table.schema) as stream:
            stream.write_table(table)
    content = buffer.getvalue()
    return zlib.crc32(content).to_bytes(_CHECKSUM) + content


def read_shard(path: Path) -> dict[str, pa.Table]:
    """The tables of a shard by name.

    Raises:
        OSError: it cannot be read.
        DamagedShardError: it is not as it was written.
    """
    content = path.read_bytes()
    checksum, content = content[:_CHECKSUM], content[_CHECKSUM:]
    # Arrow itself notices neither an empty file nor a changed number.
    if checksum != zlib.crc32(content).to_bytes(_CHECKSUM):
        raise DamagedShardError(path)
    tables = {}
    file = io.BytesIO(content)
    for name in ("episodes", "pedestrians", "traces"):
        if file.tell() < len(content):
            tables[name] = pa.ipc.open_stream(file).read_all()
    return tables
