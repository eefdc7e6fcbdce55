"""Tables as files."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from harness.core.files import cannot_write, whole_file

_ROW_GROUP = 100_000

Row = dict[str, Any]
"""A row of a table: a value for each column."""


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
