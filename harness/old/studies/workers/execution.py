"""Runs tasks on an executor and yields their results, with retries after failures.

A task whose worker dies is run again.  A task that fails twice is run pair by pair.  A pair that
fails twice gets the ending ``engine_failed`` with the reason.  All other pairs keep their results.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import replace
from pathlib import Path

from harness.core.encounter import FailedIn
from harness.core.errors import HarnessError
from harness.old.store.kinds import kind_of
from harness.old.store.tables import table_of
from harness.old.studies.kinds.table import run_task
from harness.old.studies.kinds.tasks import Task, TaskResult
from harness.old.studies.kinds.watchdog import begun_in, hang_of
from harness.old.studies.workers.executor import (
    Argument,
    Executor,
    ExecutorLostError,
    Result,
    WorkerDiedError,
)

ATTEMPTS = 2
"""Number of failures after which a task is split into pairs, or a single pair is abandoned."""

SILENT_S = 2.0
"""If no task finishes for this time, the progress names the episodes that are still running."""

Note = Callable[..., None]
"""Writes an event and its details to the log."""


def run_tasks(
    executor: Executor,
    tasks: Iterable[Task],
    note: Note,
    waits_for: Callable[[str], None] = lambda _what: None,
) -> Iterator[tuple[Task, TaskResult]]:
    """Run all tasks and yield each with its result, in the order in which they finish.

    A task with twins is yielded as ``task.each``, and a split task as its single pairs.

    Args:
        executor: runs the tasks.
        tasks: the tasks; only a few per worker are taken at a time.
        note: called with retries and abandoned pairs.
        waits_for: called with the episodes that make no progress if no task finishes.
    """
    waiting = iter(tasks)
    again: list[Task] = []
    failures: dict[str, int] = {}

    def take() -> Task | None:
        return again.pop() if again else next(waiting, None)

    def waits(running: Iterable[Task]) -> None:
        if silent := [words for task in running if (words := _silent(task))]:
            waits_for("; ".join(silent))

    for task, future in call_each(executor, run_task, take, waits):
        try:
            yield from zip(task.each, future.result(), strict=True)
        except ExecutorLostError:
            raise
        except (Exception, CancelledError) as error:
            hang = hang_of(task.stack_file) if isinstance(error, WorkerDiedError) else None
            reason = reason_of(error, task.hang_after_s, task.stack_file)
            if task.twins:
                # Perhaps only one of the cells causes the failure.
                note("task failed", task=task.name, reason=reason, stack=_stack(task))
                again += task.each
                continue
            if hang is not None and hang.in_decide and hang.episode is not None:
                # The hung pair is known and a retry would hang too, so only the others go on.
                pair, arm = hang.episode
                limit_s = task.scenario.experiment.decide_limit_s
                reason = f"decide gave no answer within {limit_s:g} s (arm {arm.value})"
                again += [part for part in _around(task, pair) if part.count]
                alone = replace(_part(task, pair), hung=(arm, reason))
                what = "episode given up" if task.hung is None else "pair given up"
                note(what, cell=task.cell, pair=pair, reason=reason, stack=_stack(task))
                if task.hung is None:
                    # Only one arm hung, so the other arm still runs.
                    again.append(alone)
                else:
                    yield alone, _given_up(alone, f"{task.hung[1]}; {reason}", "strategy")
                continue
            failures[task.name] = failures.get(task.name, 0) + 1
            last = failures[task.name] >= ATTEMPTS
            note("task failed", task=task.name, reason=reason, stack=_stack(task))
            if not last:
                again.append(task)
            elif task.count > 1:
                again += [_part(task, pair) for pair in task.pairs]
            else:
                note("pair given up", cell=task.cell, pair=task.first_pair, reason=reason)
                yield task, _given_up(task, reason)


def call_each(
    executor: Executor,
    function: Callable[[Argument], Result],
    take: Callable[[], Argument | None],
    waits: Callable[[Iterable[Argument]], None] = lambda _running: None,
) -> "Iterator[tuple[Argument, Future[Result]]]":
    """Call a function with each argument, with only a few calls per worker at a time.

    Args:
        executor: runs the calls.
        function: see ``Executor.submit``.
        take: returns the next argument; None if there is none at present.
        waits: called with the running arguments if no call finishes for a while.

    Yields:
        Each argument with its finished future, in the order in which they finish.
    """
    running: dict[Future[Result], Argument] = {}
    while True:
        while len(running) < 2 * executor.workers and (argument := take()) is not None:
            running[executor.submit(function, argument)] = argument
        if not running:
            return
        done, _ = wait(running, SILENT_S, return_when=FIRST_COMPLETED)
        if not done:
            waits(running.values())
        for future in done:
            yield running.pop(future), future


def _part(task: Task, pair: int) -> Task:
    return _named(replace(task, first_pair=pair, count=1))


def _named(part: Task) -> Task:
    """Return the part of a task with a stack file of its own."""
    if part.stack_file is None:
        return part
    return replace(part, stack_file=part.stack_file.with_name(f"stack-{part.name}.txt"))


def _around(task: Task, pair: int) -> tuple[Task, Task]:
    """Split a task into the pairs before and the pairs after ``pair``."""
    before = replace(task, count=pair - task.first_pair)
    after = replace(task, first_pair=pair + 1, count=task.count - before.count - 1)
    return _named(before), _named(after)


def _silent(task: Task) -> str | None:
    """Return the current episode of a task that made no progress recently; None if it did."""
    path = task.stack_file
    try:
        if path is None or time.time() - path.stat().st_mtime < SILENT_S:
            return None
    except OSError:  # the task has not begun or has just finished
        return None
    episode = begun_in(path)
    return None if episode is None else f"pair {episode[0]} ({episode[1].value})"


def reason_of(error: BaseException, hang_after_s: float, stack_file: Path | None) -> str:
    """Return the reason why there is no result, in one line."""
    if isinstance(error, WorkerDiedError) and hang_of(stack_file) is not None:
        return f"the worker was ended: no pair finished within {hang_after_s:g} s"
    text = " ".join(str(error).split())
    return text if isinstance(error, HarnessError) else f"{type(error).__name__}: {text}"


def _stack(task: Task) -> str | None:
    """Return the Python stack of a hung worker for the log, and remove its file."""
    hang = hang_of(task.stack_file)
    if task.stack_file is not None:
        task.stack_file.unlink(missing_ok=True)
    return None if hang is None else hang.stack


def _given_up(task: Task, reason: str, failed_in: FailedIn = "engine") -> TaskResult:
    """Return the rows of an abandoned pair."""
    kind = kind_of(task.scenario)
    which = {"cell": task.cell, "pair": task.first_pair}
    failed = kind.given_up(task.scenario, reason, failed_in)
    driven = [row for row in failed if task.only in (None, row["arm"])]
    known = {kind.rows: [{**which, **row} for row in driven]}
    names = kind.tables(traces=task.traces)
    tables = {name: table_of(name, known.get(name, ())) for name in names}
    return TaskResult(tables, took_s=task.hang_after_s)
