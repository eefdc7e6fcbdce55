"""Hostile Parquet tables: a good one with columns of other types, twice, missing, or spoilt."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from hypothesis import strategies as st

from tests.fuzz.hostile import NAMES, NUMBERS, SCALARS

_TYPES = (
    pa.string(),
    pa.large_string(),
    pa.binary(),
    pa.bool_(),
    pa.int8(),
    pa.int64(),
    pa.uint64(),
    pa.float16(),
    pa.float32(),
    pa.decimal128(38, 2),
    pa.date32(),
    pa.timestamp("ns", tz="UTC"),
    pa.duration("s"),
    pa.dictionary(pa.int8(), pa.string()),
)


def hostile_table(table: pa.Table) -> st.SearchStrategy[pa.Table]:
    """The table after one to three changes that no writer of ours would make."""
    columns = st.sampled_from(table.column_names)
    changes = st.one_of(
        st.builds(_cast, columns, st.sampled_from(_TYPES)),
        st.builds(_nested, columns, st.booleans()),
        st.builds(_values, columns, st.integers(0, 2**31), SCALARS),
        st.builds(_values, columns, st.integers(0, 2**31), NUMBERS),
        st.builds(_filled, columns, SCALARS),
        st.builds(_again, columns, columns),
        st.builds(_without, columns),
        st.builds(_more, NAMES, SCALARS),
        st.builds(_rows, st.integers(0, 4), st.integers(0, 2**31)),
    )

    def change(chosen: list[Callable[[pa.Table], pa.Table]]) -> pa.Table:
        spoilt = table
        for one in chosen:
            try:
                spoilt = one(spoilt)
            except (pa.ArrowException, OverflowError, TypeError, ValueError, KeyError):
                continue  # Arrow itself does not let it be
        return spoilt

    return st.lists(changes, min_size=1, max_size=3).map(change)


def written(table: pa.Table, path: Path) -> bool:
    """Whether Parquet can hold the table; then it is in the file."""
    try:
        pq.write_table(table, path)
    except (pa.ArrowException, OSError, ValueError, TypeError):
        path.unlink(missing_ok=True)
        return False
    return True


Change = Callable[[pa.Table], pa.Table]


def _replaced(name: str, make: Callable[[pa.ChunkedArray], Any]) -> Change:
    def change(table: pa.Table) -> pa.Table:
        place = table.column_names.index(name)
        return table.set_column(place, name, make(table.column(place)))

    return change


def _cast(name: str, to: pa.DataType) -> Change:
    return _replaced(name, lambda column: column.cast(to, safe=False))


def _nested(name: str, struct: bool) -> Change:
    def nest(column: pa.ChunkedArray) -> pa.Array:
        values = column.to_pylist()
        return pa.array([{"a": value} if struct else [value, value] for value in values])

    return _replaced(name, nest)


def _values(name: str, row: int, value: Any) -> Change:
    """One value in another's place: as the column's type, or the whole column as text."""

    def put(column: pa.ChunkedArray) -> pa.Array:
        values = column.to_pylist()
        if values:
            values[row % len(values)] = value
        try:
            return pa.array(values, type=column.type)
        except (pa.ArrowException, OverflowError, TypeError, ValueError):
            return pa.array([None if one is None else str(one) for one in values])

    return _replaced(name, put)


def _filled(name: str, value: Any) -> Change:
    return _replaced(name, lambda column: pa.array([value] * len(column)))


def _again(name: str, other: str) -> Change:
    return lambda table: table.append_column(name, table.column(table.column_names.index(other)))


def _without(name: str) -> Change:
    return lambda table: table.drop_columns([name])


def _more(name: str, value: Any) -> Change:
    return lambda table: table.append_column(name, pa.array([value] * table.num_rows))


def _rows(how: int, which: int) -> Change:
    """None at all, half of them, each twice, in another order, or one lost."""

    def change(table: pa.Table) -> pa.Table:
        lost = which % max(1, table.num_rows)
        return [
            table.slice(0, 0),
            table.slice(0, table.num_rows // 2),
            pa.concat_tables([table, table]),
            table.take(list(reversed(range(table.num_rows)))),
            pa.concat_tables([table.slice(0, lost), table.slice(lost + 1)]),
        ][how]

    return change
