"""Runs tasks on an executor and yields their results, with retries after failures.

A task whose worker dies is run again.  A task that fails twice gets rows with the reason.  All
others keep their results.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from pathlib import Path

from harness.core.errors import HarnessError
from harness.old.store.kinds import kind_of
from harness.old.store.tables import table_of
from harness.old.studies.kinds.table import run_task
from harness.old.studies.kinds.tasks import Task, TaskResult
from harness.old.studies.kinds.watchdog import stack_in
from harness.old.studies.workers.executor import (
    Argument,
    Executor,
    ExecutorLostError,
    Result,
    WorkerDiedError,
)

ATTEMPTS = 2
"""Number of failures after which a task is abandoned."""

Note = Callable[..., None]
"""Writes an event and its details to the log."""


def run_tasks(
    executor: Executor, tasks: Iterable[Task], note: Note
) -> Iterator[tuple[Task, TaskResult]]:
    """Run all tasks and yield each with its result, in the order in which they finish.

    A task with twins is yielded as ``task.each``.

    Args:
        executor: runs the tasks.
        tasks: the tasks; only a few per worker are taken at a time.
        note: called with retries and abandoned pairs.
    """
    waiting = iter(tasks)
    again: list[Task] = []
    failures: dict[str, int] = {}

    def take() -> Task | None:
        return again.pop() if again else next(waiting, None)

    for task, future in call_each(executor, run_task, take):
        try:
            yield from zip(task.each, future.result(), strict=True)
        except ExecutorLostError:
            raise
        except (Exception, CancelledError) as error:
            reason = reason_of(error, task.hang_after_s, task.stack_file)
            note("task failed", task=task.name, reason=reason, stack=_stack(task))
            if task.twins:
                # Perhaps only one of the cells causes the failure.
                again += task.each
                continue
            failures[task.name] = failures.get(task.name, 0) + 1
            if failures[task.name] < ATTEMPTS:
                again.append(task)
            else:
                note("pair given up", cell=task.cell, pair=task.first_pair, reason=reason)
                yield task, _given_up(task, reason)


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


def _stack(task: Task) -> str | None:
    """Return the Python stack of a hung worker for the log, and remove its file."""
    stack = stack_in(task.stack_file)
    if task.stack_file is not None:
        task.stack_file.unlink(missing_ok=True)
    return stack


def _given_up(task: Task, reason: str) -> TaskResult:
    """Return the rows of an abandoned pair."""
    kind = kind_of(task.scenario)
    which = {"cell": task.cell, "pair": task.first_pair}
    known = {kind.rows: [{**which, **row} for row in kind.given_up(reason)]}
    names = kind.tables(traces=task.traces)
    tables = {name: table_of(name, known.get(name, ())) for name in names}
    return TaskResult(tables)
