"""Worker processes on this machine.

Each has a pipe of its own and a thread here that waits for it.  Nothing is shared between workers:
one that is killed in the middle of a message takes no other, and no lock, with it.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from queue import SimpleQueue
from tempfile import gettempdir
from threading import Event, Lock, Thread
from typing import Any, NamedTuple

from harness.engine.starting import scratch_prefix
from harness.scenario import Options
from harness.studies.workers.tasks import (
    Argument,
    ExecutorLostError,
    Result,
    TaskFailedError,
    WorkerDiedError,
)

_START = """
import sys
sys.path[:] = sys.argv[3:]
from harness.studies.workers.parent import end_with_parent
end_with_parent()
from multiprocessing.connection import Connection
from harness.studies.workers.worker import serve
serve(Connection(int(sys.argv[1])), sys.argv[2])
"""
"""What a worker runs.  A fresh interpreter, as a libsumo simulation does not survive a fork, not
multiprocessing's, which would run the main module of the caller in each worker again.  From its
first lines on it ends with its parent, whom nothing it would print could still reach."""

_STANDARD_ERROR = 2

LATER_S = 3.0

_STARTS = 3
"""How often in a row a worker may die before it is ready; what kills it then is no task."""


class _Job(NamedTuple):
    function: Callable[[Any], Any]
    argument: Any
    future: "Future[Any]"


class _Worker(NamedTuple):
    process: "subprocess.Popen[bytes]"
    connection: Connection


class LocalPool:
    """See ``Executor``; the first workers start and import while the caller goes on.

    Args:
        workers: how many processes.
        at_once: so many of them start at once, the others where there is still work to do after
            ``LATER_S``: a start costs what some hundred quick pairs take.  None: all.
        folder: their working directory, where a user's own strategies are found; None: this
            process's.
        imports: the module of what they will run, imported before they take their first job.
        environment: variables that they have and this process has not.
    """

    def __init__(
        self,
        workers: int,
        folder: Path | None = None,
        *,
        at_once: int | None = None,
        imports: str = "harness.engine.sumo",
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.workers = workers
        self._folder, self._environment = folder, {**os.environ, **(environment or {})}
        self._words = [imports, *sys.path]
        self._queue: SimpleQueue[_Job | None] = SimpleQueue()
        self._lock = Lock()
        self._stopped = Event()
        self._problem = "the workers are stopped"
        self._alive: set[subprocess.Popen[bytes]] = set()
        first = workers if at_once is None else at_once
        self._threads = [
            Thread(target=self._keep_busy, args=(number < first,), daemon=True)
            for number in range(workers)
        ]
        for thread in self._threads:
            thread.start()

    def submit(
        self, function: Callable[[Argument], Result], argument: Argument
    ) -> "Future[Result]":
        """See ``Executor.submit``."""
        future: Future[Result] = Future()
        self._queue.put(_Job(function, argument, future))
        return future

    def stop(self) -> None:
        """See ``Executor.stop``."""
        with self._lock:
            self._stopped.set()
            for process in self._alive:
                process.kill()
        for _ in self._threads:
            self._queue.put(None)
        for thread in self._threads:
            thread.join()

    def _keep_busy(self, at_once: bool) -> None:
        """Give one worker job after job, and another worker the next if it dies."""
        worker = None
        if at_once:
            worker = self._ready()
        else:
            self._stopped.wait(LATER_S)
        while (job := self._queue.get()) is not None:
            if worker is not None and worker.process.poll() is not None:
                # It died of nothing; this job is not to blame.
                self._bury(worker)
                worker = None
            worker = worker or self._ready()
            if worker is None:
                job.future.set_exception(ExecutorLostError(self._problem))
            elif not self._survives(worker, job):
                worker = self._ready()
        if worker is not None:
            worker.process.kill()
            self._bury(worker)

    def _survives(self, worker: _Worker, job: _Job) -> bool:
        """Let a worker do a job; returns whether it is still there afterwards."""
        try:
            worker.connection.send((job.function, job.argument))
            done, answer = worker.connection.recv()
        except (EOFError, OSError):
            code = self._bury(worker)
            error = WorkerDiedError(f"the worker process died (exit code {code})")
            job.future.set_exception(error)
            return False
        except Exception as error:
            # A thread that ended here would leave the run waiting for ever.
            job.future.set_exception(error)
            return True
        if done:
            job.future.set_result(answer)
        else:
            job.future.set_exception(TaskFailedError(answer))
        return True

    def _ready(self) -> _Worker | None:
        """A new worker that has imported everything; None if there can be none any more."""
        for _ in range(_STARTS):
            worker = self._start()
            if worker is None:
                return None
            try:
                problem = worker.connection.recv()
            except (EOFError, OSError):
                code = self._bury(worker)
                self._problem = f"no worker process gets ready (exit code {code})"
            else:
                if problem is None:
                    return worker
                # Another would say the same.
                self._bury(worker)
                self._problem = f"no worker process gets ready ({problem})"
                return None
        return None

    def _start(self) -> _Worker | None:
        with self._lock:
            if self._stopped.is_set():
                return None
            ours, theirs = Pipe()
            try:
                # The end of its standard input tells a worker that its parent is gone, however
                # that died.  What it prints is no result: it goes where errors go.  In a group of
                # its own it does not hear Ctrl-C, which is the parent's business.
                process = subprocess.Popen(
                    [sys.executable, "-P", "-c", _START, str(theirs.fileno()), *self._words],
                    stdin=subprocess.PIPE,
                    stdout=_STANDARD_ERROR,
                    pass_fds=[theirs.fileno()],
                    process_group=0,
                    cwd=self._folder,
                    env=self._environment,
                )
            except OSError as error:
                ours.close()
                self._problem = f"no worker process can be started ({error.strerror})"
                return None
            finally:
                # Held by the worker alone from here on, its death closes the pipe.
                theirs.close()
            self._alive.add(process)
            return _Worker(process, ours)

    def _bury(self, worker: _Worker) -> int:
        """Clear away a worker that is dead or about to die; returns its exit code."""
        worker.connection.close()
        try:
            worker.process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            worker.process.kill()
        with self._lock:
            self._alive.discard(worker.process)
        # Closes its standard input too.
        worker.process.communicate()
        # Killed while its SUMO started.
        for folder in Path(gettempdir()).glob(f"{scratch_prefix(worker.process.pid)}*"):
            shutil.rmtree(folder, ignore_errors=True)
        return worker.process.returncode


def default_workers() -> int:
    """All cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def workers_for(pairs: int, options: Options) -> int:
    """How many workers some pairs may keep busy, at most as many as asked for."""
    return max(1, min(options.workers or default_workers(), pairs))
