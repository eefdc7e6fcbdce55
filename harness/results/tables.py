"""The tables of a run of encounters, and their parts: the rows of one task, a Parquet file each.

``pd.read_parquet("RUN/episodes")`` reads a whole table.  A part appears complete or not at all,
that of ``episodes`` last: if it exists, its task is done.
"""

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from harness.core.encounter import Arm, Contact, Ending, Leg, Side
from harness.core.errors import InputError, one_line, resume_command
from harness.core.files import cannot_write, whole_file
from harness.measures.catalogue import MEASURES


class _NoPandas:
    """Refuses pandas, which Arrow imports with its first array, in 0.13 s.

    Arrow imports it again when it is asked for a frame.
    """

    @staticmethod
    def find_spec(name: str, *_: object) -> None:
        """See ``importlib.abc.MetaPathFinder``."""
        if name == "pandas":
            raise ImportError


if "pandas" not in sys.modules:
    sys.meta_path.insert(0, _NoPandas)
    pa.array([])
    sys.meta_path.remove(_NoPandas)

Tables = dict[str, pa.Table]
"""Tables by name."""

Row = dict[str, Any]
"""A row of a table: a value for each column."""

Kind = type[float] | type[int] | type[bool] | type[str] | type[StrEnum] | type[Leg]
"""The type of a column: a ``StrEnum`` stands for its words, ``Leg`` for a list of legs."""

_LARGEST, _SMALLEST = 1e18, 1e-18
"""Upper limit of all numbers, and lower limit of divisors."""

_DIVISORS = ("pass_time_s", "pass_time_ignoring_contact_s")

_LEGS = pa.list_(pa.struct([(name, pa.float64()) for name in Leg._fields]))
_TYPES = {float: pa.float64(), int: pa.int64(), bool: pa.bool_(), Leg: _LEGS}
_DIGEST = b"harness.digest"
"""The key of the manifest's digest in a part's metadata."""

_PART = re.compile(r"(\d{4,})-(\d{8,})\.parquet")


class DamagedPartError(InputError):
    """The file of a part cannot be read."""


@dataclass(frozen=True)
class Column:
    """A column.  A value that is missing is null, never 0; a ``required`` column has no null."""

    name: str
    kind: Kind
    unit: str
    meaning: str
    required: bool = False

    @property
    def type(self) -> pa.DataType:
        """Its type in Arrow."""
        return _TYPES.get(self.kind, pa.string())


@dataclass(frozen=True)
class Table:
    """The declaration of a table."""

    name: str
    columns: tuple[Column, ...]

    @property
    def schema(self) -> pa.Schema:
        """Its schema in Arrow."""
        return pa.schema([(column.name, column.type) for column in self.columns])

    def of(self, rows: Sequence[Row]) -> pa.Table:
        """Rows as a table; columns that a row lacks are null."""
        return pa.table(
            {
                column.name: pa.array([row.get(column.name) for row in rows], column.type)
                for column in self.columns
            }
        )


_KEYS = (
    Column("cell", int, "", "number of the cell", required=True),
    Column("pair", int, "", "number of the pair, which keys its random streams", required=True),
    Column("arm", Arm, "", "who drives: the AV or the reference", required=True),
)

EPISODES = Table(
    "episodes",
    (
        *_KEYS,
        Column("strategy", str, "", "the strategy that drove", required=True),
        Column("ending", Ending, "", "how the episode ended", required=True),
        Column("reason", str, "", "why it failed"),
        Column("failed_in", str, "", "what failed: `strategy` or `engine`"),
        Column("contact", Contact, "", "the part of the ego that touched the pedestrian"),
        Column("contact_index", int, "", "index of the pedestrian who was touched"),
        Column("contact_time_s", float, "s", "time of the contact since the trigger"),
        Column("sumo_collision", bool, "", "whether SUMO itself reported a collision"),
        Column("fallback", bool, "", "whether the strategy's fallback drove", required=True),
        Column("steps", int, "", "steps of the record", required=True),
        Column("pedestrians", int, "", "people who stepped off within the record", required=True),
        *(Column(each.column, each.kind, each.unit, each.formula) for each in MEASURES),
        Column("conditionings", int, "", "uses of the interaction model"),
        Column("clamped", int, "", "of these, with an ego faster or farther than in its data"),
        Column("near_clamped", int, "", "of these, with an ego slower or nearer than in its data"),
        Column("clamped_speed_excess_mps", float, "m/s", "largest excess of the ego's speed"),
        Column("clamped_range_excess_m", float, "m", "largest excess of the ego's range"),
    ),
)
"""One row for each episode: the AV's and the reference's of each pair."""

PEDESTRIANS = Table(
    "pedestrians",
    (
        *_KEYS,
        Column("index", int, "", "number of the pedestrian within the pair", required=True),
        Column("arrival_s", float, "s", "time of arrival at the kerb", required=True),
        Column("start_s", float, "s", "time of stepping off"),
        Column("side", Side, "", "the kerb from which they come", required=True),
        Column("quantile", float, "", "quantile of the walking speed"),
        Column("critical_gap_s", float, "s", "the shortest gap that they accept"),
        Column("threshold_s", float, "s", "the least margin of time with which they go"),
        Column("latency_s", float, "s", "time from the decision until they set off"),
        Column("speed_mps", float, "m/s", "walking speed"),
        Column("range_m", float, "m", "the ego's range when they stepped off"),
        Column("vehicle_speed_mps", float, "m/s", "the ego's speed when they stepped off"),
        Column("cleared_s", float, "s", "time at which they left the ego's path"),
        Column("legs", Leg, "", "the parts of a walk that is not straight from kerb to kerb"),
        Column("delay_s", float, "s", "wait at the kerb"),
    ),
)
"""One row for each pedestrian who arrived within the record of an episode."""

TRACES = Table(
    "traces",
    (
        *_KEYS,
        Column("time_s", float, "s", "time since the trigger", required=True),
        Column("object", str, "", "`ego`, `pedestrian-INDEX` or `shown-INDEX`", required=True),
        Column("x_m", float, "m", "along the road, 0 at the crosswalk's centre", required=True),
        Column("y_m", float, "m", "across the road, 0 at the near kerb", required=True),
        Column("speed_mps", float, "m/s", "speed", required=True),
        Column("acceleration_mps2", float, "m/s²", "acceleration of the step that begins here"),
    ),
)
"""One row for each step and object, of a run that keeps traces."""

TABLES: Mapping[str, Table] = {table.name: table for table in (EPISODES, PEDESTRIANS, TRACES)}


def part_name(cell: int, first: int) -> str:
    """The file name of the part of a cell that begins with pair ``first``."""
    return f"{cell:04d}-{first:08d}.parquet"


def done_parts(folder: Path) -> set[tuple[int, int]]:
    """The finished parts of a run folder: cell and first pair."""
    place = folder / EPISODES.name
    found = (_PART.fullmatch(path.name) for path in place.glob("*.parquet"))
    return {(int(match[1]), int(match[2])) for match in found if match}


def write_part(
    folder: Path, cell: int, first: int, tables: Mapping[str, pa.Table], digest: str
) -> None:
    """Write the parts of a task's rows of one cell, ``episodes`` last.

    Args:
        folder: the run's folder.
        cell: number of the cell.
        first: number of the first pair.
        tables: the rows by the table's name.
        digest: of the run's manifest.

    Raises:
        HarnessError: the file system refuses (full, read-only); no half-written file stays.
    """
    for name in sorted(tables, key=EPISODES.name.__eq__):
        path = folder / name / part_name(cell, first)
        try:
            path.parent.mkdir(exist_ok=True)
            with whole_file(path) as beside:
                table = tables[name].replace_schema_metadata({_DIGEST: digest})
                # Checksums reveal damaged bytes when the part is read.
                pq.write_table(table, beside, write_page_checksum=True)
        except OSError as error:
            raise cannot_write(path, error) from None


def read_cell(
    folder: Path, name: str, cell: int, manifest: Mapping[str, Any], pair: int | None = None
) -> pa.Table:
    """The rows of a cell in a table by pair, the AV's first, up to the first part that is missing.

    Args:
        folder: the run's folder.
        name: name of the table.
        cell: number of the cell.
        manifest: the run's manifest.
        pair: the only pair to read; None: all.

    Raises:
        InputError: a part is damaged, is another run's, or has a value that no part has.
    """
    size, parts = manifest["pairs_per_part"], [TABLES[name].schema.empty_table()]
    first = 0 if pair is None else pair // size * size
    while (folder / EPISODES.name / part_name(cell, first)).is_file():
        parts.append(read_part(folder, name, cell, first, manifest))
        if pair is not None:
            break
        first += size
    rows = pa.concat_tables(parts)
    return rows if pair is None else rows.filter(pc.equal(rows["pair"], pair))


def read_part(
    folder: Path, name: str, cell: int, first: int, manifest: Mapping[str, Any]
) -> pa.Table:
    """The rows of one part; see ``read_cell``."""
    table, path = TABLES[name], folder / name / part_name(cell, first)
    again = f"delete the file; `{resume_command(folder)}` simulates its pairs again"
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            if (file.schema_arrow.metadata or {}).get(_DIGEST) != manifest["digest"].encode():
                raise InputError(str(path), "belongs to another run", "the parts of this run")
            rows = file.read().select(table.schema.names)
        rows = rows.replace_schema_metadata().cast(table.schema)
        rows.validate(full=True)
        _check(rows, table, cell, _pairs_of(first, manifest), str(path))
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        reason = one_line(str(error))[:99]
        raise DamagedPartError(str(path), f"is damaged ({reason})", again) from None
    return rows


def _pairs_of(first: int, manifest: Mapping[str, Any]) -> range:
    """The pairs of the part that begins with pair ``first``."""
    planned = manifest["scenario"]["experiment"]["pairs"]
    return range(first, min(first + manifest["pairs_per_part"], planned))


def _check(rows: pa.Table, table: Table, cell: int, expected: range, where: str) -> None:
    """Refuse values that a part never holds; all code that reads a run relies on this."""
    for column in table.columns:
        values, at = rows[column.name], f"{where}: {column.name}"
        if column.required and values.null_count:
            raise InputError(at, "is empty in a row", "a value in each row")
        if issubclass(column.kind, StrEnum):
            odd = {*values.drop_null().unique().to_pylist()} - {*column.kind}
            if odd:
                raise InputError(at, f"{odd.pop()[:40]!r}", ", ".join(column.kind))
        elif column.kind in (float, int):
            least = _SMALLEST if column.name in _DIVISORS else -_LARGEST * (column.kind is float)
            inside = pc.and_(pc.greater_equal(values, least), pc.less_equal(values, _LARGEST))
            if not pc.all(inside, min_count=0).as_py():
                odd = {v for v in values.drop_null().to_pylist() if not least <= v <= _LARGEST}
                raise InputError(at, f"{odd.pop()!r}", f"{least:g} to {_LARGEST:g}")
    pairs = rows["pair"].to_numpy()
    whole = {*rows["cell"].unique().to_pylist()} <= {cell}
    if table is EPISODES:
        whole = whole and np.array_equal(pairs, np.repeat(expected, 2))
        whole = whole and rows["arm"].to_pylist() == [*Arm] * len(expected)
    else:
        whole = whole and not (np.diff(pairs) < 0).any() and {*pairs.tolist()} <= {*expected}
    if not whole:
        raise InputError(where, "has other rows than its name says", "each pair once, av and human")
