"""Ctrl-C and SIGTERM end a command with one line and nothing half-written, whenever they come.

At first they end the process where it stands: an exception in the middle of an import would be
seen by whatever is half imported.  Once something is under way that has to be cleared up they
unwind it, as Python's own KeyboardInterrupt does.
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
    """A command was interrupted, and the message says how to go on."""


_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_SAME_S = 1.0
"""A second signal within this time is the same wish; later, that the first was not heard."""

_first: tuple[int, float] | None = None
"""The signal that is unwinding, and when it came."""


def leave_at_once() -> None:
    """From here on an interruption ends the process where it stands."""
    for number in _heard():
        signal.signal(number, _leave)


@contextmanager
def unwinding() -> Iterator[None]:
    """An interruption inside raises KeyboardInterrupt, once; that of a run says how to go on.

    Raises:
        BrokenOffError: a run was interrupted that can be resumed.
    """
    before = {number: signal.signal(number, _unwind) for number in _heard()}
    try:
        yield
    except InterruptedRunError as error:
        # typer would forget what it says.
        raise BrokenOffError(str(error)) from None
    finally:
        # While one unwinds, a second must not cut its clearing up short.
        if _first is None:
            for number, handler in before.items():
                signal.signal(number, handler)


def exit_code() -> int:
    """The exit code of a process that was interrupted: 128 + the number of the signal."""
    return 128 + (signal.SIGINT if _first is None else _first[0])


def _heard() -> list[signal.Signals]:
    """A shell lets its background jobs ignore Ctrl-C, and ``nohup`` its command's signals."""
    return [number for number in _SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]


def _leave(number: int, _frame: FrameType | None) -> None:
    # Not through sys.stderr, which the signal may have found in the middle of a line.
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
