"""The tables of a run from rows, checked against their schemas, and as files."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from harness.core.encounter import FloatArray
from harness.core.errors import InputError
from harness.core.files import cannot_write, whole_file
from harness.old.store.schemas import TABLES, TRACES

_ROW_GROUP = 100_000

Tables = dict[str, pa.Table]
"""Tables by name."""

Row = dict[str, Any]
"""A row of a table: a value for each column, of the types in ``TABLES``."""


def table_of(name: str, rows: Iterable[Mapping[str, object]]) -> pa.Table:
    """Rows as the table of that name in ``TABLES``; missing values of a row are null."""
    return pa.Table.from_pylist([*rows], schema=TABLES[name])


Motion = tuple[FloatArray | Sequence[float | None], ...]
"""Aligned columns of one object: time, x, y, speed and acceleration, in the units of ``TRACES``."""


def traces_table(objects: Iterable[tuple[Mapping[str, object], str, Motion]]) -> pa.Table:
    """The table ``traces``.

    Args:
        objects: the columns ``cell``, ``pair`` and ``arm``, the name and the motion of each object.
    """
    numbers = [field.name for field in TRACES if field.type == pa.float64()]
    parts = [TRACES.empty_table()]
    for keys, name, motion in objects:
        constants = {**keys, "object": name}
        columns = {
            key: pa.repeat(pa.scalar(value, TRACES.field(key).type), len(motion[0]))
            for key, value in constants.items()
        }
        for number, values in zip(numbers, motion, strict=True):
            columns[number] = pa.array(values, pa.float64())
        parts.append(pa.table(columns).select(TRACES.names))
    return pa.concat_tables(parts).combine_chunks()


def with_schema(table: pa.Table, name: str, where: str) -> pa.Table:
    """A table of unknown origin with the columns and types of its schema.

    Raises:
        InputError: a column is missing; ``where`` names the file.
        ValueError: a value does not fit its column's type.
    """
    schema = TABLES[name]
    for column in schema.names:
        if column not in table.column_names:
            raise InputError(where, f"lacks {column}", "a run of this version")
    return table.select(schema.names).cast(schema)


def write_parquet(path: Path, schema: pa.Schema, parts: Iterator[pa.Table]) -> None:
    """Write one Parquet table whole, from parts of any size, in row groups of a fixed size.

    Raises:
        HarnessError: the file cannot be written.
    """
    try:
        with (
            whole_file(path) as beside,
            # Checksums reveal damaged bytes when the table is read.
            pq.ParquetWriter(beside, schema, write_page_checksum=True) as writer,
        ):
            rest = schema.empty_table()
            for part in parts:
                rest = pa.concat_tables([rest, part.cast(schema)])
                while rest.num_rows >= _ROW_GROUP:
                    writer.write_table(rest.slice(0, _ROW_GROUP).combine_chunks())
                    rest = rest.slice(_ROW_GROUP)
            if rest.num_rows:
                writer.write_table(rest.combine_chunks())
    except OSError as error:
        raise cannot_write(path, error) from None
