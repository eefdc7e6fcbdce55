"""From shards to a finished run: tables, summary, and last of all the manifest with counts."""

import math
from collections.abc import Iterator
from typing import Any

import pyarrow as pa

from harness.batch.plan import Plan
from harness.comparison import ENCOUNTERS, Findings
from harness.encounter import Ending
from harness.files import write_csv
from harness.results.hour_summaries import hours_row, summarise_hours
from harness.results.measure_tables import conflict_rates, conflict_row, measure_rows
from harness.results.run_folder import RunFolder
from harness.results.summaries import confidence_of, summarise_cell
from harness.results.summary_table import write_summary
from harness.results.tables import write_parquet
from harness.runs.opening import load_run
from harness.runs.run_data import RunData
from harness.scenario import Study


def finish(folder: RunFolder, plan: Plan) -> RunData:
    """Turn a folder's shards into tables, summary and, last of all, the manifest with counts."""
    write_parquet(folder.path / "cells.parquet", *_cells_table(plan.study))
    tables, counts = (_hours if plan.study.in_traffic else _encounters)(folder, plan)
    for name, rows in tables.items():
        write_csv(folder.path / f"{name}.csv", rows)
    folder.write_manifest(plan.manifest(counts))
    folder.drop_shards()
    folder.note("finished")
    return load_run(folder.path)


CsvTables = dict[str, list[dict[str, Any]]]


def _hours(folder: RunFolder, plan: Plan) -> tuple[CsvTables, dict[str, int]]:
    """The tables of hours of traffic; returns their CSVs and counts."""
    folder.finish_tables(plan.shard_tables)
    confidence = confidence_of(plan.study, plan.options)
    summaries, counts = [], dict.fromkeys(("pairs", "hours", "engine_failed"), 0)
    for cell, (_, hours) in zip(plan.study.cells, folder.rows_by_cell("hours"), strict=True):
        summary = summarise_hours(hours, cell.scenario, confidence)
        summaries.append({**cell.varied, **hours_row(summary)})
        counts["pairs"] += summary.pairs
        counts["hours"] += hours.num_rows
        counts["engine_failed"] += hours.num_rows - hours["reason"].null_count
    return {"summary": summaries}, counts


def _encounters(folder: RunFolder, plan: Plan) -> tuple[CsvTables, dict[str, int]]:
    """The tables of encounters; returns their CSVs and counts."""
    folder.finish_tables(plan.shard_tables)
    folder.finish_pairs()
    confidence = confidence_of(plan.study, plan.options)
    tables: CsvTables = {"measures": [], "conflicts": []}
    findings: list[Findings] = []
    counts = {"pairs": 0, "episodes": 0, **{ending.value: 0 for ending in Ending}}
    for cell, (_, episodes) in zip(plan.study.cells, folder.rows_by_cell("episodes"), strict=True):
        summary = summarise_cell(episodes, cell, confidence)
        rates = conflict_rates(summary, cell.scenario.conflicts, confidence)
        which = {"cell": cell.number, **cell.varied}
        findings.append(summary.findings)
        tables["measures"] += [which | row for row in measure_rows(episodes)]
        tables["conflicts"] += [which | conflict_row(rate) for rate in rates]
        counts["pairs"] += summary.pairs
        counts["episodes"] += episodes.num_rows
        endings = episodes["ending"].to_pylist()
        for ending in Ending:
            counts[ending.value] += endings.count(ending.value)
    write_summary(folder.path, ENCOUNTERS, plan.study.cells, findings)
    return tables, counts


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
