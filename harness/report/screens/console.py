"""The console of everything on the terminal, and how it shows a table."""

import sys

from rich import box
from rich.console import Console
from rich.table import Table as RichTable

from harness.report.screens.tables import Table, TableCell

PIPE_COLUMNS = 120


def make_console() -> Console:
    """Stdout; wide enough for the tables where it is a pipe."""
    # Rich takes 80 columns for a pipe, where nothing limits the width.
    # Texts come from files: no brackets or colons in them are instructions.
    return Console(
        highlight=False,
        markup=False,
        emoji=False,
        width=None if sys.stdout.isatty() else PIPE_COLUMNS,
    )


def print_table(console: Console, table: Table) -> None:
    """Print a table; long words are folded, never cut."""
    shown = range(len(table.headings)) if table.terminal is None else table.terminal
    longest = [max(len(word) for word in f"{table.headings[of]} ".split(" ")) for of in shown]
    fits = sum(longest) + len(longest) < console.width
    printed = RichTable(title=table.caption, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for position, word in zip(shown, longest, strict=True):
        # The first column says what a row is about: its names stay whole on a narrow terminal.
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
    """A cell's text, and its small text on a line of its own."""
    return cell.text if brief or not cell.small else f"{cell.text}\n{cell.small}"
