"""Reads a run folder: its manifest, whose form is checked, and its tables (docs/files.md)."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from harness.documents import parse_json
from harness.errors import InputError, resume_command
from harness.results.rows import check_rows
from harness.results.tables import SCHEMA, TABLES

MANIFEST = "manifest.json"

_HAS_ALL = "a run of this version, or `harness score` of one that kept its traces"


_Width = Annotated[float, Field(gt=0, lt=1)]


class _Manifest(BaseModel):
    """The form of ``manifest.json``; what its scenario means is ``study_from``'s business."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)

    name: str
    scenario: dict[str, Any]
    cells: Annotated[list[dict[str, Any]], Field(min_length=1)]
    traces: bool
    sumo_outputs: Literal["all", "crashed"] | None
    until: Annotated[dict[Literal["mu", "kappa"], _Width], Field(min_length=1, max_length=1)] | None
    seed: int
    versions: dict[str, str]
    models: list[dict[str, str]]
    counts: dict[str, int] | None


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a run folder.

    Raises:
        InputError: the folder holds no run, or its manifest is damaged.
    """
    path = folder / MANIFEST
    try:
        if not path.is_file():
            raise InputError(str(folder), "is no run folder", f"a folder with {MANIFEST}")
        document = parse_json(path.read_bytes())
    except OSError:
        raise InputError(str(folder), "is no run folder", f"a folder with {MANIFEST}") from None
    except ValueError:
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
        finishes = f"`{resume_command(folder)}` finishes it"
        raise InputError(str(folder), "is not finished", finishes)
    return document


def read_table(
    folder: Path,
    name: str,
    cell: int | None = None,
    pair: int | None = None,
    optional: Collection[str] = (),
) -> pa.Table:
    """One table of a finished run: all of it, one cell's rows, or one pair's.

    Args:
        folder: of the run.
        name: of the table.
        cell: whose rows; None: all cells'.
        pair: likewise.
        optional: columns that a run of an earlier version may lack; such a column is left out.

    Raises:
        InputError: the table is missing, damaged, or of another format.
    """
    wanted = [(key, "=", value) for key, value in (("cell", cell), ("pair", pair))]
    filters = [condition for condition in wanted if condition[2] is not None]
    with _reading(folder, name) as path:
        table = pq.read_table(path, filters=filters or None)
        if name not in TABLES:
            return table
        held = pa.schema([field for field in TABLES[name] if field.name in table.column_names])
        needed = [column for column in TABLES[name].names if column not in optional]
        missing = [column for column in needed if column not in held.names]
        if missing:
            raise InputError(str(path), f"lacks {missing[0]}", _HAS_ALL)
        table = table.select(held.names).cast(held)
        check_rows(table, str(path))
        return table


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
        if path.exists() and not path.is_file():
            raise InputError(str(path), "is no regular file", "a run's table")
        yield path
    except FileNotFoundError:
        raise InputError(str(path), "is missing", "a finished run's table") from None
    except (OSError, pa.ArrowException, ValueError) as error:
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(str(path), f"cannot be read ({why})", "a run's table") from None
