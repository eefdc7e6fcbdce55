"""Writes to the terminal: results on stdout, remarks and a progress bar on stderr."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.results.result import Result


def show(
    result: "Result",
    full: bool,
    quiet: bool,
    as_json: bool,
    lines: Iterable[object] = (),
    out: Any = None,
) -> None:
    """Print a result: its screen, its JSON, or with ``quiet`` the given lines.

    With ``out`` its records are written to that new CSV file first.
    """
    if out is not None:
        from harness.core.files import write_csv
        from harness.results.result import flat

        write_csv(out, [flat(record) for record in result.records])
    if as_json:
        print_json(result.to_dict())
    elif quiet:
        for line in lines:
            print_line(str(line))
    else:
        from harness.report.screen import print_result

        print_result(result, full)


def emit(
    quiet: bool,
    as_json: bool,
    document: Any,
    lines: Iterable[object],
    screen: Callable[[], None] | None = None,
) -> None:
    """Print what a command did: as JSON, as short ``lines`` with ``quiet``, or by ``screen``."""
    if as_json:
        print_json(document)
    elif quiet or screen is None:
        for line in lines:
            print_line(str(line))
    else:
        screen()


def print_line(text: str) -> None:
    """Print a line of a result on stdout."""
    sys.stdout.write(text + "\n")


def print_json(document: Any) -> None:
    """Print a result as JSON on stdout."""
    print_line(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False))


def say(text: str) -> None:
    """Print a remark on stderr."""
    sys.stderr.write(text + "\n")


@contextmanager
def progress_bar(hidden: bool) -> Iterator[Callable[..., None]]:
    """Draw a progress bar of pairs on stderr unless it is hidden.

    Yields:
        A function that takes the number done, the number planned, and what is waited for, if
        anything.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = BarColumn(), MofNCompleteColumn(), "{task.fields[rate]}", TimeRemainingColumn()
    bar = Progress("{task.description}", *columns, console=Console(stderr=True), disable=hidden)
    task = bar.add_task("pairs", rate="")

    def advance(done: int, planned: int, waits_for: str = "") -> None:
        # The bar starts with the first progress, so that a refusal prints one line only.
        if not hidden:
            bar.start()
        speed = bar.tasks[0].speed
        words = f"pairs, waiting for {waits_for}" if waits_for else "pairs"
        rate = f"{speed:.0f}/s" if speed is not None else ""
        bar.update(task, description=words, completed=done, total=planned, rate=rate)

    try:
        yield advance
    finally:
        if bar.live.is_started:
            bar.stop()
