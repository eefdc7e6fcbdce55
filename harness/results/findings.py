"""The findings of a cell, from its episodes."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import pyarrow as pa

from harness.results.catalogue import ENTRIES
from harness.results.columns import Sample
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


def cell_findings(
    cell: Cell, episodes: pa.Table, confidence: float, keys: Collection[str] | None = None
) -> CellFindings:
    """The findings of a cell.

    Args:
        cell: the cell.
        episodes: its rows of ``episodes`` by pair, the AV's first; at least one pair.
        confidence: two-sided confidence of each interval; 0: no intervals.
        keys: the keys of the entries to compute; None: all.
    """
    sample = Sample(episodes, cell.scenario, confidence)
    found = {
        key: finding
        for entry in ENTRIES
        if keys is None or {*keys} & {*entry.keys}
        for key, finding in entry.findings(sample).items()
    }
    return CellFindings(cell.number, cell.varied, cell.scenario, MappingProxyType(found))
