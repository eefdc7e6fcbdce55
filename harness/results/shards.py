"""Shards: the finished work of one task, as it lies in a run folder until the run is finished.

An Arrow file with a checksum in front, one stream for each table.  Its name says which pairs of
which cell it holds.  Files appear complete or not at all, so a run that is still going on can be
read beside the process that works on it.
"""

import io
import re
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from harness.errors import InputError
from harness.results.rows import check_rows
from harness.results.tables import TABLES

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
        if match and path.is_file():
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


def read_shard(shard: Shard) -> dict[str, pa.Table]:
    """The tables of a shard by name.

    Raises:
        OSError: it cannot be read.
        DamagedShardError: it is not as it was written, or holds other pairs than its name says.
    """
    content = shard.path.read_bytes()
    checksum, content = content[:_CHECKSUM], content[_CHECKSUM:]
    # Arrow itself notices neither an empty file nor a changed number.
    if checksum != zlib.crc32(content).to_bytes(_CHECKSUM):
        raise DamagedShardError(shard.path)
    tables = {}
    file = io.BytesIO(content)
    try:
        for name in ("episodes", "pedestrians", "traces"):
            if file.tell() < len(content):
                tables[name] = pa.ipc.open_stream(file).read_all()
                _check(shard, name, tables[name])
    except (pa.ArrowException, InputError, OSError):
        raise DamagedShardError(shard.path) from None
    if not {"episodes", "pedestrians"} <= {*tables}:
        raise DamagedShardError(shard.path)
    return tables


def _check(shard: Shard, name: str, table: pa.Table) -> None:
    """A name that promises more pairs than there are rows would be believed."""
    if table.schema != TABLES[name]:
        raise DamagedShardError(shard.path)
    check_rows(table, name)
    if name == "episodes" and table.num_rows != 2 * shard.pairs:
        raise DamagedShardError(shard.path)
    if table.num_rows == 0:
        return
    cell, pair = pc.min_max(table["cell"]).as_py(), pc.min_max(table["pair"]).as_py()
    if {cell["min"], cell["max"]} != {shard.cell} or not (
        shard.first <= pair["min"] and pair["max"] < shard.first + shard.pairs
    ):
        raise DamagedShardError(shard.path)


def check_planned(run: Path, shards: Iterable[Shard], planned: Mapping[int, int]) -> None:
    """Refuse finished work of pairs that a run does not plan.

    Args:
        run: the folder.
        shards: those that can be read.
        planned: pairs of each cell, by number.

    Raises:
        InputError: a shard of another run.
    """
    for shard in shards:
        if shard.first + shard.pairs > planned.get(shard.cell, 0):
            where = str(run / SHARDS / shard.path.name)
            raise InputError(where, "holds pairs that this run does not plan", "its own shards")
