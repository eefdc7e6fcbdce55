"""Aligned columns of pairs in; estimates, intervals and findings out."""

from harness.old.statistics.conflicts import CONFLICTS, Conflict
from harness.old.statistics.entries import (
    Catalogue,
    Entry,
    Finding,
    Findings,
    Form,
    Plain,
    columns_of,
    findings_from,
    findings_of,
    row_of,
)
from harness.old.statistics.findings import CellFindings, Note, Rank, RunFindings
from harness.old.statistics.intervals import (
    CONFIDENCE,
    UNDEFINED,
    Interval,
    Proportion,
    clustered_proportion,
    student_mean,
    student_ratio,
    zero_bound,
)

__all__ = [
    "CONFIDENCE",
    "CONFLICTS",
    "UNDEFINED",
    "Catalogue",
    "CellFindings",
    "Conflict",
    "Entry",
    "Finding",
    "Findings",
    "Form",
    "Interval",
    "Note",
    "Plain",
    "Proportion",
    "Rank",
    "RunFindings",
    "clustered_proportion",
    "columns_of",
    "findings_from",
    "findings_of",
    "row_of",
    "student_mean",
    "student_ratio",
    "zero_bound",
]
