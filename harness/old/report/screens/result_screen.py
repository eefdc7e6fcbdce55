"""The first screen of a run, a view of its findings."""

import shlex
from collections.abc import Sequence
from typing import Any

from harness.old.report.screens.joined_notes import joined_notes
from harness.old.report.screens.result_texts import (
    both_arms,
    no_spread,
    tested,
    with_limits,
    zero_lines,
)
from harness.old.report.screens.screen import Screen
from harness.old.report.screens.tables import (
    counted,
    entry_heading,
    entry_value,
    level,
    named_values,
)
from harness.old.statistics import CONFIDENCE
from harness.old.statistics.entries import Entry, Finding, Form
from harness.old.statistics.findings import CellFindings, RunFindings
from harness.old.studies.runs.notes import short_name
from harness.scenario import as_written

MOST_CELLS = 2_000
"""Maximum number of a sweep's cells on a screen; the run folder's files have all cells."""


def screen_of(run: RunFindings) -> Screen:
    """Return the first screen: one cell row by row, or a sweep with a row for each cell."""
    footer = f"All measures: --full. Page: harness report {shlex.quote(str(run.folder))}"
    if len(run.cells) == 1 and not run.cells[0].varied:
        return _one_cell(run, run.cells[0], footer)
    return _sweep(run, footer)


def _one_cell(run: RunFindings, cell: CellFindings, footer: str) -> Screen:
    rows = [
        _entry_row(entry, cell)
        for entry in run.catalogue
        if entry.first_screen and _has_something(entry, cell)
    ]
    headings = ("", "AV", cell.reference, "AV against reference")
    if run.between_avs:
        headings = ("", cell.av, cell.reference, "difference")
    return Screen(
        title=f"{run.name}: {cell.av} against {cell.reference}",
        scope=f"{counted(cell.pairs, 'pair')}, {run.scope}{_level(cell)}",
        headings=headings,
        rows=tuple(rows),
        notes=tuple(sorted((*run.notes, *cell.notes), key=lambda note: note.rank)),
        footer=footer,
        site=run.site,
        aside=True,
    )


def _entry_row(entry: Entry[Any], cell: CellFindings) -> tuple[str, ...]:
    av, reference, both = (None if name is None else cell.findings[name] for name in entry.names)
    return (
        entry_heading(entry, cell.thresholds),
        entry_value(entry, av),
        entry_value(entry, reference),
        both_arms(entry, av, reference, cell)
        if both is None
        else f"{with_limits(entry, both)}{no_spread(entry, both, cell)}",
    )


def _level(cell: CellFindings) -> str:
    """Return the level of the intervals if it is not the usual one, as in a comparison of AVs."""
    confidence = cell.findings["confidence"].number or CONFIDENCE
    return "" if confidence == CONFIDENCE else f", {level(confidence)} intervals"


def _has_something(entry: Entry[Any], cell: CellFindings) -> bool:
    """Return whether the entry has a defined number, or a note with the reason why it has none."""
    names = [] if entry.may_be_absent else [name for name in entry.names if name is not None]
    return _has_number(entry, cell) or any(cell.findings[name].reason for name in names)


def _has_number(entry: Entry[Any], cell: CellFindings) -> bool:
    return any(cell.findings[name].value is not None for name in entry.names if name is not None)


def _sweep(run: RunFindings, footer: str) -> Screen:
    shown = run.cells[:MOST_CELLS]
    # If the threshold in a heading differs between cells, only the cells' tables have the entry.
    entries = [
        entry
        for entry in run.catalogue
        if entry.first_screen
        and len({entry.title(cell.thresholds) for cell in shown}) == 1
        and any(_has_something(entry, cell) for cell in shown)
    ]
    # A column without numbers is left out to make room; a note names it.
    entries = [
        entry
        for place, entry in enumerate(entries)
        if place == 0 or any(_has_number(entry, cell) for cell in shown)
    ]
    # Columns that do not fit are left out from the right, except crashes.
    rest = sorted(entries[1:], key=lambda entry: not entry.crashes)
    entries = [*entries[:1], *rest]
    labels, pairs = cell_labels(shown), [f"{cell.pairs:,}" for cell in shown]
    scope = f"{run.scope}{_level(shown[0])}"
    if len({*pairs}) == 1:
        scope = f"{counted(shown[0].pairs, 'pair')} each, {scope}"
    else:
        labels["pairs"] = pairs
        scope = f"{counted(sum(cell.pairs for cell in shown), 'pair')}, {scope}"
    headings, columns = [*labels], [*labels.values()]
    always = len(headings) + 1 + sum(entry.crashes for entry in rest)
    for place, entry in enumerate(entries):
        both = entry.names[2] if entry.names[2] and (place == 0 or not entry.names[0]) else None
        name = entry_heading(entry, shown[0].thresholds)
        if both is not None:
            name = (
                entry.title_of(both, shown[0].thresholds) if entry.names[0] else short_name(entry)
            )
        if entry.form is Form.EVENTS:
            name += _trials(entry, shown)
        headings.append(name)
        columns.append([_sweep_text(entry, cell, both, limits=place == 0) for cell in shown])
    zeros = [
        line
        for entry in entries
        if entry.crashes
        for line in zero_lines(
            entry,
            [
                (finding, cell.findings["confidence"].number or CONFIDENCE)
                for cell in filter(tested, shown)
                for finding in _arms_of(entry, [cell])
            ],
        )
    ]
    total, some = len(run.cells), len(shown)
    avs, references = ({getattr(cell, arm) for cell in shown} for arm in ("av", "reference"))
    first = f", the first {some:,} here" if some < total else ""
    arms = f"{_one(avs, 'AV')} / {_one(references, 'reference')}"
    return Screen(
        title=f"{run.name}: {total:,} cells{first}; values: {arms}",
        scope=scope,
        headings=tuple(headings),
        rows=tuple(zip(*columns, strict=True)),
        notes=tuple(
            sorted(
                (*run.notes, *joined_notes([(cell.cell, cell.notes) for cell in shown])),
                key=lambda note: note.rank,
            )
        ),
        footer=footer,
        site=run.site,
        conclusions=tuple(zeros),
        always=always,
        most_lines=None,
    )


def _one(names: set[str], several: str) -> str:
    """Return the name of the driver in all cells, or a word for several drivers."""
    return next(iter(names)) if len(names) == 1 else several


def cell_labels(cells: Sequence[CellFindings]) -> dict[str, list[str]]:
    """Return what distinguishes cells, by heading: number, varied keys, and fallback driver."""
    keys = list(cells[0].varied)
    words = [key.split(".")[-1] for key in keys]
    headings = words if len({*words}) == len(words) else keys
    labels = {"cell": [str(cell.cell) for cell in cells]}
    for key, heading in zip(keys, headings, strict=True):
        # The AV's label names the fallback strategy.
        labels[heading] = [
            cell.av if key == "arms.av" else as_written(cell.varied[key]) for cell in cells
        ]
    drivers = [cell.av for cell in cells]
    if "arms.av" not in keys and len({*drivers}) > 1:
        labels["AV drove"] = drivers
    return labels


def _sweep_text(entry: Entry[Any], cell: CellFindings, both: str | None, limits: bool) -> str:
    """Return the number of both arms, or of each arm; intervals are added on request."""
    if both is not None and limits:
        return with_limits(entry, cell.findings[both])
    if both is not None:
        return entry_value(entry, cell.findings[both])
    arms = [entry_value(entry, cell.findings[name]) for name in entry.names[:2] if name is not None]
    texts = [text.split(" of ")[0] for text in arms]
    if all(text.endswith(" %") for text in texts):
        texts[0] = texts[0].removesuffix(" %")
    return " / ".join(texts)


def _trials(entry: Entry[Any], cells: Sequence[CellFindings]) -> str:
    """Return the trials of a column of events (" of 50"), or their range over cells and arms."""
    trials = {finding.n or 0 for finding in _arms_of(entry, cells)}
    return f" of {' … '.join(dict.fromkeys(f'{n:,}' for n in (min(trials), max(trials))))}"


def _arms_of(entry: Entry[Any], cells: Sequence[CellFindings]) -> list[Finding]:
    names = [name for name in entry.names[:2] if name is not None]
    return [cell.findings[name] for cell in cells for name in names]


def cell_name(cell: CellFindings) -> str:
    """Return the number and keys of a sweep's cell; empty for a run of one cell."""
    return f"cell {cell.cell}: {named_values(cell.varied)}" if cell.varied else ""
