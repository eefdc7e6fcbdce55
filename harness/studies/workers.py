"""Workers: every task runs in a child process that a strategy may hang or kill.

``supervise`` carries out a task in any ``concurrent.futures.Executor``: in threads of this process,
or in those of a Dask worker.  It gives the task to a child process, and watches it.

Why no library: Pebble limits a whole task and kills its process alone, while a limit is needed for
one answer of a strategy, and its programs must end too; with loky a death breaks all that is
pending, and there are no time limits.  Both start workers only when their caller has imported
everything, and users report that workers outlive a killed parent.

This module imports the standard library alone until the first task, so that children start early.
"""

import faulthandler
import fcntl
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from itertools import count
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from threading import Event, Lock, Thread, local
from typing import TYPE_CHECKING, Any

from harness.core.errors import HarnessError, InputError, in_one_line

if TYPE_CHECKING:
    from harness.studies.tasks import EpisodeId, Rows, Task, Tell

SLOW_S = 120.0
"""Longest time without news outside a strategy's ``decide``: imports, its constructor, measures."""

LATER_S = 2.0
"""Further children start after this time, if there is still work: a start takes as long as some
hundred quick pairs."""

QUICK_PAIRS = 50
"""A further child starts without delay for each time this number of pairs."""

_IDLE_S = 600.0
"""A child without work ends after this time."""

_START = """
import sys
sys.path[:] = sys.argv[3:]
from harness.studies.workers import serve
serve(int(sys.argv[1]), int(sys.argv[2]))
"""
"""A child's program, in a new interpreter: a libsumo simulation does not survive a fork, and
multiprocessing would run the caller's main module again."""

_STANDARD_ERROR = 2
_HEAD = 128
"""Bytes of a child's state: the episode in flight, then the number of its steps so far."""

_DECIDES = b"decides"

_lock = Lock()
_idle: "list[_Child]" = []
_children: "set[_Child]" = set()
"""The child processes of this process, and those of them that have no task."""

_here = local()
"""``ended``: an event that tells this thread to begin nothing more."""


class _LostError(Exception):
    """A child died or gave no news for too long.

    Args:
        reason: what happened, in words.
        episode: the episode in flight; None between two episodes.
        stack: the stacks of its threads, if it hung.
    """

    def __init__(self, reason: str, episode: "EpisodeId | None", stack: str | None = None) -> None:
        super().__init__(reason)
        self.episode, self.stack = episode, stack


class _Child:
    """A child process and the pipe to it.

    It ends when its standard input ends, and what it prints is no result.  Its process group is its
    own: Ctrl-C reaches the parent alone, and a strategy's programs end with it.
    """

    def __init__(self) -> None:
        self.owner: Event | None = None
        self._code: dict[str, str] = {}
        self._state = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115
        self._connection, theirs = Pipe()
        descriptors = [theirs.fileno(), self._state.fileno()]
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", _START, *map(str, descriptors), *sys.path],
                stdin=subprocess.PIPE,
                stdout=_STANDARD_ERROR,
                pass_fds=descriptors,
                process_group=0,
            )
        except OSError as error:
            raise HarnessError(f"no worker process can be started ({error.strerror})") from None
        finally:
            theirs.close()  # now the child's death closes the pipe
        _children.add(self)

    def suits(self, code: Mapping[str, str]) -> bool:
        """Whether it is alive and has imported no other version of these strategies."""
        same = all(self._code.get(name, digest) == digest for name, digest in code.items())
        return same and self._process.poll() is None

    def run(self, task: "Task") -> "Rows":
        """The rows of a task.

        Raises:
            _LostError: it died, or there was no news for too long.
            HarnessError: the task raised an exception.
        """
        self._code |= task.code
        os.pwrite(self._state.fileno(), bytes(_HEAD), 0)
        try:
            self._connection.send(task)
            self._wait(task.cells[0].scenario.experiment.decide_limit_s)
            problem, rows = self._connection.recv()
        except (EOFError, OSError):
            raise _LostError("the worker process died", _episode_in(self._head())) from None
        if problem is not None:
            raise HarnessError(f"a worker process failed: {problem}")
        found: Rows = rows
        return found

    def _wait(self, limit_s: float) -> None:
        last, since = b"", time.monotonic()
        while not self._connection.poll(min(limit_s / 10, 1.0)):
            # What it has started may keep the pipe open.
            if self._process.poll() is not None and not self._connection.poll():
                raise EOFError
            state, now = self._head(), time.monotonic()
            if state != last:
                last, since = state, now
            elif _DECIDES in state and now - since > limit_s:
                why = f"decide gave no answer within {limit_s:g} s"
                raise _LostError(why, _episode_in(state), self._stack())
            elif now - since > SLOW_S:
                why = f"nothing happened for {SLOW_S:g} s"
                raise _LostError(why, _episode_in(state), self._stack())

    def _stack(self) -> str:
        """The Python stacks of its threads, also if it hangs in C code."""
        # The signal may wake it, so its state is not read again.
        with suppress(ProcessLookupError):
            os.kill(self._process.pid, signal.SIGUSR1)
        time.sleep(0.2)
        return os.pread(self._state.fileno(), 20_000, _HEAD).decode(errors="replace")

    def kill(self) -> None:
        """Kill it with everything that it has started."""
        with suppress(ProcessLookupError, PermissionError):  # the latter of a dead one on macOS
            os.killpg(self._process.pid, signal.SIGKILL)

    def end(self) -> int:
        """Kill it, clear up after it, and return its exit code."""
        self.kill()
        _children.discard(self)
        self._process.communicate()
        self._connection.close()
        self._state.close()
        # A process that is killed while SUMO starts leaves its folder.
        for folder in Path(tempfile.gettempdir()).glob(f"crosswalk-harness-{self._process.pid}-*"):
            shutil.rmtree(folder, ignore_errors=True)
        return self._process.returncode

    def _head(self) -> bytes:
        return os.pread(self._state.fileno(), _HEAD, 0)


def _episode_in(state: bytes) -> "EpisodeId | None":
    from harness.core.encounter import Arm
    from harness.studies.tasks import EpisodeId

    words = state.strip(b"\0 ").split()
    if len(words) < len(EpisodeId._fields):
        return None
    return EpisodeId(int(words[0]), int(words[1]), Arm(words[2].decode()))


def _forget() -> None:
    """In a process that was forked, the children are its parent's."""
    global _lock
    _lock = Lock()
    _idle.clear()
    _children.clear()


os.register_at_fork(after_in_child=_forget)


def start_children(number: int) -> None:
    """Start child processes, which import what they need while this process goes on."""
    with _lock:
        _idle.extend(_Child() for _ in range(number))


def stop_children(owner: Event | None = None) -> None:
    """End the child processes without a task, and those with a task of a ``LocalExecutor``."""
    with _lock:
        idle = [*_idle]
        _idle.clear()
        for child in _children - {*idle}:
            if owner is not None and child.owner is owner:
                child.kill()
    for child in idle:
        child.end()


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


class LocalExecutor(ThreadPoolExecutor):
    """Threads of this process, each with a child process.

    Args:
        workers: number of threads.
        pairs: number of pairs; of a few, further threads begin after ``LATER_S``.
    """

    def __init__(self, workers: int, pairs: int) -> None:
        self._ended, self._numbers = Event(), count()
        self._at_once = -(-pairs // QUICK_PAIRS)
        super().__init__(workers, initializer=self._begin)

    def abort(self) -> None:
        """End everything at once: the tasks and the children."""
        self._ended.set()
        stop_children(self._ended)
        self.shutdown(cancel_futures=True)

    def _begin(self) -> None:
        _here.ended = self._ended
        if next(self._numbers) >= self._at_once:
            self._ended.wait(LATER_S)


class InProcess(Executor):
    """Runs each task in this process, with its standard input and without time limits.

    ``breakpoint()`` works in a strategy, and a strategy may be a class of a script or notebook.
    """

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> "Future[Any]":
        """Run a task at once, without ``supervise``."""
        assert function is supervise
        future: Future[Any] = Future()
        try:
            future.set_result(run_task(*arguments, **options))
        except Exception as error:
            future.set_exception(error)
        return future

    def shutdown(self, *_: Any, **__: Any) -> None:
        """Close the engine of this process."""
        from harness.engine.shared import close_engine

        close_engine()

    abort = shutdown


def executor_for(
    workers: int | None, drivers: Iterable[str], pairs: int
) -> LocalExecutor | InProcess:
    """An executor of this machine.

    Args:
        workers: number of processes; None: as many as there are cores; 0: this process alone.
        drivers: names of the strategies; classes of a script or notebook need this process.
        pairs: number of pairs of all cells.

    Raises:
        InputError: ``workers`` is refused.
    """
    from harness.scenario.options import whole_number
    from harness.strategies.own import is_of_this_process

    number = default_workers() if workers is None else whole_number("workers", workers, 0)
    if number == 0 or any(map(is_of_this_process, drivers)):
        return InProcess()
    return LocalExecutor(min(number, pairs), pairs)


def supervise(task: "Task") -> "Rows":
    """Carry out a task in a child process.

    An episode whose strategy gives no answer in time is given up, and the others run again.  A
    death costs one retry; then the episode in flight is given up.

    Raises:
        HarnessError: no child process can be started, or the task raised an exception.
        CancelledError: the executor was ended.
    """
    from harness.strategies.registry import STRATEGIES
    from harness.studies.tasks import Failure

    died: set[EpisodeId | None] = set()
    events: list[dict[str, Any]] = []
    while True:
        child = _taken(task.code)
        try:
            rows = child.run(task)
        except _LostError as lost:
            code, episode, stack = child.end(), lost.episode, lost.stack
            reason = f"{lost} (exit code {code})" if stack is None else str(lost)
        except BaseException:
            child.end()
            raise
        else:
            with _lock:
                _idle.append(child)
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
            task = task.without(episode, Failure(reason, "strategy" if own else "engine"))
            events.append({"event": "episode given up", **event})


def _taken(code: Mapping[str, str]) -> _Child:
    """A child process without a task."""
    owner: Event | None = getattr(_here, "ended", None)
    with _lock:
        if owner is not None and owner.is_set():
            raise CancelledError
        while _idle:
            child = _idle.pop(0)
            if child.suits(code):
                break
            child.end()
        else:
            child = _Child()
        child.owner = owner
        return child


def dask_executor(address: str, drivers: Iterable[str]) -> Executor:
    """The executor of a Dask cluster.

    Args:
        address: address of the scheduler, e.g. ``tcp://127.0.0.1:8786``.
        drivers: names of the strategies; modules of the user's own are uploaded.

    Raises:
        InputError: Dask is not installed, the scheduler does not answer, or has no worker.
    """
    import logging

    where = f"--dask {address}"
    try:
        from distributed import Client
        from distributed.comm.addressing import get_address_host_port
    except ImportError:
        allowed = "pip install crosswalk-harness[cluster]"
        raise InputError(where, "Dask is not installed", allowed) from None
    for name in ("distributed", "distributed.client", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # a lost scheduler is told in one line
    try:
        # A client with an invalid address would print a second error when it is deleted.
        get_address_host_port(address, strict=True)
        client = Client(address, timeout=10, set_as_default=False)
    except (OSError, ValueError) as error:
        allowed = "host:port of a running Dask scheduler"
        raise InputError(where, f"no scheduler answers ({error})", allowed) from None
    if not client.nthreads():
        client.close()
        raise InputError(where, "the scheduler has no workers", "dask worker ADDRESS")
    try:
        for file in _own_modules(where, drivers):
            client.upload_file(file, load=False)
    except InputError:
        client.close()
        raise
    executor: Executor = client.get_executor(pure=False, retries=0)
    return executor


def _own_modules(where: str, drivers: Iterable[str]) -> Iterator[str]:
    """The files of the user's own modules; installed ones are left out.

    Raises:
        InputError: one is in a package.
    """
    import importlib.util
    import sysconfig

    installed = tuple(sysconfig.get_path(kind) for kind in ("purelib", "platlib", "stdlib"))
    own = (name for name in drivers if ":" in name and not name.startswith(("exec:", "__main__:")))
    for module in sorted({name.partition(":")[0].partition(".")[0] for name in own}):
        spec = importlib.util.find_spec(module)
        if spec is None or spec.origin is None or spec.origin.startswith(installed):
            continue
        if spec.submodule_search_locations:
            allowed = "a single module, or a package that is installed on every worker"
            raise InputError(where, f"{module} is a package of your own", allowed)
        yield spec.origin


def serve(pipe: int, state: int) -> None:
    """Carry out tasks in a child process until the pipe is closed.

    An answer is an exception in words or None, and the rows.

    Args:
        pipe: descriptor of the pipe.
        state: descriptor of the file that has the episode in flight and, on SIGUSR1, the stacks.
    """
    os.lseek(state, _HEAD, os.SEEK_SET)
    faulthandler.register(signal.SIGUSR1, state)
    # When the parent ends, its end of standard input closes, and the kernel ends this process group
    # by SIGIO, even if a strategy hangs in C code.
    fcntl.fcntl(0, fcntl.F_SETOWN, -os.getpgrp())
    fcntl.fcntl(0, fcntl.F_SETFL, fcntl.fcntl(0, fcntl.F_GETFL) | os.O_ASYNC)
    connection, tell = Connection(pipe), _teller(state)

    def answer() -> tuple[str | None, "Rows | None"]:
        try:
            return None, run_task(connection.recv(), tell)
        except BaseException as error:
            return (str(error) if isinstance(error, HarnessError) else in_one_line(error)), None

    # A broken pipe means that the parent has ended.
    with suppress(EOFError, OSError):
        with suppress(Exception):  # the task raises it again
            import harness.engine.sumo
            import harness.studies.encounters  # noqa: F401
        while connection.poll(_IDLE_S):
            connection.send(answer())


def run_task(task: "Task", tell: "Tell" = lambda _episode, _steps: None) -> "Rows":
    """Simulate a task; see ``encounters.run_task`` and ``simulations.run_task``."""
    if task.cells[0].scenario.kind == "encounters":
        from harness.studies import encounters

        return encounters.run_task(task, tell)
    from harness.studies import simulations

    return simulations.run_task(task, tell)


def _teller(state: int) -> "Callable[[EpisodeId | None, Sized | None], None]":
    """A function that notes the episode in flight; a thread notes that its steps grow."""
    growing: list[Sized] = [()]

    def tell(episode: "EpisodeId | None", states: Sized | None) -> None:
        words = [] if episode is None else [*map(str, episode[:2]), episode.arm.value]
        if states is not None:
            words.append(_DECIDES.decode())
        growing[0] = () if states is None else states
        os.pwrite(state, " ".join(words).ljust(_HEAD).encode(), 0)

    def beat() -> None:
        while True:
            time.sleep(0.05)
            if steps := len(growing[0]):
                os.pwrite(state, str(steps).encode().ljust(16), _HEAD - 16)

    Thread(target=beat, daemon=True).start()
    return tell
