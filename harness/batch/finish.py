"""From shards to a finished run: tables, summary, and last of all the manifest with counts."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from harness.batch.batch import Batch
from harness.comparison import Summary
from harness.encounter import Ending
from harness.files import write_csv
from harness.results.measure_tables import ConflictRate, conflict_rates, conflict_row, measure_rows
from harness.results.reading import read_table
from harness.results.run_folder import RunFolder
from harness.results.summaries import confidence_of, summarise_cell, summary_row
from harness.results.tables import write_parquet
from harness.scenario import Cell, Study
from harness.workers.tasks import Failure


@dataclass(frozen=True)
class Run:
    """A finished run: where it lies and what came out, by cell."""

    folder: Path
    study: Study
    summaries: tuple[Summary, ...]
    conflicts: tuple[tuple[ConflictRate, ...], ...]
    failures: tuple[Failure, ...]
    """Every episode the engine failed in."""
    output_failures: tuple[Failure, ...] = ()
    """Every episode without SUMO's outputs, of those that were asked for."""


def finish(folder: RunFolder, batch: Batch) -> Run:
    """Turn a folder's shards into tables, summary and, last of all, the manifest with counts."""
    folder.finish_tables(batch.options.traces)
    write_parquet(folder.path / "cells.parquet", *_cells_table(batch.study))
    tables: dict[str, list[dict[str, Any]]] = {"summary": [], "measures": [], "conflicts": []}
    counts = {"pairs": 0, "episodes": 0, **{ending.value: 0 for ending in Ending}}
    cells = []
    for cell, (_, episodes) in zip(batch.study.cells, folder.episodes_by_cell(), strict=True):
        found = _result_of(batch, cell, episodes)
        cells.append(found)
        which = {"cell": cell.number, **cell.varied}
        tables["summary"].append({**cell.varied, **summary_row(found.summary)})
        tables["measures"] += [which | row for row in measure_rows(episodes)]
        tables["conflicts"] += [which | conflict_row(rate) for rate in found.conflicts]
        counts["pairs"] += found.summary.pairs
        counts["episodes"] += episodes.num_rows
        endings = episodes["ending"].to_pylist()
        for ending in Ending:
            counts[ending.value] += endings.count(ending.value)
    for name, rows in tables.items():
        write_csv(folder.path / f"{name}.csv", rows)
    folder.write_manifest(batch.manifest(counts))
    folder.drop_shards()
    folder.note("finished")
    return _run_of(folder.path, batch, cells)


def read_finished(path: Path, batch: Batch) -> Run:
    """What a run folder with all its tables says."""
    cells = (
        _result_of(batch, cell, read_table(path, "episodes", cell.number))
        for cell in batch.study.cells
    )
    return _run_of(path, batch, cells)


class _CellPart(NamedTuple):
    """One cell's part of ``Run``."""

    summary: Summary
    conflicts: tuple[ConflictRate, ...]
    failures: list[Failure]


def _result_of(batch: Batch, cell: Cell, episodes: pa.Table) -> _CellPart:
    confidence = confidence_of(batch.study, batch.options)
    return _CellPart(
        summarise_cell(episodes, cell, confidence),
        conflict_rates(episodes, cell.scenario.conflicts, confidence),
        _failures(episodes, cell.number),
    )


def _run_of(path: Path, batch: Batch, cells: Iterable[_CellPart]) -> Run:
    summaries, conflicts, failures = zip(*cells, strict=True)
    return Run(path, batch.study, summaries, conflicts, tuple(chain.from_iterable(failures)))


def _failures(episodes: pa.Table, cell: int) -> list[Failure]:
    columns = (episodes[name].to_pylist() for name in ("ending", "pair", "arm", "reason"))
    return [
        (cell, pair, arm, reason or "")
        for ending, pair, arm, reason in zip(*columns, strict=True)
        if ending == Ending.ENGINE_FAILED
    ]


def _cells_table(study: Study) -> tuple[pa.Schema, Iterator[pa.Table]]:
    """``cells.parquet``: number and varied keys; mixed types of a key become text."""
    columns: dict[str, pa.Array] = {
        "cell": pa.array([cell.number for cell in study.cells], type=pa.int32())
    }
    for key in study.varied_keys:
        values = [cell.varied[key] for cell in study.cells]
        if any(isinstance(value, float) and math.isfinite(value) for value in values) and all(
            isinstance(value, int | float) and not isinstance(value, bool) for value in values
        ):
            values = [float(value) for value in values]
        try:
            columns[key] = pa.array(values)
        except (pa.ArrowInvalid, pa.ArrowTypeError):
            columns[key] = pa.array([None if value is None else str(value) for value in values])
    table = pa.table(columns)
    return table.schema, iter([table])
