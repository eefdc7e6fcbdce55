"""Runs tasks on an executor and yields their results, with retries after failures.

A task whose worker dies is run again.  A task that fails twice gets rows with the reason.  All
others keep their results.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from pathlib import Path

from harness.core.errors import HarnessError
from harness.old.studies.kinds.watchdog import stack_in
from harness.old.studies.workers.executor import (
    Argument,
    Executor,
    Result,
    WorkerDiedError,
)

ATTEMPTS = 2
"""Number of failures after which a task is abandoned."""


def call_each(
    executor: Executor,
    function: Callable[[Argument], Result],
    take: Callable[[], Argument | None],
) -> "Iterator[tuple[Argument, Future[Result]]]":
    """Call a function with each argument, with only a few calls per worker at a time.

    Args:
        executor: runs the calls.
        function: see ``Executor.submit``.
        take: returns the next argument; None if there is none at present.

    Yields:
        Each argument with its finished future, in the order in which they finish.
    """
    running: dict[Future[Result], Argument] = {}
    while True:
        while len(running) < 2 * executor.workers and (argument := take()) is not None:
            running[executor.submit(function, argument)] = argument
        if not running:
            return
        done, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in done:
            yield running.pop(future), future


def reason_of(error: BaseException, hang_after_s: float, stack_file: Path | None) -> str:
    """Return the reason why there is no result, in one line."""
    if isinstance(error, WorkerDiedError) and stack_in(stack_file) is not None:
        return f"the worker was ended: no pair finished within {hang_after_s:g} s"
    text = " ".join(str(error).split())
    return text if isinstance(error, HarnessError) else f"{type(error).__name__}: {text}"
