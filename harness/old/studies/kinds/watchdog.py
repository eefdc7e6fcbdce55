"""Ends a worker that makes no progress, and returns its Python stack."""

import faulthandler
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import IO


class Watch:
    """The progress that the watchdog observes."""

    def __init__(self) -> None:
        self.finished = 0

    def alive(self) -> None:
        """Note progress."""
        self.finished += 1


@contextmanager
def watchdog(hang_after_s: float, stack_file: Path | None) -> Iterator[Watch]:
    """End the process if nothing is finished for too long, even if C code hangs.

    A thread checks for progress ten times within the limit and then restarts faulthandler's timer.
    This timer needs no interpreter lock.  If it runs out, it writes the Python stack and exits the
    process, and the parent sees a dead worker.

    Args:
        hang_after_s: limit for one episode or hour; infinite means no watchdog.
        stack_file: file for the stack.  If it is None or cannot be opened, the stack is lost.
    """
    if math.isinf(hang_after_s):
        yield Watch()
        return
    pause_s = hang_after_s / 10
    over = Event()
    with _open_for_writing(stack_file) as file:
        watch = Watch()

        def look() -> None:
            last_progress = None
            while True:
                if watch.finished != last_progress:
                    last_progress = watch.finished
                    faulthandler.dump_traceback_later(hang_after_s + pause_s, exit=True, file=file)
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


def stack_in(stack_file: Path | None) -> str | None:
    """Return the content of a stack file; None if the watchdog did not end the worker."""
    if stack_file is None or not stack_file.is_file():
        return None
    return stack_file.read_text(encoding="utf-8", errors="replace") or None
