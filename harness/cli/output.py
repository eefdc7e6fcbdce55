"""Writes to the terminal: results on stdout, remarks and a progress bar on stderr."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from typer import Exit

from harness.core.errors import in_shell, one_line

if TYPE_CHECKING:
    from harness.results.result import Result


Lines = Iterable[object]
Rows = Sequence[Mapping[str, Any]]


def show(
    result: "Result", lines: Lines = (), *, as_json: bool, full: bool = False, quiet: bool = False
) -> None:
    """Print a result: its screen, its JSON, or with ``quiet`` the given lines.

    Raises:
        Exit: with code 1, if an episode or a simulation failed.
    """
    if as_json:
        print_line(json.dumps(result.to_dict(), indent=1, ensure_ascii=False, allow_nan=False))
    elif quiet:
        for line in lines:
            print_line(str(line))
    else:
        from harness.report.screen import print_result

        print_result(result, full)
    if failed := result.facts.get("failed"):
        first = result.facts.get("failure", "see log.jsonl")
        say(one_line(f"harness: failed arms: {failed:,}; the first: {first}"))
        raise Exit(1)


def show_rows(command: str, rows: Rows, *, as_json: bool, quiet: bool = False, **said: Any) -> None:
    """Print rows of text, whose first column stands for a row with ``quiet``.

    ``said`` is what the result has besides: ``title``, ``closing``, ``headings``.
    """
    from harness.results.result import listed

    first = dict.fromkeys(str(next(iter(row.values()))) for row in rows)
    show(listed(command, rows, **said), first, quiet=quiet, as_json=as_json)


def print_line(text: str) -> None:
    """Print a line of a result on stdout."""
    sys.stdout.write(text + "\n")


def say(text: str) -> None:
    """Print a remark on stderr, with commands in place of calls."""
    sys.stderr.write(in_shell(text) + "\n")


@contextmanager
def progress_bar(hidden: bool, what: str = "pairs") -> Iterator[Callable[..., None]]:
    """Draw a progress bar on stderr unless it is hidden.

    Yields:
        A function that takes the finished and planned numbers.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    bar = Progress("{task.description}", *columns, console=Console(stderr=True), disable=hidden)
    task = bar.add_task(what)

    def advance(done: int, planned: int, *_: object) -> None:
        if hidden:
            return
        bar.update(task, completed=done, total=planned)
        bar.start()  # not before: a refusal prints one line only

    try:
        yield advance
    finally:
        if bar.live.is_started:
            bar.stop()
