"""Tasks on executors: retries, culprits, a bounded number under way.

One code path for every executor: tasks are futures.  A worker that dies costs its task a retry; a
task that fails twice is run pair by pair, and a pair that fails twice again gets the ending
``engine_failed`` with the reason, so that everything else keeps its results.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import replace
from pathlib import Path
from typing import Any

from harness.encounter import Arm, Ending
from harness.errors import HarnessError
from harness.results.tables import EPISODES, PEDESTRIANS, TRACES
from harness.workers.tasks import (
    Argument,
    Executor,
    ExecutorLostError,
    Result,
    Task,
    TaskResult,
    WorkerDiedError,
)
from harness.workers.worker import run_task

ATTEMPTS = 2
"""How often a task may fail before it is taken apart, or a single pair before it is given up."""

Note = Callable[..., None]
"""Writes an event with its details to the log."""


def run_tasks(
    executor: Executor, tasks: Iterable[Task], note: Note
) -> Iterator[tuple[Task, TaskResult]]:
    """Run all tasks; yields each as it finishes, in whatever order.

    A task that had to be taken apart comes out as its single pairs.

    Args:
        executor: where they run.
        tasks: read as needed: only a few per worker are under way at a time.
        note: told of retries and of pairs given up.
    """
    waiting = iter(tasks)
    again: list[Task] = []
    failures: dict[str, int] = {}

    def take() -> Task | None:
        return again.pop() if again else next(waiting, None)

    for task, future in call_each(executor, run_task, take):
        try:
            yield task, future.result()
        except ExecutorLostError:
            raise
        except (Exception, CancelledError) as error:
            reason = reason_of(error, task.hang_after_s, task.stack_file)
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
) -> "Iterator[tuple[Argument, Future[Result]]]":
    """Call a function with one argument after another, a few per worker at a time.

    Args:
        executor: where.
        function: see ``Executor.submit``.
        take: gives the next argument; None if there is none at present.

    Yields:
        Each argument with its finished future, in whatever order.
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


def _part(task: Task, pair: int) -> Task:
    single = replace(task, first_pair=pair, count=1)
    if task.stack_file is None:
        return single
    return replace(single, stack_file=task.stack_file.with_name(f"stack-{single.name}.txt"))


def reason_of(error: BaseException, hang_after_s: float, stack_file: Path | None) -> str:
    """Why there is no result, in one line."""
    if isinstance(error, WorkerDiedError) and _has_text(stack_file):
        return f"the worker was ended: no pair finished within {hang_after_s:g} s"
    text = " ".join(str(error).split())
    return text if isinstance(error, HarnessError) else f"{type(error).__name__}: {text}"


def _has_text(path: Path | None) -> bool:
    return path is not None and path.is_file() and path.stat().st_size > 0


def _stack(task: Task) -> str | None:
    """The Python stack a hung worker left, for the log."""
    path = task.stack_file
    if path is None or not path.is_file():
        return None
    text = path.read_text(encoding="utf-8", errors="replace")
    path.unlink()
    return text or None


def _given_up(task: Task, reason: str) -> TaskResult:
    """Rows of a pair that no worker survived."""
    arms = task.scenario.arms
    strategies = {Arm.AV: arms.av, Arm.HUMAN: arms.human}
    known: list[dict[str, Any]] = [
        {
            "cell": task.cell,
            "pair": task.first_pair,
            "arm": arm.value,
            "strategy": strategy,
            "ending": Ending.ENGINE_FAILED.value,
            "reason": reason,
            "fallback": False,
            "steps": 0,
            "pedestrians": 0,
        }
        for arm, strategy in strategies.items()
    ]
    rows: dict[str, dict[str, list[Any]]] = {
        "episodes": {name: [row.get(name) for row in known] for name in EPISODES.names},
        "pedestrians": {name: [] for name in PEDESTRIANS.names},
    }
    if task.traces:
        rows["traces"] = {name: [] for name in TRACES.names}
    return TaskResult(rows)
