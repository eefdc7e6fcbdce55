"""The console for all terminal output, and the printing of tables."""

import os
import sys
from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.table import Table as RichTable

from harness.old.report.screens.tables import Table, TableCell

PIPE_COLUMNS = 120

_BEFORE_NAMES = 24
"""The other columns shrink to this width before the names of the rows are wrapped."""


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
    """Print a table.  A word is broken only if the words of all columns do not fit."""
    shown = range(len(table.headings)) if table.terminal is None else table.terminal
    printed = RichTable(title=table.caption, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    cells = [
        [table.headings[of], *(_text(row[of], table.brief) for row in table.rows)] for of in shown
    ]
    # The table has a margin of one column, and each column is followed by two.
    widths = _widths(cells, console.width - 1 - 2 * len(cells))
    for (heading, *_), width in zip(cells, widths, strict=True):
        printed.add_column(heading, overflow="fold", width=width)
    for row in zip(*(column[1:] for column in cells), strict=True):
        printed.add_row(*row)
    console.print(printed)


def _widths(columns: Sequence[Sequence[str]], room: int) -> list[int]:
    """Return widths that fit: the first column, which names the rows, is shortened late."""
    lines = [[line for text in texts for line in text.split("\n")] for texts in columns]
    words = [max(len(word) for line in of for word in line.split(" ")) for of in lines]
    headings = [max(map(len, of[0].split(" "))) for of in lines]
    # A heading is wrapped before its column's texts are.
    widths = [max([words[place], *map(len, of[1:])]) for place, of in enumerate(lines)]
    spare = max(0, room - sum(widths))
    for place, of in enumerate(lines):
        more = min(spare, max(0, len(of[0]) - widths[place]))
        widths[place], spare = widths[place] + more, spare - more
    whole_names = [widths[0], *(max(word, _BEFORE_NAMES) for word in words[1:])]
    for least in (whole_names, words, headings, [1] * len(widths)):
        while sum(widths) > room:
            wide = [place for place, width in enumerate(widths) if width > least[place]]
            if not wide:
                break
            widths[max(wide, key=widths.__getitem__)] -= 1
    return widths


def _text(cell: TableCell, brief: bool) -> str:
    """Return a cell's text, with its small text on a separate line."""
    return cell.text if brief or not cell.small else f"{cell.text}\n{cell.small}"
