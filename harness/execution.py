"""Tasks on executors: retries, culprits, a bounded number under way.

One code path for every executor: tasks are futures.  A worker that dies costs its task a retry; a
task that fails twice is run pair by pair, and a pair that fails twice again gets the ending
``engine_failed`` with the reason, so that everything else keeps its results.
"""

import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import replace
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any, Protocol

from harness.encounter import Arm, Ending
from harness.errors import HarnessError
from harness.worker import Task, TaskResult, serve

ATTEMPTS = 2
"""How often a task may fail before it is taken apart, or a single pair before it is given up."""

Note = Callable[..., None]
"""Writes an event with its details to the log."""


class Executor(Protocol):
    """Runs tasks somewhere."""

    workers: int

    def submit(self, task: Task) -> "Future[TaskResult]":
        """Start a task; the future raises if the task or its worker failed."""
        ...

    def stop(self) -> None:
        """End everything at once."""
        ...


class ExecutorLostError(HarnessError):
    """Whatever runs the tasks is gone; no task is to blame."""

    def __init__(self, what: str) -> None:
        super().__init__(f"{what} is gone; what is finished is kept: go on with --resume")


class WorkerDiedError(HarnessError):
    """The process that worked on a task is gone."""

    def __init__(self, exitcode: int | None) -> None:
        super().__init__(f"the worker process died (exit code {exitcode})")


class TaskFailedError(HarnessError):
    """A task raised in its worker, which goes on; the message says what."""


class LocalPool:
    """Worker processes on this machine, one libsumo simulation in each.

    Each has a pipe of its own and a thread here that waits for it.  Nothing is shared between
    workers: one that is killed in the middle of a message takes no other, and no lock, with it.

    Args:
        workers: how many processes.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        # Spawned, not forked: a libsumo simulation does not survive a fork.
        self._context = get_context("spawn")
        self._queue: SimpleQueue[tuple[Task, Future[TaskResult]] | None] = SimpleQueue()
        self._lock = Lock()
        self._stopped = False
        self._alive: set[SpawnProcess] = set()
        self._threads = [Thread(target=self._keep_busy, daemon=True) for _ in range(workers)]
        # Interruptions are the parent's business.  Processes inherit what is blocked in the
        # thread that starts them, so that none hears Ctrl-C, not even one that still imports.
        # The resource tracker unblocks SIGINT when it starts, so it has to be there before.
        resource_tracker.ensure_running()
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            for thread in self._threads:
                thread.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)

    def submit(self, task: Task) -> "Future[TaskResult]":
        """See ``Executor.submit``."""
        future: Future[TaskResult] = Future()
        self._queue.put((task, future))
        return future

    def stop(self) -> None:
        """See ``Executor.stop``."""
        with self._lock:
            self._stopped = True
            for process in self._alive:
                process.kill()
        for _ in self._threads:
            self._queue.put(None)
        for thread in self._threads:
            thread.join()

    def _keep_busy(self) -> None:
        """Give one worker task after task; a dead one is replaced with the next task."""
        worker: tuple[SpawnProcess, Connection] | None = None
        while (item := self._queue.get()) is not None and not self._stopped:
            task, future = item
            if worker is not None and not worker[0].is_alive():
                self._bury(*worker)
                worker = None
            try:
                worker = worker or self._start()
                worker[1].send(task)
                answer = worker[1].recv()
            except (EOFError, OSError):
                exitcode = self._bury(*worker) if worker is not None else None
                worker = None
                future.set_exception(WorkerDiedError(exitcode))
                continue
            except Exception as error:
                # A thread that ended here would leave the run waiting for ever.
                future.set_exception(error)
                continue
            if isinstance(answer, TaskResult):
                future.set_result(answer)
            else:
                future.set_exception(TaskFailedError(answer))
        if worker is not None:
            worker[0].kill()
            self._bury(*worker)

    def _start(self) -> tuple[SpawnProcess, Connection]:
        with self._lock:
            if self._stopped:
                raise EOFError
            ours, theirs = self._context.Pipe()
            process = self._context.Process(target=serve, args=(theirs,), daemon=True)
            process.start()
            # Held by the worker alone from here on, its death closes the pipe.
            theirs.close()
            self._alive.add(process)
            return process, ours

    def _bury(self, process: SpawnProcess, connection: Connection) -> int | None:
        """Clear away a worker that is dead or about to die; returns its exit code."""
        with self._lock:
            connection.close()
            process.join(timeout=10)
            if process.exitcode is None:
                process.kill()
                process.join()
            self._alive.discard(process)
            return process.exitcode


def default_workers() -> int:
    """All cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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
    running: dict[Future[TaskResult], Task] = {}
    while True:
        while len(running) < 2 * executor.workers:
            task = again.pop() if again else next(waiting, None)
            if task is None:
                break
            running[executor.submit(task)] = task
        if not running:
            return
        done, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in done:
            task = running.pop(future)
            try:
                yield task, future.result()
            except ExecutorLostError:
                raise
            except (Exception, CancelledError) as error:
                reason = _reason(error, task)
                failures[task.name] = failures.get(task.name, 0) + 1
                last = failures[task.name] >= ATTEMPTS
                note("task failed", task=task.name, reason=reason, stack=_stack(task))
                if not last:
                    again.append(task)
                elif task.count > 1:
                    again += [
                        _part(task, pair)
                        for pair in range(task.first_pair, task.first_pair + task.count)
                    ]
                else:
                    note("pair given up", cell=task.cell, pair=task.first_pair, reason=reason)
                    yield task, _given_up(task, reason)


def _part(task: Task, pair: int) -> Task:
    single = replace(task, first_pair=pair, count=1)
    if task.stack_file is None:
        return single
    return replace(single, stack_file=task.stack_file.with_name(f"stack-{single.name}.txt"))


def _reason(error: BaseException, task: Task) -> str:
    if isinstance(error, WorkerDiedError) and _has_text(task.stack_file):
        return f"the worker was ended: no pair finished within {task.hang_after_s:g} s"
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
    from harness.results import EPISODES, PEDESTRIANS, TRACES

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
