"""Ends a worker that makes no progress, and reports afterwards what it was doing."""

import faulthandler
import math
import os
from collections.abc import Iterator, Sized
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from threading import Event, Thread
from typing import IO, NamedTuple

from harness.core.encounter import Arm
from harness.episode.loop import Episode

_HEAD = 64
"""Bytes at the beginning of a stack file: the episode that was begun last."""


class Watch:
    """What the watchdog looks at; being looked at costs an episode next to nothing.

    Args:
        file: where the episode that is under way is noted.
    """

    def __init__(self, file: IO[str]) -> None:
        self._file = file
        self.finished = 0
        self.states: Sized = ()
        """One more whenever a strategy has answered; empty between two episodes."""

    def alive(self) -> None:
        """Something is finished, and no strategy is asked for the moment."""
        self.finished += 1
        self.states = ()

    def begins(self, pair: int, arm: Arm, episode: Episode) -> None:
        """From here on the strategy of this episode is asked."""
        os.pwrite(self._file.fileno(), f"{pair} {arm.value}".ljust(_HEAD).encode(), 0)
        self.finished += 1
        self.states = episode.x_m


@contextmanager
def watchdog(
    hang_after_s: float, stack_file: Path | None, decide_limit_s: float = math.inf
) -> Iterator[Watch]:
    """Ends the process when nothing is finished for too long, hung C code included.

    A thread of this process looks ten times within the limit whether anything went on, and winds
    up faulthandler's watchdog if so.  That one needs no interpreter lock: it writes the Python
    stack and exits the process, which the parent then sees as a dead worker.

    Args:
        hang_after_s: how long one thing may take; infinite: there is no watchdog.
        stack_file: for the stack; None, or a path that cannot be opened, drops it.
        decide_limit_s: how long one answer of a strategy may take.
    """
    if math.isinf(hang_after_s):
        with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
            yield Watch(nowhere)
        return
    pause_s = min(hang_after_s, decide_limit_s) / 10
    over = Event()
    with _open_for_writing(stack_file) as file:
        os.lseek(file.fileno(), _HEAD, os.SEEK_SET)
        watch = Watch(file)

        def look() -> None:
            seen = None
            while True:
                now = (watch.finished, len(watch.states))
                if now != seen:
                    limit_s = min(hang_after_s, decide_limit_s) if now[1] else hang_after_s
                    faulthandler.dump_traceback_later(limit_s + pause_s, exit=True, file=file)
                    seen = now
                if over.wait(pause_s):
                    return

        looking = Thread(target=look, daemon=True)
        looking.start()
        try:
            yield watch
        finally:
            over.set()
            looking.join()
            faulthandler.cancel_dump_traceback_later()
    if stack_file:
        stack_file.unlink(missing_ok=True)


def _open_for_writing(path: Path | None) -> IO[str]:
    """The file, or nowhere: a worker on another machine may not see the run folder."""
    try:
        return (path or Path(os.devnull)).open("w", encoding="utf-8")
    except OSError:
        return Path(os.devnull).open("w", encoding="utf-8")


class Hang(NamedTuple):
    """The work of a worker when its watchdog ended it."""

    episode: tuple[int, Arm] | None
    in_decide: bool
    stack: str


def hang_of(stack_file: Path | None) -> Hang | None:
    """The content of a stack file; None without one, or where the worker died of something else."""
    if stack_file is None or not stack_file.is_file():
        return None
    episode = begun_in(stack_file)
    stack = stack_file.read_text(encoding="utf-8", errors="replace")[_HEAD:]
    if not stack:
        return None
    # The innermost call comes first: whatever `_drive` called last, unless it was the simulation.
    calls = pairwise(stack.splitlines())
    in_decide = any(
        outer.endswith(" in _drive") and "episode/loop.py" not in inner for inner, outer in calls
    )
    return Hang(episode, in_decide, stack)


def begun_in(stack_file: Path) -> tuple[int, Arm] | None:
    """The episode that was begun last by the worker of this file; None before the first."""
    head = stack_file.read_bytes()[:_HEAD].strip(b"\0 ").decode()
    if not head:
        return None
    pair, arm = head.split()
    return int(pair), Arm(arm)
