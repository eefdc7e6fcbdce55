"""The findings of a cell as attributes: ``summary.mu.low``, ``summary.kappa.successes``."""

from dataclasses import dataclass
from typing import Any

from harness.old.statistics.bootstrap import Resampled
from harness.old.statistics.catalogue import ENCOUNTERS, ENTRIES
from harness.old.statistics.encounter_columns import EncounterColumns
from harness.old.statistics.entries import Findings, findings_of
from harness.old.statistics.intervals import Interval, Proportion


@dataclass(frozen=True)
class Summary:
    """The findings of a cell of encounters; each is an attribute."""

    findings: Findings

    def __getattr__(self, name: str) -> Any:
        """A finding as its interval, or as its value if it has no interval."""
        if name not in ENTRIES:
            raise AttributeError(name)
        finding, kind = self.findings[name], ENTRIES[name].interval
        ends = (finding.number, finding.low, finding.high)
        if kind is Proportion:
            return Proportion(*ends, finding.events or 0, finding.n or 0)
        if kind is Resampled:
            return Resampled(*ends, finding.n or 0)
        return finding.value if kind is None else Interval(*ends)


def summarise(columns: EncounterColumns) -> Summary:
    """The summary of a cell of encounters, from its columns."""
    return Summary(findings_of(ENCOUNTERS, columns))
