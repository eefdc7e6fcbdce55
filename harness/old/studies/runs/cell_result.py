"""The findings of one cell of a run."""

from dataclasses import dataclass

from harness.old.statistics import Findings, Plain, Summary
from harness.old.store.measure_tables import conflict_rows
from harness.scenario import Cell


@dataclass(frozen=True)
class CellResult:
    """The findings of one cell."""

    cell: Cell
    findings: Findings

    @property
    def summary(self) -> Summary:
        """The findings as attributes."""
        return Summary(self.findings)

    @property
    def conflicts(self) -> list[dict[str, Plain]]:
        """The rate of each kind of conflict in each arm: rows of ``conflicts.csv``."""
        return conflict_rows(self.findings, self.cell.scenario.conflicts)
