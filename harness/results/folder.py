"""The files of a run folder: manifest, parts, findings.

``pd.read_parquet("RUN/episodes")`` reads a whole table.  A part appears complete or not at all,
that of ``episodes`` or ``arms`` last: if it exists, its task is done.
"""

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any, NotRequired, TypedDict, cast

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from harness.core.documents import JsonObject, as_plain, parse_json
from harness.core.errors import InputError, advised, one_line
from harness.core.files import PACKAGE, cannot_write, read_file, whole_file, write_csv, write_file
from harness.core.versions import versions_of_fits
from harness.core.vocabulary import Arm
from harness.results.cell_findings import CellFindings, records_of
from harness.results.finding import Finding, Plain, finding_to_dict
from harness.results.result import flat
from harness.results.tables import TABLES, TABLES_OF, RunKind, TableSchema
from harness.scenario import Cell, EngineName

MANIFEST, SUMMARY, LOG = "manifest.json", "summary.csv", "log.jsonl"

FINDINGS = "findings.json"
"""The file that is written last: a run is finished if it exists."""

EVENTS = "events"
"""The folder of the run that a risk makes of its events."""

MAKES_ROWS = (
    "core/* site/* measures/**/* model/interaction model/mixture/* scenario/* strategies/**/* "
    "engine/* encounter/* simulation/* results/estimators results/finding results/rows "
    "results/tables studies/risk/* studies/running/[est]*"
)
"""The modules that make rows of scenarios; in ``running`` episodes, simulations and tasks."""

COMPUTES = f"{MAKES_ROWS} results/c[ao]* results/cell_f* results/s*"
"""These and those that make findings of rows; those of screens make none."""

_DIGEST = b"harness.digest"
"""The key of the manifest's digest in a part's metadata."""

_PART = re.compile(r"(\d{4,})-(\d{8,})\.parquet")


class SimulatedWith(TypedDict):
    """What results depend on: versions by name, and the digests of what may be edited."""

    versions: dict[str, str]
    code: dict[str, str]
    strategies: dict[str, str]
    models: dict[str, str]
    files: dict[str, str]


class RiskAsked(TypedDict):
    """What a risk is of; ``not_sampled`` is what is random besides, in words."""

    event: str
    arm: str
    target_cv: float
    not_sampled: list[str]


class Manifest(TypedDict):
    """``manifest.json``, on which everything in a run depends; docs/files.md."""

    schema: str
    kind: RunKind
    name: str
    scenario: JsonObject
    cells: list[dict[str, Plain]]
    traces: bool
    engine: EngineName
    confidence: float
    pairs_per_part: int
    seed: int
    know_the_model: list[str]
    simulated_with: SimulatedWith
    risk: NotRequired[RiskAsked]
    digest: str


class DamagedPartError(InputError):
    """The file of a part cannot be read."""


_LAST = tuple(tables[0] for tables in TABLES_OF.values())
"""The tables whose part is written last: where it exists, its task is done."""


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write ``manifest.json``."""
    write_file(folder / MANIFEST, _json(manifest))


def read_manifest(folder: Path, old: bool = False) -> Manifest:
    """The manifest of a run folder.

    Args:
        folder: the folder.
        old: whether a run whose tables have other columns than today's is wanted, too.

    Raises:
        InputError: the folder holds no run, its tables have other columns, or its manifest has
            other keys, has been edited, or is damaged.
    """
    path = folder / MANIFEST
    if not path.is_file():
        raise InputError(str(folder), "is not a run folder", f"a folder with {MANIFEST}")
    document = _read(path, "as the run wrote it")
    if document.get("schema") != schema_digest() and not old:
        allowed = f"those of this version: `{advised('run', folder)}` simulates its pairs again"
        raise InputError(str(path), "is of tables with other columns", allowed)
    return cast(Manifest, document)


def part_name(cell: int, first: int) -> str:
    """The file name of the part of a cell that begins with pair ``first``."""
    return f"{cell:04d}-{first:08d}.parquet"


def done_parts(folder: Path) -> set[tuple[int, int]]:
    """The finished parts of a run folder: cell and first pair."""
    names = (path.name for at in _LAST for path in (folder / at.name).glob("*.parquet"))
    return {(int(match[1]), int(match[2])) for match in map(_PART.fullmatch, names) if match}


def write_part(
    folder: Path, cell: int, first: int, tables: Mapping[str, pa.Table], digest: str
) -> None:
    """Write the parts of a task's rows of one cell, ``episodes`` or ``arms`` last.

    Args:
        folder: the run's folder.
        cell: number of the cell.
        first: number of the first pair.
        tables: the rows by the table's name.
        digest: of the run's manifest.

    Raises:
        HarnessError: the file system refuses (full, read-only); no half-written file stays.
    """
    for name in sorted(tables, key=[table.name for table in _LAST].__contains__):
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
    folder: Path, name: str, cell: int, manifest: Manifest, pair: int | None = None
) -> pa.Table:
    """The rows of a cell in a table by pair, the AV's first, up to the first part that is missing.

    No part may be missing of a run that is finished.

    Args:
        folder: the run's folder.
        name: name of the table.
        cell: number of the cell.
        manifest: the run's manifest.
        pair: the only pair to read; None: all.

    Raises:
        InputError: a part is damaged, is another run's, or has a value that no part has; or one
            of a finished run is missing.
    """
    size, parts = manifest["pairs_per_part"], [TABLES[name].schema.empty_table()]
    first = 0 if pair is None else pair // size * size
    finished = is_finished(folder)
    while _pairs_of(first, manifest) and (
        finished or any((folder / table.name / part_name(cell, first)).is_file() for table in _LAST)
    ):
        parts.append(read_part(folder, name, cell, first, manifest))
        if pair is not None:
            break
        first += size
    rows = pa.concat_tables(parts)
    return rows if pair is None else rows.filter(rows["pair"].to_numpy() == pair)


def read_part(
    folder: Path,
    name: str,
    cell: int,
    first: int,
    manifest: Manifest,
    expected: range | None = None,
) -> pa.Table:
    """The rows of one part, with the pairs ``expected``, or those planned; see ``read_cell``."""
    expected = expected or _pairs_of(first, manifest)
    table, path = TABLES[name], folder / name / part_name(cell, first)
    again = f"delete the file; `{advised('resume', folder)}` simulates its pairs again"
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            if (file.schema_arrow.metadata or {}).get(_DIGEST) != manifest["digest"].encode():
                raise InputError(str(path), "belongs to another run", "the parts of this run")
            rows = file.read(use_threads=False).select(table.schema.names)
        rows = rows.replace_schema_metadata().cast(table.schema)
        rows.validate(full=True)
    except FileNotFoundError:
        ends = " to ".join(map(str, sorted({expected[0], expected[-1]})))
        problem = f"{name} are missing: cell {cell}, pair {ends}"
        raise DamagedPartError(folder, problem, advised("resume", folder)) from None
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        what = "has other columns" if isinstance(error, KeyError) else "is damaged"
        raise DamagedPartError(str(path), f"{what} ({one_line(str(error))[:99]})", again) from None
    _check(rows, table, cell, expected, str(path))
    return rows


def _pairs_of(first: int, manifest: Manifest) -> range:
    """The pairs of the part that begins with pair ``first``."""
    planned = manifest["scenario"]["experiment"]["pairs"]
    return range(first, min(first + manifest["pairs_per_part"], planned))


def _check(rows: pa.Table, table: TableSchema, cell: int, expected: range, where: str) -> None:
    """Refuse values that a part never holds; all code that reads a run relies on this."""
    pairs = rows["pair"].to_numpy()
    whole = {*rows["cell"].unique().to_pylist()} <= {cell}
    if "arm" in rows.schema.names and table in _LAST:
        whole = whole and np.array_equal(pairs, np.repeat(expected, 2))
        whole = whole and rows["arm"].to_pylist() == [*Arm] * len(expected)
    else:
        whole = whole and not (np.diff(pairs) < 0).any() and {*pairs.tolist()} <= {*expected}
    if not whole:
        raise InputError(where, "has other rows than its name says", "each pair once, av and human")


def write_findings(folder: Path, manifest: Manifest, cells: Sequence[CellFindings]) -> None:
    """Write the findings of all cells, after ``summary.csv`` with a row for each cell.

    Each cell has an object for each of a simulation's crosswalks, after that of all of it, whose
    name is empty.

    Args:
        folder: the run's folder.
        manifest: its manifest.
        cells: the findings of each cell.

    Raises:
        HarnessError: the file system refuses.
    """
    written = {
        str(cell.number): {
            name: {key: finding_to_dict(finding) for key, finding in found.items()}
            for name, found in {"": cell.findings, **cell.by_crosswalk}.items()
        }
        for cell in cells
    }
    write_csv(folder / SUMMARY, [flat(row) for cell in cells for row in records_of(cell)])
    document = {"run": manifest["digest"], "code": code_digest(), "cells": written}
    write_file(folder / FINDINGS, _json(sealed(document)))


def is_finished(folder: Path) -> bool:
    """Whether a run is finished."""
    return (folder / FINDINGS).is_file()


def read_findings(
    folder: Path, manifest: Manifest, cells: Sequence[Cell], old: bool = False
) -> tuple[CellFindings, ...] | None:
    """The stored findings of a run.

    Args:
        folder: its folder.
        manifest: its manifest.
        cells: its cells.
        old: whether findings of other code than today's are wanted.

    Returns:
        None if the run is not finished, or if the code that makes findings of rows has changed.

    Raises:
        InputError: the file is damaged, has been edited, or belongs to another run.
    """
    if not is_finished(folder):
        return None
    path = folder / FINDINGS
    advice = f"delete it; `{advised('resume', folder)}` computes it again"
    document, found = _read(path, advice), []
    if document.get("run") != manifest["digest"]:
        raise InputError(str(path), "belongs to another run", advice)
    if document["code"] != code_digest() and not old:
        return None
    for cell in cells:
        own = {
            name: {key: Finding(**parts) for key, parts in each.items()}
            for name, each in document["cells"][str(cell.number)].items()
        }
        found.append(CellFindings(cell.number, cell.varied, cell.scenario, own.pop(""), own))
    return tuple(found)


@cache
def code_digest() -> str:
    """The digest of the code that makes findings of rows, and of its libraries' versions."""
    return _digest(json.dumps(versions_of_fits()).encode(), _code(COMPUTES).encode())


def code_of_rows() -> dict[str, str]:
    """The digest of the code that makes rows, which nothing computes again."""
    return {"the rows": _code(MAKES_ROWS)}


@cache
def schema_digest() -> str:
    """The digest of the manifest's keys and of all tables' columns, with their types and words."""
    keys = [*Manifest.__annotations__, *SimulatedWith.__annotations__]
    kinds = [column.kind for table in TABLES.values() for column in table.columns]
    words = [str(word) for kind in kinds if issubclass(kind, StrEnum) for word in kind]
    columns = [table.schema.to_string() for table in TABLES.values()]
    return _digest(repr((keys, columns, words)).encode())


def tried_again(folder: Path) -> int | None:
    """The number of tasks that ran again because their process had died.

    None if that is not known: the log is missing, or does not begin with the run.
    """
    log = read_file(folder / LOG) if (folder / LOG).is_file() else b""
    begins = b'"event": "started"' in log.partition(b"\n")[0]
    return log.count(b'"event": "tried again"') if begins else None


def unfinished(folder: Path) -> InputError:
    """The refusal of a run that is not finished."""
    return InputError(folder, "is not finished", f"`{advised('resume', folder)}` finishes it")


def sealed(document: Mapping[str, Any]) -> JsonObject:
    """A document with the digest of its content."""
    content = {key: value for key, value in document.items() if key != "digest"}
    return {**content, "digest": _digest(_json(content))}


@cache
def _code(modules: str) -> str:
    """The digest of the source texts of these modules of the package."""
    paths = (path for name in modules.split() for path in sorted(PACKAGE.glob(f"{name}.py")))
    return _digest(*map(_source, paths))


_source = cache(Path.read_bytes)


def _digest(*parts: bytes) -> str:
    return hashlib.sha256(b"".join(parts)).hexdigest()


def _read(path: Path, allowed: str) -> JsonObject:
    """A document that was written with its digest."""
    try:
        document: JsonObject = parse_json(read_file(path))
        if not isinstance(document, dict) or document != sealed(document):
            raise ValueError("it was edited: its digest differs")
    except ValueError as error:
        raise InputError(str(path), f"is damaged ({one_line(str(error))[:99]})", allowed) from None
    return document


def _json(document: Mapping[str, Any]) -> bytes:
    plain = as_plain(document)
    return f"{json.dumps(plain, indent=1, allow_nan=False, ensure_ascii=False)}\n".encode()
