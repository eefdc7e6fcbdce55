"""Ctrl-C and SIGTERM end a command at any time with one line and no half-written file.

During start-up they end the process at once, because a half-imported module could catch an
exception.  Once work that needs clearing up has begun, they raise KeyboardInterrupt.
"""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from harness.core.errors import HarnessError, InterruptedRunError

LINE = "harness: interrupted"


class BrokenOffError(HarnessError):
    """A command was interrupted; the message says how to continue."""


_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_SAME_S = 1.0
"""A second signal within this time is ignored as a repetition; a later one ends the process."""

_first: tuple[int, float] | None = None
"""The signal that raised KeyboardInterrupt, and its time."""


def leave_at_once() -> None:
    """Let an interruption end the process at once from now on."""
    for number in _handled_signals():
        signal.signal(number, _leave)


@contextmanager
def unwinding() -> Iterator[None]:
    """Let an interruption inside raise KeyboardInterrupt once.

    Raises:
        BrokenOffError: the interrupted run can be resumed; the message says how.
    """
    before = {number: signal.signal(number, _unwind) for number in _handled_signals()}
    try:
        yield
    except InterruptedRunError as error:
        # typer would drop the message of a KeyboardInterrupt.
        raise BrokenOffError(str(error)) from None
    finally:
        # A second signal must not interrupt the clearing up after the first.
        if _first is None:
            for number, handler in before.items():
                signal.signal(number, handler)


def exit_code() -> int:
    """Return the exit code of an interrupted process: 128 + the number of the signal."""
    return 128 + (signal.SIGINT if _first is None else _first[0])


def _handled_signals() -> list[signal.Signals]:
    """Return the signals that are not ignored; a shell's background job ignores Ctrl-C."""
    return [number for number in _SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]


def _leave(number: int, _frame: FrameType | None) -> None:
    # sys.stderr may be in the middle of writing a line when the signal arrives.
    os.write(2, f"{LINE}\n".encode())
    os._exit(128 + number)


def _unwind(number: int, frame: FrameType | None) -> None:
    global _first
    now_s = time.monotonic()
    if _first is None:
        _first = (number, now_s)
        raise KeyboardInterrupt
    if now_s - _first[1] > _SAME_S:
        _leave(number, frame)
