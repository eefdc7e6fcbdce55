"""Ctrl-C and SIGTERM end a command at any time with one line and no half-written file.

During start-up they end the process at once, because a half-imported module could catch an
exception.  Once work that needs clearing up has begun, the first one raises KeyboardInterrupt.
"""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from harness.core.errors import HarnessError, InterruptedRunError

LINE = "harness: interrupted"

_SIGNALS = [
    number
    for number in (signal.SIGINT, signal.SIGTERM)
    if signal.getsignal(number) is not signal.SIG_IGN  # a shell's background job ignores Ctrl-C
]

_came: list[int] = []
"""The signal that raised KeyboardInterrupt."""


class BrokenOffError(HarnessError):
    """A command was interrupted; the message says how to continue."""


def leave_at_once() -> None:
    """Let an interruption end the process at once from now on."""
    for number in _SIGNALS:
        signal.signal(number, _leave)


@contextmanager
def unwinding() -> Iterator[None]:
    """Let an interruption inside raise KeyboardInterrupt; further ones are ignored.

    Raises:
        BrokenOffError: the interrupted run can be resumed; the message says how.
    """
    for number in _SIGNALS:
        signal.signal(number, _unwind)
    try:
        yield
    except InterruptedRunError as error:
        # typer would drop the message of a KeyboardInterrupt.
        raise BrokenOffError(str(error)) from None
    finally:
        if not _came:
            leave_at_once()


def exit_code() -> int:
    """The exit code of an interrupted process: 128 + the number of the signal."""
    return 128 + (_came[0] if _came else signal.SIGINT)


def _leave(number: int, _frame: FrameType | None) -> None:
    # sys.stderr may be in the middle of writing a line when the signal arrives.
    os.write(2, f"{LINE}\n".encode())
    os._exit(128 + number)


def _unwind(number: int, _frame: FrameType | None) -> None:
    if not _came:
        _came.append(number)
        raise KeyboardInterrupt
