"""Ends a worker that makes no progress, and returns its last episode and Python stack."""

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
"""Size in bytes of a stack file's head, which names the latest episode."""


class Watch:
    """The progress that the watchdog observes; it costs an episode almost no time.

    Args:
        file: the stack file, which names the current episode.
    """

    def __init__(self, file: IO[str]) -> None:
        self._file = file
        self.finished = 0
        self.states: Sized = ()
        """Grows with every answer of a strategy; empty between two episodes."""

    def alive(self) -> None:
        """Note progress, and that no strategy is being called."""
        self.finished += 1
        self.states = ()

    def begins(self, pair: int, arm: Arm, episode: Episode) -> None:
        """Note that the strategy of this episode is being called."""
        os.pwrite(self._file.fileno(), f"{pair} {arm.value}".ljust(_HEAD).encode(), 0)
        self.finished += 1
        self.states = episode.x_m


@contextmanager
def watchdog(
    hang_after_s: float, stack_file: Path | None, decide_limit_s: float = math.inf
) -> Iterator[Watch]:
    """End the process if nothing is finished for too long, even if C code hangs.

    A thread checks for progress ten times within the limit and then restarts faulthandler's timer.
    This timer needs no interpreter lock.  If it runs out, it writes the Python stack and exits the
    process, and the parent sees a dead worker.

    Args:
        hang_after_s: limit for one episode or hour; infinite means no watchdog.
        stack_file: file for the stack.  If it is None or cannot be opened, the stack is lost.
        decide_limit_s: limit for one answer of a strategy.
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
            last_progress = None
            while True:
                progress = (watch.finished, len(watch.states))
                if progress != last_progress:
                    limit_s = min(hang_after_s, decide_limit_s) if progress[1] else hang_after_s
                    faulthandler.dump_traceback_later(limit_s + pause_s, exit=True, file=file)
                    last_progress = progress
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
    """Open the file, or the null device if the folder is on another machine."""
    try:
        return (path or Path(os.devnull)).open("w", encoding="utf-8")
    except OSError:
        return Path(os.devnull).open("w", encoding="utf-8")


class Hang(NamedTuple):
    """The state of a worker when its watchdog ended it."""

    episode: tuple[int, Arm] | None
    in_decide: bool
    stack: str


def hang_of(stack_file: Path | None) -> Hang | None:
    """Return the content of a stack file; None if the watchdog did not end the worker."""
    if stack_file is None or not stack_file.is_file():
        return None
    episode = begun_in(stack_file)
    stack = stack_file.read_text(encoding="utf-8", errors="replace")[_HEAD:]
    if not stack:
        return None
    # The innermost call is first.  A strategy hangs if `_drive` called something outside the loop.
    calls = pairwise(stack.splitlines())
    in_decide = any(
        outer.endswith(" in _drive") and "episode/loop.py" not in inner for inner, outer in calls
    )
    return Hang(episode, in_decide, stack)


def begun_in(stack_file: Path) -> tuple[int, Arm] | None:
    """Return the latest episode that the worker began; None before the first episode."""
    head = stack_file.read_bytes()[:_HEAD].strip(b"\0 ").decode()
    if not head:
        return None
    pair, arm = head.split()
    return int(pair), Arm(arm)
