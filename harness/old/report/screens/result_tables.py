"""The tables of all numbers of a run."""

from harness.old.report.screens.result_screen import (
    MOST_CELLS,
    cell_labels,
    cell_name,
)
from harness.old.report.screens.tables import (
    Table,
    TableCell,
    count_cell,
    entry_cell,
    entry_heading,
    level,
    value_cell,
)
from harness.old.statistics import Finding
from harness.old.statistics.findings import CellFindings, RunFindings

STAR = "; * unreliable: too few informative pairs (n)"
"""The caption's explanation of the star behind a value."""


def full_tables(run: RunFindings) -> list[Table]:
    """Return a table of every entry for each cell."""
    return [_every_entry(run, cell) for cell in run.cells[:MOST_CELLS]]


def _every_entry(run: RunFindings, cell: CellFindings) -> Table:
    rows = []
    for entry in run.catalogue:
        av, reference, both = (cell.findings[name] if name else None for name in entry.names)
        # A ratio or difference has a number of pairs; a share has a number of trials in each arm.
        trials = [both] if both else [av, reference]
        counts = [f"{of.n:,}" for of in trials if of is not None and of.n is not None]
        rows.append(
            (
                TableCell(entry_heading(entry, cell.thresholds)),
                *(entry_cell(entry, cell.findings, name) for name in entry.names),
                TableCell(" / ".join(dict.fromkeys(counts))),
                TableCell(_remark(av, reference, both)),
            )
        )
    names = ("AV", cell.reference, "AV against reference")
    if run.between_avs:
        names = (cell.av, cell.reference, "difference")
    headings = ("measure", *names, "n", "remark")
    name = cell_name(cell) or f"{cell.av} against {cell.reference}"
    caption = f"{name}: every measure, {level(run.confidence)} intervals{STAR}"
    return Table(f"every-{cell.cell}", caption, headings, tuple(rows), folded=True)


def _remark(av: Finding | None, reference: Finding | None, both: Finding | None) -> str:
    """Return why numbers are undefined, and in which arm if the other arm's number is defined."""
    undefined = [of for of in (av, reference, both) if of is not None and of.value is None]
    text = "; ".join(dict.fromkeys(of.reason for of in undefined if of.reason))
    if (
        not text
        or av is None
        or reference is None
        or (av.value is None) == (reference.value is None)
    ):
        return text
    return f"{'AV' if av.value is None else 'reference'}: {text}"


def cells_table(run: RunFindings) -> Table:
    """Return the first screen's numbers of all cells of a sweep, as a sortable table."""
    shown = run.cells[:MOST_CELLS]
    labels = cell_labels(shown)
    entries = [of for of in run.catalogue if of.first_screen]
    rows = []
    for place, cell in enumerate(shown):
        row = [value_cell(column[place]) for column in labels.values()]
        row.append(count_cell(cell.pairs))
        for entry in entries:
            row += [entry_cell(entry, cell.findings, name) for name in filter(None, entry.names)]
        rows.append(tuple(row))
    thresholds = shown[0].thresholds
    headings = [
        entry.title_of(name, thresholds) for entry in entries for name in filter(None, entry.names)
    ]
    caption = f"Cells, {level(run.confidence)} intervals; all measures: summary.csv{STAR}"
    return Table("cells", caption, (*labels, "pairs", *headings), tuple(rows), sortable=True)
