"""Writes to the terminal: results on stdout, remarks and a progress bar on stderr."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any


def emit(
    quiet: bool,
    as_json: bool,
    document: Any,
    lines: Iterable[object],
    show: Callable[[], None] | None = None,
) -> None:
    """Print the result of a command in the format that the user chose.

    Args:
        quiet, as_json: whether the options were given; ``--json`` takes precedence.
        document: output of ``--json``, or a function that returns it.
        lines: output of ``--quiet``, one line each: paths or names.
        show: prints the default output; None: the default output is ``lines``.
    """
    if as_json:
        print_json(document() if callable(document) else document)
    elif quiet or show is None:
        for line in lines:
            print_line(str(line))
    else:
        show()


def print_line(text: str) -> None:
    """Print a line of a result on stdout."""
    sys.stdout.write(text + "\n")


def print_wrapped(text: str, indent: str = "") -> None:
    """Print a line of a result, wrapped on a terminal; a pipe gets the whole line."""
    if not sys.stdout.isatty():
        print_line(indent + text)
        return
    from harness.old.report.screens.console import make_console
    from harness.old.report.screens.screen import wrapped

    for line in wrapped(indent + text, make_console().width, f"{indent}  "):
        print_line(line)


def print_json(document: Any) -> None:
    """Print a result as JSON on stdout."""
    print_line(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False))


def say(text: str) -> None:
    """Print a remark on stderr."""
    sys.stderr.write(text + "\n")


@contextmanager
def progress_bar(unit: str, hidden: bool) -> Iterator[Callable[..., None]]:
    """Draw a progress bar on stderr unless it is hidden; ``unit`` names the counted things.

    Yields:
        A function that takes the number done, the number planned and, if it changes, the unit.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = BarColumn(), MofNCompleteColumn(), "{task.fields[rate]}", TimeRemainingColumn()
    console = Console(stderr=True)
    bar = Progress("{task.description}", *columns, console=console, disable=hidden)
    task = bar.add_task(unit, rate="")

    def advance(done: int, planned: int, counted: str = unit) -> None:
        # The bar starts with the first progress, so that a refusal prints one line only.
        if not hidden:
            bar.start()
        if counted.partition(",")[0] != bar.tasks[0].description.partition(",")[0]:
            bar.reset(task, description=counted, rate="")
        speed = bar.tasks[0].speed
        rate = f"{speed:.0f}/s" if speed is not None else ""
        bar.update(task, description=counted, completed=done, total=planned, rate=rate)

    try:
        yield advance
    finally:
        if bar.live.is_started:
            bar.stop()
