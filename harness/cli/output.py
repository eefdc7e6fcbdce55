"""Writes to the terminal: results on stdout, words and a progress bar on stderr."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


def print_line(text: str) -> None:
    """A result, on stdout."""
    sys.stdout.write(text + "\n")


def print_json(document: Any) -> None:
    """Results as JSON, on stdout."""
    print_line(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False))


def say(text: str) -> None:
    """Anything that is no result, on stderr."""
    sys.stderr.write(text + "\n")


def say_traceback(traceback: str | None) -> None:
    """The traceback of a strategy that raised, if one did, on stderr."""
    if traceback is not None:
        say(traceback.rstrip())


@contextmanager
def progress_bar(what: str, hidden: bool) -> Iterator[Callable[..., None]]:
    """A bar on stderr that takes (done, planned) and, where it changes, of what."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        disable=hidden,
    )
    task = bar.add_task(what, rate="")

    def advance(done: int, planned: int, of: str = what) -> None:
        # Shown once there is something to show: a refusal is one line and no bar.
        if not hidden:
            bar.start()
        before = bar.tasks[0].description
        if of.partition(",")[0] != before.partition(",")[0]:
            bar.reset(task, description=of, rate="")
        speed = bar.tasks[0].speed
        bar.update(
            task,
            description=of,
            completed=done,
            total=planned,
            rate=f"{speed:.0f}/s" if speed is not None else "",
        )

    try:
        yield advance
    finally:
        if bar.live.is_started:
            bar.stop()
