"""Reads and checks the manifest and the tables of a run folder (docs/files.md)."""

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Literal

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, Field

from harness.core.documents import JsonObject, check_form, parse_json
from harness.core.errors import InputError, reading, resume_command
from harness.core.files import read_file
from harness.old.store.checks import check_values
from harness.old.store.schemas import SCHEMA, TABLES
from harness.old.store.tables import with_schema
from harness.scenario import EngineName

MANIFEST = "manifest.json"

RISK = "risk.json"
"""The settings of a risk estimate, in its folder."""

CRITICAL = "critical.toml"
"""The scenario of the likeliest events, in the folder of a finished risk estimate."""


class _ScoredWith(BaseModel):
    versions: dict[str, str]


class _SimulatedWith(_ScoredWith):
    strategies: dict[str, str]
    models: list[dict[Literal["name", "sha256"], str]]


class _Manifest(BaseModel):
    """The form of ``manifest.json``; its scenario is checked by ``study_from``."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)

    name: str
    scenario: JsonObject
    cells: Annotated[list[JsonObject], Field(min_length=1)]
    traces: bool
    engine: EngineName
    seed: int
    know_the_model: list[str]
    simulated_with: _SimulatedWith
    scored_with: _ScoredWith
    counts: dict[str, int] | None


def kind_of_folder(folder: Path) -> Literal["run", "risk"]:
    """The kind of a folder: a risk estimate, or otherwise a run."""
    return "risk" if (folder / RISK).is_file() else "run"


def read_manifest(folder: Path) -> JsonObject:
    """The manifest of a run folder.

    Raises:
        InputError: the folder holds no run, its format has another version, or its manifest is
            damaged.
    """
    path = folder / MANIFEST
    if kind_of_folder(folder) == "risk":
        raise _is_a_risk(folder)
    if not path.is_file():
        raise InputError(str(folder), "is not a run folder", f"a folder with {MANIFEST}")
    try:
        document = parse_json(read_file(path))
    except ValueError as error:
        raise InputError(str(path), f"is damaged ({error})") from None
    version = document.get("schema") if isinstance(document, dict) else None
    if version != SCHEMA:
        advice = ": run its scenario again, or use the version of the harness that wrote it"
        allowed = f"{SCHEMA}{advice if type(version) is int else ''}"
        raise InputError(str(path), f"format version {version!r}", allowed)
    check_form(_Manifest, document, str(path))
    checked: JsonObject = document
    return checked


def read_finished_manifest(folder: Path) -> JsonObject:
    """The manifest of a run that is finished.

    Raises:
        InputError: as in ``read_manifest``, or the run is not finished.
    """
    document = read_manifest(folder)
    if document["counts"] is None:
        problem = f"`{resume_command(folder)}` finishes it"
        raise InputError(str(folder), "is not finished", problem)
    return document


def _is_a_risk(folder: Path) -> InputError:
    """The error about a risk estimate where a run is needed."""
    problem, critical = "is a risk estimate, not a run", folder / CRITICAL
    if critical.is_file():
        allowed = f"a run of its likeliest events: `harness run {shlex.quote(str(critical))}`"
    else:
        allowed = f"a run; {CRITICAL} is there when the estimate has ended and found events"
    return InputError(str(folder), problem, allowed)


def read_table(
    folder: Path,
    name: str,
    cell: int | None = None,
    pair: int | None = None,
) -> pa.Table:
    """A table of a finished run: the whole table, the rows of a cell, or the rows of a pair.

    Args:
        folder: the run's folder.
        name: the table's name.
        cell: the number of a cell; None for all cells.
        pair: the number of a pair; None for all pairs.

    Returns:
        The table, with the types of ``TABLES``.

    Raises:
        InputError: the table is missing, damaged, or lacks a column.
    """
    wanted = [(key, "=", value) for key, value in (("cell", cell), ("pair", pair))]
    filters = [condition for condition in wanted if condition[2] is not None]
    with _reading(folder, name) as path:
        table = pq.read_table(path, filters=filters or None, page_checksum_verification=True)
        if name in TABLES:
            table = with_schema(table, name, str(path))
        table.validate(full=True)
    if name in TABLES:
        check_values(table, name, str(path))
    return table


def count_rows(folder: Path, name: str) -> int:
    """Number of rows of a finished run's table, read from its footer.

    Raises:
        InputError: the table is missing or damaged.
    """
    with _reading(folder, name) as path:
        return int(pq.read_metadata(path).num_rows)


@contextmanager
def _reading(folder: Path, name: str) -> Iterator[Path]:
    """The path of a table; errors inside become an ``InputError`` of one line."""
    path = folder / f"{name}.parquet"
    if not path.exists() and (folder / "hours.parquet").exists():
        what = f"is a run of hours of traffic, which has no table {name}"
        raise InputError(str(folder), what, "a run without [traffic]")
    if not path.exists():
        raise InputError(str(path), "is missing", "a finished run's table")
    if not path.is_file():
        raise InputError(str(path), "is not a regular file", "a run's table")
    with reading(path):
        try:
            yield path
        except pa.ArrowException as error:
            raise ValueError(str(error)) from None
