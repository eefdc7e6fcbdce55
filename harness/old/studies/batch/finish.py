"""Turns the shards of a run into tables, a summary and the final manifest."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping

import pyarrow as pa

from harness.core.files import write_csv
from harness.old.statistics import CONFIDENCE, Findings, Plain
from harness.old.store.run_folder import RunFolder
from harness.old.store.summary_table import write_summary
from harness.old.store.tables import write_parquet
from harness.old.studies.batch.plan import Plan
from harness.old.studies.runs.opening import load_run
from harness.old.studies.runs.run_data import RunData
from harness.scenario import Study


def finish(folder: RunFolder, plan: Plan) -> RunData:
    """Turn a folder's shards into tables and a summary, and write the manifest with counts last."""
    kind, cells = plan.kind, plan.study.cells
    write_parquet(folder.path / "cells.parquet", *_cells_table(plan.study))
    folder.finish_tables(plan.shard_tables)
    for name, derive in kind.derived.items():
        folder.finish_derived(name, kind.rows, derive)
    findings: list[Findings] = []
    statistics: dict[str, list[Mapping[str, Plain]]] = {}
    counts: Counter[str] = Counter()
    for cell, (_, rows) in zip(cells, folder.rows_by_cell(kind.rows), strict=True):
        findings.append(kind.findings(rows, cell, CONFIDENCE))
        keys = {"cell": cell.number, **cell.varied}
        for name, part in kind.statistics(rows, cell, findings[-1]).items():
            statistics.setdefault(name, []).extend(keys | row for row in part)
        counts.update(kind.counts(rows))
    write_summary(folder.path, kind.catalogue, cells, findings)
    for name, table in statistics.items():
        if not table:
            continue  # Every pair failed.
        write_csv(folder.path / f"{name}.csv", table)
    folder.write_manifest(plan.manifest(dict(counts)))
    folder.drop_shards()
    folder.note("finished")
    return load_run(folder.path)


def _cells_table(study: Study) -> tuple[pa.Schema, Iterator[pa.Table]]:
    """Return ``cells.parquet`` with each cell's number and varied keys.

    A key whose values have different types is stored as text.
    """
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
