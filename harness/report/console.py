"""What all tables on the terminal share: the console, and how numbers are written."""

import sys
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from harness.comparison import Interval

PIPE_COLUMNS = 120


def make_console() -> Console:
    """Stdout; wide enough for the tables where it is a pipe."""
    # Rich takes 80 columns for a pipe, where nothing limits the width.
    # What is printed comes from files: no brackets or colons in it are instructions.
    return Console(
        highlight=False,
        markup=False,
        emoji=False,
        width=None if sys.stdout.isatty() else PIPE_COLUMNS,
    )


def table_of_columns(title: str, *headings: str) -> Table:
    """An empty table; long words are folded, never cut."""
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in headings:
        table.add_column(heading, overflow="fold")
    return table


def number(value: float | None, digits: int) -> str:
    """With so many decimals."""
    return "undefined" if value is None else f"{value:z.{digits}f}"


def with_range(interval: Interval, digits: int) -> str:
    """Value and limits, ``0.7044 [0.6912, 0.7177]``."""
    text = number(interval.value, digits)
    if interval.low is None or interval.high is None:
        return text
    return f"{text} [{interval.low:z.{digits}f}, {interval.high:z.{digits}f}]"


def plain(value: Any) -> str:
    """A scenario's value as a user would write it."""
    return f"{value:g}" if isinstance(value, float) else str(value)
