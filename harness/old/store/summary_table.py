"""The findings of a run as ``summary.parquet``, and ``summary.csv`` made from it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from harness.core.errors import InputError, reading
from harness.core.files import write_csv
from harness.old.statistics import Catalogue, Findings, columns_of, findings_from, row_of
from harness.old.store.tables import write_parquet
from harness.scenario import Cell

SUMMARY = "summary.parquet"

_TYPES = {float: pa.float64(), int: pa.int64(), bool: pa.bool_(), str: pa.string()}


def summary_schema(catalogue: Catalogue) -> pa.Schema:
    """The columns of ``summary.parquet``."""
    columns = {name: _TYPES[kind] for name, kind in columns_of(catalogue).items()}
    return pa.schema([("cell", pa.int32()), *columns.items()])


def write_summary(
    folder: Path, catalogue: Catalogue, cells: Sequence[Cell], findings: Sequence[Findings]
) -> None:
    """Write the findings of all cells, in order, to ``summary.parquet`` and ``summary.csv``."""
    rows = [
        {"cell": cell.number, **row_of(catalogue, reported)}
        for cell, reported in zip(cells, findings, strict=True)
    ]
    schema = summary_schema(catalogue)
    write_parquet(folder / SUMMARY, schema, iter([pa.Table.from_pylist(rows, schema)]))
    table = [
        {**cell.varied, **{name: row[name] for name in schema.names[1:]}}
        for cell, row in zip(cells, rows, strict=True)
    ]
    write_csv(folder / "summary.csv", table)


def read_summary(
    folder: Path, catalogue: Catalogue, cells: Sequence[Cell]
) -> Mapping[int, Findings] | None:
    """The findings of every cell by its number.

    Returns:
        None if the run has no such file, or if an entry of the catalogue is missing in it.

    Raises:
        InputError: the file is damaged, or belongs to other cells.
    """
    path, schema = folder / SUMMARY, summary_schema(catalogue)
    if not path.exists():
        return None
    with reading(path):
        try:
            table = pq.read_table(path, page_checksum_verification=True)
            table.validate(full=True)
            if not {*schema.names} <= {*table.column_names}:
                return None
            table = table.select(schema.names).cast(schema)
        except pa.ArrowException as error:
            raise ValueError(str(error)) from None
    for field, column in zip(schema, table.columns, strict=True):
        whole = pa.types.is_integer(field.type) and column.null_count
        if whole or (pa.types.is_floating(field.type) and _holds_no_number(column)):
            raise InputError(f"{path}: {field.name}", "is damaged", "a finite number in each row")
    if table["cell"].to_pylist() != [cell.number for cell in cells]:
        raise InputError(str(path), "is damaged", f"a row for each of {len(cells)} cells")
    return {row["cell"]: findings_from(catalogue, row) for row in table.to_pylist()}


def _holds_no_number(column: pa.ChunkedArray) -> bool:
    return not pc.all(pc.is_finite(column), min_count=0).as_py()
