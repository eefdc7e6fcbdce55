"""Tasks in; their results out, from workers on this machine or on a Dask cluster.

``supervise`` carries out a task in any ``concurrent.futures.Executor``: in threads of this process,
or in those of a Dask worker.  It gives the task to a child process, and watches it.  ``__main__``
knows the options that choose an executor; docs/batches.md describes them, and docs/files.md says
what is trusted.

Why no library: Pebble limits a whole task and kills its process alone, while a limit is needed for
one answer of a strategy, and its programs must end too; with loky a death breaks all that is
pending, and there are no time limits.  Both start workers only when their caller has imported
everything, and users report that workers outlive a killed parent.
"""

import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from itertools import count
from threading import Event, local
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from harness.core.errors import HarnessError, InputError, Parameter
from harness.studies.running.children import LostError, give_back, stop_children, take_child

if TYPE_CHECKING:
    from harness.studies.running.tasks import EpisodeId, Task, TaskRows

LATER_S = 2.0
"""Further children start after this time, if there is still work: a start takes as long as some
hundred quick pairs."""

QUICK_PAIRS = 50
"""A further child starts without delay for each time this number of pairs."""

_EACH = 3
"""Tasks that an executor of this machine has at a time for each worker."""

_here = local()
"""``ended``: an event that tells this thread to begin nothing more."""


def workers_for(workers: int | None, pairs: int | None) -> int:
    """Number of children to start before the scenario is read; the executor starts the others.

    Args:
        workers: the user's choice; None: as many as there are cores.
        pairs: the number of pairs, if it is known.
    """
    wanted = 1 if pairs is None else -(-pairs // QUICK_PAIRS)
    return max(0, min(wanted, default_workers() if workers is None else workers))


def default_workers() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@runtime_checkable
class Limited(Protocol):
    """An executor that says how many tasks it has at a time."""

    at_once: int


class LocalExecutor(ThreadPoolExecutor):
    """Threads of this process, each with a child process; ``Limited``.

    Args:
        workers: number of threads.
        pairs: number of pairs; of a few, further threads begin after ``LATER_S``.
    """

    def __init__(self, workers: int, pairs: int) -> None:
        self.at_once = _EACH * workers
        self._ended, self._numbers = Event(), count()
        self._quick = -(-pairs // QUICK_PAIRS)
        super().__init__(workers, initializer=self._begin)

    def abort(self) -> None:
        """End everything at once: the tasks and the children."""
        self._ended.set()
        stop_children(self._ended)
        self.shutdown(cancel_futures=True)

    def _begin(self) -> None:
        _here.ended = self._ended
        if next(self._numbers) >= self._quick:
            self._ended.wait(LATER_S)


class InProcess(Executor):
    """Calls each function at once in this process, with its standard input.

    ``breakpoint()`` works in a strategy, and a strategy may be a class of a script or notebook.
    """

    at_once = 1

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> "Future[Any]":
        """Call a function, and return when it has ended."""
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments, **options))
        except Exception as error:
            future.set_exception(error)
        return future

    def shutdown(self, *_: Any, **__: Any) -> None:
        """Close the engine of this process."""
        from harness.engine.shared import close_engine

        close_engine()

    abort = shutdown


OwnExecutor = LocalExecutor | InProcess


def executor_for(workers: int | None, drivers: Iterable[str], pairs: int) -> OwnExecutor:
    """An executor of this machine.

    Args:
        workers: number of processes; None: as many as there are cores; 0: this process alone.
        drivers: names of the strategies; classes of a script or notebook need this process.
        pairs: number of pairs of all cells.

    Raises:
        InputError: ``workers`` is refused.
    """
    from harness.core.errors import whole_number
    from harness.strategies.own import is_of_this_process

    number = default_workers() if workers is None else whole_number("workers", workers, 0)
    if number == 0 or any(map(is_of_this_process, drivers)):
        return InProcess()
    return LocalExecutor(min(number, pairs), pairs)


def carried_out(tasks: "Sequence[Task]") -> "list[TaskRows]":
    """The rows of tasks of one pair, in their order, by child processes of this machine."""
    # There may be none.
    executor = LocalExecutor(max(1, min(default_workers(), len(tasks))), len(tasks))
    try:
        running = [submitted(executor, task) for task in tasks]
        return [future.result() for future in running]
    finally:
        executor.abort()


def submitted(executor: Executor, task: "Task") -> "Future[TaskRows]":
    """A task in an executor: in a child process, or of ``InProcess`` without time limits."""
    if not isinstance(executor, InProcess):
        return executor.submit(supervise, task)
    from harness.studies.running.episodes import run_task

    return executor.submit(run_task, task)


def supervise(task: "Task") -> "TaskRows":
    """Carry out a task in a child process.

    An episode whose strategy gives no answer in time is given up, and the others run again.  A
    death costs one retry; then the episode in flight is given up.

    Raises:
        HarnessError: no child process can be started, or the task raised an exception.
        CancelledError: the executor was ended.
    """
    from harness.strategies.registry import STRATEGIES
    from harness.studies.running.tasks import GivenUp

    died: set[EpisodeId | None] = set()
    events: list[dict[str, Any]] = []
    while True:
        child = take_child(task.code, getattr(_here, "ended", None))
        try:
            rows = child.run(task)
        except LostError as lost:
            code, episode, stack = child.end(), lost.episode, lost.stack
            reason = f"{lost} (exit code {code})" if stack is None else str(lost)
        except BaseException:
            child.end()
            raise
        else:
            give_back(child)
            return replace(rows, events=(*events, *rows.events))
        where = {"first": task.first, "count": task.count} if episode is None else episode._asdict()
        event = {**where, "reason": reason, "stack": stack}
        if stack is None and episode not in died:
            died.add(episode)
            events.append({"event": "tried again", **event})
        elif episode is None:
            raise HarnessError(reason)
        else:
            own = task.driver(episode) not in STRATEGIES
            task = task.without(episode, GivenUp(reason, "strategy" if own else "engine"))
            events.append({"event": "episode given up", **event})


@contextmanager
def dask_executor(address: str, drivers: Iterable[str]) -> Iterator[Executor]:
    """Yield the executor of a Dask cluster; its client is closed afterwards.

    Args:
        address: address of the scheduler, e.g. ``tcp://127.0.0.1:8786``.
        drivers: names of the strategies; modules of the user's own are uploaded.

    Raises:
        InputError: Dask is not installed, the scheduler does not answer or has no worker, or a
            strategy is in a package.
    """
    where = Parameter("dask", address)
    files = [*_own_modules(where, drivers)]
    try:
        from distributed import Client
        from distributed.comm.addressing import get_address_host_port
    except ImportError:
        allowed = "pip install crosswalk-harness[cluster]"
        raise InputError(where, "Dask is not installed", allowed) from None
    try:
        # A client with an invalid address would print a second error when it is deleted.
        get_address_host_port(address, strict=True)
        client = Client(address, timeout=10, set_as_default=False)
    except (OSError, ValueError) as error:
        allowed = "host:port of a running Dask scheduler"
        raise InputError(where, f"no scheduler answers ({error})", allowed) from None
    with client:
        if not client.nthreads():
            raise InputError(where, "the scheduler has no workers", "dask worker ADDRESS")
        for file in files:
            client.upload_file(file, load=False)
        yield client.get_executor(pure=False, retries=0)


def _own_modules(where: Parameter, drivers: Iterable[str]) -> Iterator[str]:
    """The files of the user's own modules; installed ones are left out.

    Raises:
        InputError: one is in a package.
    """
    import importlib.util
    import sysconfig

    from harness.strategies.own import is_of_this_process
    from harness.strategies.program import is_program

    installed = tuple(sysconfig.get_path(kind) for kind in ("purelib", "platlib", "stdlib"))
    others = (name for name in drivers if not is_program(name) and not is_of_this_process(name))
    own = (name for name in others if ":" in name)
    for module in sorted({name.partition(":")[0].partition(".")[0] for name in own}):
        spec = importlib.util.find_spec(module)
        if spec is None or spec.origin is None or spec.origin.startswith(installed):
            continue
        if spec.submodule_search_locations:
            allowed = "a single module, or a package that is installed on every worker"
            raise InputError(where, f"{module} is a package of your own", allowed)
        yield spec.origin
