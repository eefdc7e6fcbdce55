"""Prints runs and comparisons on the terminal; a run's JSON document."""

import shlex
from collections.abc import Sequence
from typing import Any

from harness.comparison import ENCOUNTERS, row_of
from harness.report.caveats import av_label, caveats, first_lines
from harness.report.comparison_tables import (
    comparison_caveats,
    comparison_lines,
    comparison_tables,
)
from harness.report.console import make_console, print_table
from harness.report.hour_words import hour_lines, hour_tables
from harness.report.reference_words import reference_lines, references_compared
from harness.report.result_tables import result_tables
from harness.report.words import (
    PAPER_REMARK,
    audit_lines,
    count_lines,
    crash_lines,
    is_the_papers,
    sweep_lines,
    unreliable_keys,
)
from harness.results.measure_tables import conflict_row
from harness.runs.comparisons import RunComparison
from harness.runs.run_data import RunData
from harness.runs.targets import missed_targets
from harness.workers.tasks import Failure


def print_run(run: RunData) -> None:
    """Print what has to be known first, then the results: one cell in full, or over cells."""
    console = make_console()
    # A road that has broken down, too, is said before any number of it.
    for line in hour_lines(run) if run.in_traffic else first_lines(run):
        console.print(line)
    for table in hour_tables(run) if run.in_traffic else result_tables(run):
        print_table(console, table)
    for line in () if run.in_traffic else _lines(run):
        console.print(line)
    for line in reference_lines(cell.scenario for cell in run.study.cells):
        console.print(line)
    for line in audit_lines(run):
        console.print(line)
    console.print(f"Run folder: {run.path}", soft_wrap=True)
    command = f"harness report {shlex.quote(str(run.path))}"
    console.print(f"See it: {command}", soft_wrap=True)


def _lines(run: RunData) -> list[str]:
    if run.varied_keys:
        return [*references_compared(run), *sweep_lines(run.results)]
    (result,) = run.results
    paper = [PAPER_REMARK] if is_the_papers(run.scenario) else []
    return [*crash_lines(result.summary), *count_lines(result), *paper]


def audit_document(run: RunData) -> dict[str, Any] | None:
    """The part of a plain engine's run that was repeated in SUMO; None for a run in SUMO."""
    if run.engine == "sumo":
        return None
    return {
        "share": run.manifest["audit"],
        "records": len(run.audited),
        "differ": _documents(run.disagreements),
        "ties": _documents(run.ties),
    }


def _documents(records: Sequence[Failure]) -> list[dict[str, Any]]:
    return [
        {"cell": cell, "pair": pair, "arm": arm, "difference": what}
        for cell, pair, arm, what in records
    ]


def run_document(run: RunData) -> dict[str, Any]:
    """The document that ``--json`` prints."""
    return {
        "folder": str(run.path),
        "engine": run.engine,
        "audit": audit_document(run),
        "cells": [
            {
                "varied": dict(result.cell.varied),
                "summary": row_of(run.kind.catalogue, result.findings),
            }
            for result in run.results
        ]
        if run.in_traffic
        else [
            {
                "varied": dict(result.cell.varied),
                "av": av_label(result.cell.scenario.arms.av, result.summary),
                "caveats": caveats(result.cell.scenario, result.summary),
                "summary": row_of(ENCOUNTERS, result.findings),
                "conflicts": [conflict_row(rate) for rate in result.conflicts],
                "indicative": unreliable_keys(result.summary),
            }
            for result in run.results
        ],
        "missed_targets": [
            {
                "cell": of.cell,
                "measure": of.measure,
                "target": of.target,
                "half_width": of.half_width,
                "pairs": of.pairs,
            }
            for of in missed_targets(run)
        ],
        "failures": [
            {"cell": cell, "pair": pair, "arm": arm, "reason": why}
            for cell, pair, arm, why in run.failures
        ],
    }


def print_comparison(result: RunComparison) -> None:
    """Print the tables of a comparison and what they say in words."""
    console = make_console()
    for line in comparison_caveats(result):
        console.print(line)
    for table in comparison_tables(result):
        print_table(console, table)
    for line in comparison_lines(result):
        console.print(line)
    cells = [of.cell for group in result.groups for of in group.group.cells]
    for line in reference_lines(cell.scenario for cell in cells):
        console.print(line)
