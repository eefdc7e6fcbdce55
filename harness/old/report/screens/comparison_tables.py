"""The tables and notes of a comparison, for the terminal and the page."""

from collections.abc import Sequence

from harness.old.report.screens.joined_notes import joined_notes
from harness.old.report.screens.result_screen import MODEL_HEADING
from harness.old.report.screens.tables import (
    Table,
    TableCell,
    count_cell,
    counted,
    entry_cell,
    entry_heading,
    interval_cell,
    named_values,
    share_cell,
    value_cell,
)
from harness.old.statistics import (
    DIFFERENCES,
    ENCOUNTERS,
    ENTRIES,
    Interval,
    Note,
    Rank,
)
from harness.old.studies.runs.comparisons import GroupResult, RunComparison, SweepResult
from harness.old.studies.runs.notes import av_label, encounter_notes
from harness.scenario import as_written


def comparison_tables(result: RunComparison) -> list[Table]:
    """Return tables of every group's cells, the differences, and the allowed values."""
    tables = []
    for place, group in enumerate(result.groups):
        shared = named_values(group.group.shared)
        name = f"{result.name}, {shared}" if shared else result.name
        tables.append(_cell_table(group, f"compared-{place}", name))
        if group.comparisons:
            tables.append(_difference_table(group, f"differences-{place}", name))
        tables += [
            _sweep_table(sweep, group, f"allowed-{place}-{position}")
            for position, sweep in enumerate(group.sweeps)
        ]
    return tables


def comparison_notes(result: RunComparison) -> tuple[Note, ...]:
    """Return the notes that a reader needs for the comparison's numbers."""
    cells = [
        (cell.number, encounter_notes(cell.cell.scenario, summary.findings, ENCOUNTERS))
        for group in result.groups
        for cell, summary in zip(group.group.cells, group.summaries, strict=True)
    ]
    notes = [*joined_notes(cells), *_model_notes(result)]
    return tuple(sorted(notes, key=lambda note: note.rank))


def _model_notes(result: RunComparison) -> list[Note]:
    """Return notes about the differences of the ratio of times that the model's fit decides."""
    key, texts = "time_ratio_difference", []
    pairs = [
        (item.time_ratio_difference, item.over_model[key])
        for group in result.groups
        for item in group.comparisons
        if item.over_model
    ]
    of = f"of {counted(len(pairs), 'difference')} of the ratio of times"
    if open_ := sum(_excludes_0(usual) and not _excludes_0(over) for usual, over in pairs):
        texts.append(
            f"{open_:,} {of} that the pairs show may be reversed by the model's fit: with the "
            "model the interval contains 0 (--full)."
        )
    surely = sum(over.surely_model for _, over in pairs)
    perhaps = sum(over.mostly_model for _, over in pairs) - surely
    if surely:
        texts.append(
            f"In {surely:,} {of} more than half of the variance comes from the model's fit: more "
            "pairs will not help there."
        )
    if perhaps:
        texts.append(
            f"In {perhaps:,} {of} more than half of the variance is estimated to come from the "
            "model's fit, with an interval that reaches below half: more pairs may not help there."
        )
    return [Note(Rank.OVER_MODEL, text) for text in texts]


def _excludes_0(interval: Interval) -> bool:
    low, high = interval.low, interval.high
    return low is not None and high is not None and not low <= 0 <= high


_SHOWN = ("time_ratio", "time_ratio_worst", "mu", "delay_s", "kappa", "kappa_all")
"""Findings of each cell on the terminal; the page also has the findings of ``_ON_PAGE``."""

_ON_PAGE = ("mu_worst", "delay_worst_s", "timed_out_av", "defined_pairs")


def _cell_table(result: GroupResult, name: str, caption: str) -> Table:
    thresholds = result.group.cells[0].cell.scenario.conflicts.model_dump()
    rows = []
    for cell, summary in zip(result.group.cells, result.summaries, strict=True):
        findings = summary.findings
        shown, on_page = (
            [entry_cell(ENTRIES[of], findings, of) for of in names] for names in (_SHOWN, _ON_PAGE)
        )
        rows.append(
            (
                count_cell(cell.number),
                TableCell(av_label(cell.label, findings)),
                count_cell(findings["pairs"].count),
                *shown,
                *on_page,
            )
        )
    headings = [
        [ENTRIES[of].title_of(of, thresholds) for of in names] for names in (_SHOWN, _ON_PAGE)
    ]
    front = ("cell", "AV", "pairs", *headings[0])
    return Table(
        name,
        f"{caption}: strategies",
        (*front, *headings[1]),
        tuple(rows),
        sortable=True,
        terminal=tuple(range(len(front))),
    )


def _difference_table(result: GroupResult, name: str, caption: str) -> Table:
    numbers = [cell.number for cell in result.group.cells]
    entries = [entry for entry in DIFFERENCES if entry.first_screen]
    rows = []
    for item in result.comparisons:
        differences = [
            interval_cell(
                getattr(item, entry.key), entry.digits, " *" * (entry.key in item.indicative)
            )
            for entry in entries
        ]
        differences += [
            interval_cell(item.over_model[entry.key], entry.digits)
            for entry in entries
            if item.over_model
        ]
        rows.append(
            (
                count_cell(numbers[item.a]),
                count_cell(numbers[item.b]),
                count_cell(item.counted_in_both),
                *differences,
                _p_cell(item.time_ratio_p_holm),
                TableCell(f"{item.crashes.only_a} / {item.crashes.only_b}"),
                _p_cell(item.p_holm),
                TableCell(f"{item.misses.only_a} / {item.misses.only_b}"),
                _p_cell(item.misses_p_holm),
                _p_cell(item.crashes.p),
                count_cell(item.defined_in_both),
            )
        )
    names = [entry_heading(entry, {}) for entry in entries]
    names += [f"{of}, {MODEL_HEADING}" for of in names if result.comparisons[0].over_model]
    front = (
        "A", "B", "pairs", *names, "times, p (Holm)",
        "crashed in A / B alone", "p (Holm)", "missed in A / B alone", "missed, p (Holm)",
    )  # fmt: skip
    words = f"{caption}: differences A − B over the common pairs (negative: A takes less time)"
    headings = (*front, "crashed, p", "pairs in μ")
    shown = tuple(range(len(front)))
    return Table(name, words, headings, tuple(rows), sortable=True, terminal=shown)


def _sweep_table(result: SweepResult, group: GroupResult, name: str) -> Table:
    sweep, allowed = result.sweep, result.limits
    fixed = "".join(f", {name} = {as_written(value)}" for name, value in sweep.fixed.items())
    bold, few = sweep.aggressiveness, " (unreliable: too few informative pairs)"
    rows = []
    for position, judgement in enumerate(result.found.judgements):
        needed, cell = judgement.pairs_needed, sweep.cells[position]
        summary = group.summaries[cell]
        rows.append(
            (
                value_cell(sweep.values[position]),
                *([value_cell(bold[position])] if bold else []),
                count_cell(group.group.cells[cell].number),
                count_cell(judgement.swept.pairs),
                interval_cell(judgement.swept.mu, 4, "*" * judgement.swept.unreliable),
                interval_cell(summary.mu_worst, 4),
                share_cell(judgement.swept.kappa),
                count_cell(summary.failed_engine),
                TableCell(judgement.verdict.value + few * judgement.unreliable),
                TableCell("") if needed is None else count_cell(needed),
            )
        )
    headings = (
        sweep.parameter,
        *(["aggressiveness"] if bold else []),
        *("cell", "pairs", "μ, bounds", "μ, worst case", "κ, bounds", "engine failed"),
        *("verdict", "pairs needed"),
    )
    caption = f"allowed values of {sweep.key}{fixed}: μ < {allowed.mu0:g}, κ < {allowed.kappa0:g}"
    caption += f", by bounds of all {len(sweep.values)} values together"
    caption += (
        " (μ: a human who crashed counts as if they had driven on; κ: time-outs and failures "
    )
    caption += "of the strategy count as crashes)"
    return Table(name, caption, headings, tuple(rows))


def _p_cell(p: float) -> TableCell:
    return TableCell(f"{p:.2g}", sort=repr(p))


def cell_numbers(positions: Sequence[int], result: GroupResult, most: int) -> str:
    """Return the numbers of the first few of these cells."""
    more = f" and {len(positions) - most} more" if len(positions) > most else ""
    return ", ".join(str(result.group.cells[at].number) for at in positions[:most]) + more
