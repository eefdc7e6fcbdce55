"""Takes tasks and runs them in worker processes on this machine.

Each worker has its own pipe, and a thread of this process waits for it.  Workers share nothing, so
a worker that is killed in the middle of a message affects no other worker and holds no lock.
"""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from queue import SimpleQueue
from tempfile import gettempdir
from threading import Event, Lock, Thread
from typing import Any, NamedTuple

from harness.engine.starting import scratch_prefix
from harness.old.studies.workers.executor import (
    Argument,
    ExecutorLostError,
    Result,
    TaskFailedError,
    WorkerDiedError,
)

_START = """
import sys
sys.path[:] = sys.argv[3:]
from harness.old.studies.workers.parent import end_with_parent
end_with_parent()
from multiprocessing.connection import Connection
from harness.old.studies.workers.worker import serve
serve(Connection(int(sys.argv[1])), sys.argv[2])
"""
"""The program of a worker.  It runs in a new interpreter, because a libsumo simulation does not
survive a fork.  It does not use multiprocessing, which would run the caller's main module again in
each worker.  From its first lines on it ends when its parent ends."""

_STANDARD_ERROR = 2

_STARTS = 3
"""How many times a worker may die before it is ready.  No task causes these deaths."""


class _Job(NamedTuple):
    function: Callable[[Any], Any]
    argument: Any
    future: "Future[Any]"


class _Worker(NamedTuple):
    process: "subprocess.Popen[bytes]"
    connection: Connection


class LocalPool:
    """See ``Executor``; the first workers start in the background.

    Args:
        workers: number of processes.
        folder: working directory of the workers, in which they find the user's own strategies.
            None means the working directory of this process.
        imports: modules of the functions to run, separated by commas.  A worker imports them before
            its first job, while this process is still importing its own.
        environment: further environment variables of the workers.
    """

    def __init__(
        self,
        workers: int,
        folder: Path | None = None,
        *,
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
        self._threads = [Thread(target=self._keep_busy, daemon=True) for _ in range(workers)]
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
                _kill(process)
        for _ in self._threads:
            self._queue.put(None)
        for thread in self._threads:
            thread.join()

    def _keep_busy(self) -> None:
        """Give one job after the other to a worker; if it dies, a new worker gets the next job."""
        worker = self._ready()
        while (job := self._queue.get()) is not None:
            if worker is not None and worker.process.poll() is not None:
                # The worker died between two jobs, so no job caused its death.
                self._bury(worker)
                worker = None
            worker = worker or self._ready()
            if worker is None:
                job.future.set_exception(ExecutorLostError(self._problem))
            elif not self._survives(worker, job):
                worker = self._ready()
        if worker is not None:
            _kill(worker.process)
            self._bury(worker)

    def _survives(self, worker: _Worker, job: _Job) -> bool:
        """Run a job in a worker; return whether the worker is still alive."""
        try:
            worker.connection.send((job.function, job.argument))
            done, answer = worker.connection.recv()
        except (EOFError, OSError):
            code = self._bury(worker)
            error = WorkerDiedError(f"the worker process died (exit code {code})")
            job.future.set_exception(error)
            return False
        except Exception as error:
            # If this thread ended here, the run would wait for ever.
            job.future.set_exception(error)
            return True
        if done:
            job.future.set_result(answer)
        else:
            job.future.set_exception(TaskFailedError(answer))
        return True

    def _ready(self) -> _Worker | None:
        """Return a new worker after its imports; None if no worker can be started."""
        for _ in range(_STARTS):
            worker = self._start()
            if worker is None:
                return None
            try:
                problem = worker.connection.recv()
            except (EOFError, OSError):
                code = self._bury(worker)
                self._problem = f"no worker process became ready (exit code {code})"
            else:
                if problem is None:
                    return worker
                # Another worker would fail in the same way.
                self._bury(worker)
                self._problem = f"no worker process became ready ({problem})"
                return None
        return None

    def _start(self) -> _Worker | None:
        with self._lock:
            if self._stopped.is_set():
                return None
            ours, theirs = Pipe()
            try:
                # A worker ends when its standard input ends, which happens if its parent dies.
                # Its standard output is not a result, so it goes to standard error.  The worker has
                # its own process group, so that only the parent receives Ctrl-C.
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
                # Only the worker holds this end now, so its death closes the pipe.
                theirs.close()
            self._alive.add(process)
            return _Worker(process, ours)

    def _bury(self, worker: _Worker) -> int:
        """Clean up after a dead or dying worker and return its exit code."""
        worker.connection.close()
        with suppress(subprocess.TimeoutExpired):
            worker.process.wait(timeout=10)
        # A strategy's program that hangs would outlive its worker.
        _kill(worker.process)
        with self._lock:
            self._alive.discard(worker.process)
        # This also closes the worker's standard input.
        worker.process.communicate()
        # A worker that is killed while SUMO starts leaves these folders.
        for folder in Path(gettempdir()).glob(f"{scratch_prefix(worker.process.pid)}*"):
            shutil.rmtree(folder, ignore_errors=True)
        return worker.process.returncode


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a worker with everything that it has started."""
    with suppress(ProcessLookupError, PermissionError):  # the latter of a dead one on macOS
        os.killpg(process.pid, signal.SIGKILL)


def default_workers() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
