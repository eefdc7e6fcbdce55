"""A result in; its screen out: the rows, the worst notes, and where the rest is."""

import os
import sys
from collections.abc import Iterator
from dataclasses import replace

from rich.console import Console, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

from harness.report.layout import TextColumn, blocks_of, bounds_of, drawn
from harness.report.words import printable, text_of
from harness.results.estimators import CONFIDENCE
from harness.results.result import Result, Table

MOST_NOTES = 3
"""Notes on a screen, each with its first sentence; ``--full`` has all, with all their sentences."""

PIPE_COLUMNS = 120


def make_console() -> Console:
    """A console for texts from files, which are no markup.

    A pipe is as wide as the variable COLUMNS says, or else wide enough for most tables.
    """
    columns = os.environ.get("COLUMNS", "")
    pipe = int(columns) if columns.isdecimal() and int(columns) else PIPE_COLUMNS
    width = None if sys.stdout.isatty() else pipe
    return Console(highlight=False, markup=False, emoji=False, width=width)


def print_result(result: Result, full: bool = False, console: Console | None = None) -> None:
    """Print a result.

    Args:
        result: what a command found.
        full: print every table with all intervals, all notes and remarks.
        console: where to print; by default standard output.
    """
    console = console or make_console()
    for part in _parts(result, full, console):
        console.print(part)
    for line in result.closing:
        # A command or path that is longer than a line stays whole, so that it can be copied.
        console.print(Text(printable(line)), soft_wrap=True)


def _parts(result: Result, full: bool, console: Console) -> Iterator[RenderableType]:
    """Yield a screen from above to below."""
    head = " · ".join(printable(part) for part in (result.title, result.scope) if part)
    if head:
        yield Text(head, style="bold")
    if result.about:
        yield Text(printable(result.about))
    confidence = confidence_of(result)
    yield from _table(result.screen, confidence, console, every=False)
    tables = result.full if full else ()
    for table in tables:
        yield Text()
        yield from _table(table, confidence, console, every=True)
    shown = len(result.notes) if full else MOST_NOTES
    yield from (_marked(note.text if full else note.first) for note in result.notes[:shown])
    if more := result.notes[shown:]:
        labels = "; ".join(dict.fromkeys(note.label for note in more))
        yield _marked(f"{len(more)} more with --full: {labels}.")
    yield from (Text(printable(remark)) for remark in (result.remarks if full else ()))


def confidence_of(result: Result) -> float:
    """The confidence of a result's intervals."""
    confidence = result.facts.get("confidence")
    return confidence if isinstance(confidence, float) else CONFIDENCE


def _marked(text: str) -> RichTable:
    """A note behind its mark; its further lines are indented."""
    grid = RichTable.grid(padding=(0, 1, 0, 0))
    grid.add_row(Text("!", style="bold"), Text(printable(text), overflow="fold"))
    return grid


def filled(table: Table) -> Table:
    """A table without the columns that are empty in all its rows."""
    kept = [
        place
        for place in range(len(table.columns))
        if place == 0 or any(text_of(row[place]) for row in table.rows)
    ]
    columns = tuple(table.columns[place] for place in kept)
    rows = tuple(tuple(row[place] for place in kept) for row in table.rows)
    return replace(table, columns=columns, rows=rows)


def below(table: Table, confidence: float) -> list[str]:
    """The lines below a table: what is equal in all rows, and what its cells mean."""
    same = [
        f"{column.heading} {text}"
        for column, cell in table.same
        if (text := text_of(cell, confidence))
    ]
    lines = [f"The same in all rows: {'; '.join(same)}." if same else "", table.legend]
    return [line for line in lines if line]


def _table(
    table: Table, confidence: float, console: Console, every: bool
) -> Iterator[RenderableType]:
    """Yield a table in the richest layout that fits, and the lines below it.

    Args:
        table: the table.
        confidence: the confidence of its intervals.
        console: the console, for its width.
        every: keep all intervals, in a second line of their rows if there is no room.
    """
    table = filled(table)
    if table.title:
        yield Text(printable(table.title), style="bold")
    columns = [
        TextColumn(
            printable(column.heading),
            tuple(row[place] for row in table.rows),
            confidence,
            column.interval,
        )
        for place, column in enumerate(table.columns)
    ]
    blocks = list(blocks_of(columns, every, console.width))
    yield from (drawn(*block) for block in blocks)
    yield from (Text(printable(line)) for line in [*bounds_of(blocks), *below(table, confidence)])
