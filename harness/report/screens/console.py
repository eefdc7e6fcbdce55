"""The console for all terminal output, and the printing of tables."""

import os
import sys

from rich import box
from rich.console import Console
from rich.table import Table as RichTable

from harness.report.screens.tables import Table, TableCell

PIPE_COLUMNS = 120


def make_console() -> Console:
    """Return the console of standard output.

    A pipe is as wide as the variable COLUMNS says, otherwise wide enough for all tables.
    """
    columns = os.environ.get("COLUMNS", "")
    pipe = int(columns) if columns.isdecimal() and int(columns) else PIPE_COLUMNS
    # Rich assumes 80 columns for a pipe, although a pipe has no width.
    # Texts come from files, so their brackets and colons are not markup.
    return Console(
        highlight=False,
        markup=False,
        emoji=False,
        width=None if sys.stdout.isatty() else pipe,
    )


def print_table(console: Console, table: Table) -> None:
    """Print a table.  Long words are wrapped and never cut."""
    shown = range(len(table.headings)) if table.terminal is None else table.terminal
    longest = [max(len(word) for word in f"{table.headings[of]} ".split(" ")) for of in shown]
    fits = sum(longest) + len(longest) < console.width
    printed = RichTable(title=table.caption, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for position, word in zip(shown, longest, strict=True):
        # The first column names the rows, so its names stay whole on a narrow terminal.
        printed.add_column(
            table.headings[position],
            overflow="fold",
            no_wrap=position == 0,
            min_width=word if fits else None,
        )
    for row in table.rows:
        printed.add_row(*(_text(row[position], table.brief) for position in shown))
    console.print(printed)


def _text(cell: TableCell, brief: bool) -> str:
    """Return a cell's text, with its small text on a separate line."""
    return cell.text if brief or not cell.small else f"{cell.text}\n{cell.small}"
