"""The findings of a cell, from its episodes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import pyarrow as pa

from harness.results.catalogue import ENTRIES, Entry
from harness.results.columns import Sample
from harness.results.estimators import EQUAL
from harness.results.finding import Finding, Findings, Plain
from harness.scenario import Cell, Scenario


@dataclass(frozen=True)
class CellFindings:
    """The findings of one cell.  ``varied`` has the swept keys with this cell's values."""

    number: int
    varied: Mapping[str, Plain]
    scenario: Scenario
    findings: Findings

    def __getitem__(self, key: str) -> Finding:
        """The finding of a key of the catalogue."""
        return self.findings[key]

    @property
    def arms(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Who drives in each arm, as a note says it, and what the keys of its numbers end with."""
        return ("AV", ""), (self.scenario.arms.human, "_human")

    def total(self, key: str) -> int:
        """A count, or the events of a share, of both arms."""
        return sum(self[f"{key}{end}"].count for _, end in self.arms)


def worst_cases(cells: Sequence[CellFindings]) -> list[Entry]:
    """The worst cases that differ from the number itself in a cell, because pairs are left out."""
    return [
        entry
        for entry in ENTRIES
        if entry.worst_case
        and any(cell[entry.key] != cell[entry.key.removesuffix("_worst")] for cell in cells)
    ]


def on_first_screen(cell: CellFindings) -> list[Entry]:
    """The entries that the first screen of a cell has: all worst cases if pairs are left out.

    A mean that is 0 in every episode of both arms, such as the wait if nobody waits, has no row.
    """
    worst = bool(worst_cases([cell]))
    return [
        entry
        for entry in ENTRIES
        if (entry.screen or (entry.worst_case and worst))
        and not all((cell[key].value, cell[key].reason) == (0, EQUAL) for key in entry.keys)
    ]


def cell_findings(cell: Cell, episodes: pa.Table, confidence: float) -> CellFindings:
    """The findings of a cell.

    Args:
        cell: the cell.
        episodes: its rows of ``episodes`` by pair, the AV's first; at least one pair.
        confidence: two-sided confidence of each interval; 0: no intervals.
    """
    sample = Sample(episodes, cell.scenario, confidence)
    found = {key: each for entry in ENTRIES for key, each in entry.findings(sample).items()}
    return CellFindings(cell.number, cell.varied, cell.scenario, MappingProxyType(found))
