"""The JSON document of ``harness run --json``."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict

from harness.old.statistics import Catalogue, CellFindings, Plain, RunFindings, row_of
from harness.old.studies.kinds.tasks import Failure
from harness.old.studies.runs.reported import reported
from harness.old.studies.runs.run_data import RunData

SCHEMA = 2
"""Version of the document's layout; version 2 added ``findings``."""

Document = Mapping[str, object]


def run_document(run: RunData) -> Document:
    """Return the document that ``--json`` prints."""
    return {
        "schema": SCHEMA,
        "folder": str(run.path),
        "cells": _cells(run),
        "failures": _records(run.failures, "reason"),
    }


def arms_document(findings: RunFindings) -> Document:
    """Return the document that ``harness compare --json`` prints for runs with long pairs."""
    return {
        "schema": SCHEMA,
        "comparisons": [
            {"second": cell.reference, **_cell(findings.catalogue, cell)} for cell in findings.cells
        ],
    }


def arms_rows(findings: RunFindings) -> list[dict[str, Plain]]:
    """Return the rows of ``harness compare --out`` for runs with long pairs, one per comparison."""
    return [
        {"first": cell.av, "second": cell.reference, **row_of(findings.catalogue, cell.findings)}
        for cell in findings.cells
    ]


def _cells(run: RunData) -> list[Document]:
    findings = reported(run)
    return [_cell(findings.catalogue, cell) for cell in findings.cells]


def _cell(catalogue: Catalogue, cell: CellFindings) -> Document:
    return {
        "varied": dict(cell.varied),
        "av": cell.av,
        "caveats": [note.text for note in cell.notes],
        "summary": row_of(catalogue, cell.findings),
        "findings": {name: asdict(finding) for name, finding in cell.findings.items()},
        "indicative": [name for name, of in cell.findings.items() if of.reliable is False],
    }


def _records(records: Sequence[Failure], last: str) -> list[Document]:
    names = ("cell", "pair", "arm", last)
    return [dict(zip(names, record, strict=True)) for record in records]
