"""The findings of a cell, from its episodes or simulations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from harness.core.errors import Parameter, unknown_name
from harness.core.freezing import Frozen
from harness.results.catalogue import ENTRY_OF, AnySample, Entry, entries_of
from harness.results.columns import PairSample
from harness.results.estimators import EQUAL
from harness.results.finding import Finding, Findings, Plain
from harness.results.simulated import SimulationSample
from harness.results.tables import RunKind, Tables
from harness.scenario import Cell, Scenario


@dataclass(frozen=True)
class CellFindings(Frozen):
    """The findings of one cell.

    Attributes:
        number: the cell's number.
        varied: the swept keys with this cell's values.
        scenario: its scenario.
        findings: of the whole cell.
        by_crosswalk: of each crosswalk of a simulation, without those of the whole network.
    """

    number: int
    varied: Mapping[str, Plain]
    scenario: Scenario
    findings: Findings
    by_crosswalk: Mapping[str, Findings] = field(default_factory=dict)

    @property
    def kind(self) -> RunKind:
        """The kind of its run."""
        return self.scenario.kind

    def __getitem__(self, key: str) -> Finding:
        """The finding of a key of the catalogue.

        Raises:
            InputError: the cell has no such finding.
        """
        if key not in self.findings:
            raise unknown_name(Parameter("key"), "finding", key, self.findings)
        return self.findings[key]

    @property
    def arms(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Who drives in each arm, as a note says it, and what the keys of its numbers end with."""
        return ("AV", ""), (self.scenario.arms.human, "_human")

    def total(self, key: str) -> int:
        """A count, or events of a share, of both arms or of pairs.

        What is undefined because every pair failed adds nothing: the first note says so.

        Raises:
            InputError: only runs of other kinds have it.
        """
        own = (self[name] for name in ENTRY_OF[key].keys[:2])
        return sum(finding.count for finding in own if finding.value is not None)


def records_of(cell: CellFindings) -> list[dict[str, Plain | Finding]]:
    """The numbers of a cell, then of each of its crosswalks, with who drove."""
    arms = cell.scenario.arms
    first = {"cell": cell.number, **cell.varied, "av": arms.av, "reference": arms.human}
    if not cell.by_crosswalk:
        return [{**first, **cell.findings}]
    at = [{**first, "crosswalk": name, **found} for name, found in cell.by_crosswalk.items()]
    return [{**first, "crosswalk": None, **cell.findings}, *at]


def worst_cases(cells: Sequence[CellFindings]) -> list[Entry]:
    """The worst cases that differ from the number itself in a cell, because pairs are left out."""
    return [
        entry
        for entry in entries_of(cells[0].kind)
        if entry.worst_of and any(cell[entry.key] != cell[entry.worst_of] for cell in cells)
    ]


def on_first_screen(cell: CellFindings) -> list[Entry]:
    """The entries that the first screen of a cell has: all worst cases if pairs are left out.

    A mean that is 0 in every episode of both arms, such as the wait if nobody waits, has no row.
    """
    worst, entries = worst_cases([cell]), entries_of(cell.kind)
    found = [[cell[key] for key in entry.keys] for entry in entries]
    return [
        entry
        for entry, before, own in zip(entries, [[], *found], found, strict=False)
        if (entry.screen != "never" or (entry.worst_of and worst))
        and not all((each.value, each.reason) == (0, EQUAL) for each in own)
        and not (entry.screen == "other" and (own == before or all(e.value is None for e in own)))
    ]


def cell_findings(cell: Cell, tables: Tables, confidence: float) -> CellFindings:
    """The findings of a cell.

    Args:
        cell: the cell.
        tables: its rows by pair, the AV's first, with at least one pair: see ``sample_of``.
        confidence: two-sided confidence of each interval; 0: no intervals.
    """
    entries = entries_of(cell.scenario.kind)
    sample = sample_of(tables, cell.scenario, confidence)

    def found(sample: AnySample, entries: Sequence[Entry]) -> dict[str, Finding]:
        return {key: each for entry in entries for key, each in entry.findings(sample).items()}

    whole, places = found(sample, entries), dict[str, Findings]()
    if isinstance(sample, SimulationSample):
        why = sample.why_not_driven() or whole["not_driven"].reason
        whole["not_driven"] = replace(whole["not_driven"], reason=why)
        by_crosswalk = [entry for entry in entries if not entry.network]
        places = {name: found(sample.at(name), by_crosswalk) for name in sample.crosswalks}
    return CellFindings(cell.number, cell.varied, cell.scenario, whole, places)


def sample_of(tables: Tables, scenario: Scenario, confidence: float) -> AnySample:
    """The columns of a cell from its rows: of encounters from ``episodes`` alone."""
    if "episodes" in tables:
        return PairSample(tables["episodes"], scenario, confidence)
    return SimulationSample(tables, scenario, confidence)
