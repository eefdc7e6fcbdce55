"""Conflicts between people and vehicles in a recorded SUMO simulation."""

from harness.old.studies.conflicts.finding import find_conflicts
from harness.old.studies.conflicts.folder import (
    check_new,
    document_of,
    is_conflicts,
    whole_folder,
    worst_passages,
    worst_rows,
    write_tables,
)
from harness.old.studies.conflicts.records import (
    REASONS,
    ConflictFindings,
    ConflictPassage,
    CrosswalkConflicts,
)

__all__ = [
    "REASONS",
    "ConflictFindings",
    "ConflictPassage",
    "CrosswalkConflicts",
    "check_new",
    "document_of",
    "find_conflicts",
    "is_conflicts",
    "whole_folder",
    "worst_passages",
    "worst_rows",
    "write_tables",
]
