"""The tables of all numbers of a run, and of the statistics of its measures."""

import re

from harness.measures import MEASURES
from harness.old.report.screens.result_screen import (
    MODEL_HEADING,
    MOST_CELLS,
    cell_labels,
    cell_name,
)
from harness.old.report.screens.result_texts import over_model_limits
from harness.old.report.screens.tables import (
    Table,
    TableCell,
    count_cell,
    entry_cell,
    entry_heading,
    level,
    sort_key,
    value_cell,
)
from harness.old.statistics import Finding
from harness.old.statistics.findings import CellFindings, RunFindings
from harness.old.studies.runs.run_data import RunData

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
                *([TableCell(over_model_limits(entry, cell))] if cell.over_model else []),
                *([TableCell(entry.paper)] if run.paper else []),
                TableCell(_remark(av, reference, both)),
            )
        )
    paper = ["paper, N = 50"] if run.paper else []
    over = [MODEL_HEADING] if cell.over_model else []
    names = ("AV", cell.reference, "AV against reference")
    if run.between_avs:
        names = (cell.av, cell.reference, "difference")
    named = ("measure", *names, "n")
    headings = (*named, *over, *paper, "remark")
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
    entries = [of for of in run.catalogue if of.first_screen or of.worst_case]
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


def statistics_table(run: RunData) -> Table:
    """Return a table of mean and quantiles of every measure in both arms."""
    of = {(row["arm"], row["measure"]): row for _, row in run.measures.iterrows()}
    rows = []
    for measure in MEASURES:
        unit = f" ({measure.unit})" if measure.unit else ""
        cells = [TableCell(f"{_spoken(measure.column)}{unit}", measure.formula)]
        for arm in ("av", "human"):
            row = of[arm, measure.column]
            low, middle, high = (_three(row[name]) for name in ("p05", "p50", "p95"))
            quantiles = f"{low} / {middle} / {high}" if row["defined"] else ""
            cells += [
                TableCell(f"{row['defined']:,}", sort=str(row["defined"])),
                TableCell(_three(row["mean"]), quantiles, sort_key(row["mean"])),
            ]
        rows.append(tuple(cells))
    headings = ("measure", "n, AV", "mean, AV", "n, human", "mean, human")
    caption = "Every measure over the episodes in which it is defined: mean, and 5 % / 50 % / 95 %"
    return Table("statistics", caption, headings, tuple(rows), folded=True)


def _three(value: float | None) -> str:
    # Differences of times have rounding errors in their last bits.
    return "undefined" if value is None or value != value else f"{round(value, 9) + 0.0:.3g}"


def _spoken(column: str) -> str:
    """Return a column's name without its unit."""
    words = re.sub(r"_(s|m|mps|mps2|mps3)$", "", column).split("_")
    return " ".join(word.upper() if word in ("ttc", "pet", "drac") else word for word in words)
