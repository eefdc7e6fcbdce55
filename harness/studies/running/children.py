"""Child processes: each carries out tasks that a strategy may hang or kill.

A child starts early because this module itself imports little; SUMO and the harness's other modules
follow while the parent goes on.
"""

import faulthandler
import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sized
from concurrent.futures import CancelledError
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection, Pipe
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING

from harness.core.errors import HarnessError, in_one_line

if TYPE_CHECKING:
    from harness.studies.running.tasks import EpisodeId, Task, TaskRows

SLOW_S = 120.0
"""Longest time without news outside a strategy's ``decide``: imports, its constructor, measures."""

_IDLE_S = 600.0
"""A child without work ends after this time."""

_START = """
import sys
sys.path[:] = sys.argv[3:]
from harness.studies.running.children import serve
serve(int(sys.argv[1]), int(sys.argv[2]))
"""
"""A child's program, in a new interpreter: a simulation of SUMO does not survive a fork, and
multiprocessing would run the caller's main module again."""

_STANDARD_ERROR = 2
_HEAD = 128
"""Bytes of a child's state: the episode in flight, then the number of its steps so far."""

_DECIDES = b"decides"

_lock = Lock()
_idle: "list[Child]" = []
_children: "set[Child]" = set()
"""The child processes of this process that have no task, and all of them."""


class LostError(Exception):
    """A child died or gave no news for too long.

    Args:
        reason: what happened, in words.
        episode: the episode in flight; None between two episodes.
        stack: the stacks of its threads, if it hung.
    """

    def __init__(self, reason: str, episode: "EpisodeId | None", stack: str | None = None) -> None:
        super().__init__(reason)
        self.episode, self.stack = episode, stack


class Child:
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

    def run(self, task: "Task") -> "TaskRows":
        """The rows of a task.

        Raises:
            LostError: it died, or there was no news for too long.
            HarnessError: the task raised an exception.
        """
        self._code |= task.code
        os.pwrite(self._state.fileno(), bytes(_HEAD), 0)
        try:
            self._connection.send(task)
            self._wait(task.cells[0].scenario.experiment.decide_limit_s)
            problem, rows = self._connection.recv()
        except (EOFError, OSError):
            raise LostError("the worker process died", _episode_in(self._head())) from None
        if problem is not None:
            raise HarnessError(f"a worker process failed: {problem}")
        found: TaskRows = rows
        return found

    def _wait(self, limit_s: float) -> None:
        """Wait for an answer; raise ``LostError`` if the child neither answers nor moves on."""
        last, since = b"", time.monotonic()
        while not self._connection.poll(min(limit_s / 10, 1.0)):
            # What it has started may keep the pipe open.
            if self._process.poll() is not None and not self._connection.poll():
                raise EOFError
            state, now = self._head(), time.monotonic()
            if state != last:
                last, since = state, now
                continue
            decides = _DECIDES in state
            if now - since > (most_s := limit_s if decides else SLOW_S):
                why = "decide gave no answer within" if decides else "nothing happened for"
                raise LostError(f"{why} {most_s:g} s", _episode_in(state), self._stack())

    def _stack(self) -> str:
        """The Python stacks of its threads, also if it hangs in C code."""
        # The signal may wake it, so its state is not read again.  Its handler has 0.2 s to write.
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
        from harness.engine.installation import remove_scratch  # to start a child needs it not

        # A process that is killed while SUMO starts leaves its folder.
        remove_scratch(self._process.pid)
        return self._process.returncode

    def _head(self) -> bytes:
        return os.pread(self._state.fileno(), _HEAD, 0)


def _episode_in(state: bytes) -> "EpisodeId | None":
    from harness.core.vocabulary import Arm
    from harness.studies.running.tasks import EpisodeId

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
    """Have so many child processes, which import what they need while this process goes on."""
    with _lock:
        _idle.extend(Child() for _ in range(number - len(_children)))


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


def take_child(code: Mapping[str, str], owner: Event | None) -> Child:
    """A child process without a task.

    Args:
        code: digests of the user's strategies that will drive.
        owner: the event that ends the executor whose task it is, if it is one of this machine.

    Raises:
        CancelledError: the executor was ended.
        HarnessError: no child process can be started.
    """
    with _lock:
        if owner is not None and owner.is_set():
            raise CancelledError
        while _idle:
            child = _idle.pop(0)
            if child.suits(code):
                break
            child.end()
        else:
            child = Child()
        child.owner = owner
        return child


def give_back(child: Child) -> None:
    """Keep a child process for the next task."""
    with _lock:
        _idle.append(child)


def import_arrow() -> None:
    """Import Arrow without pandas, which its first array would import, in 0.13 s.

    Arrow imports it when it is asked for a frame.  No other thread may import meanwhile.
    """
    if "pandas" not in sys.modules:
        sys.meta_path.insert(0, _NoPandas)
        try:
            import_module("pyarrow").array([])
        finally:
            sys.meta_path.remove(_NoPandas)


class _NoPandas:
    @staticmethod
    def find_spec(name: str, *_: object) -> None:
        """See ``importlib.abc.MetaPathFinder``."""
        if name == "pandas":
            raise ImportError


def serve(pipe: int, state: int) -> None:
    """Carry out tasks in a child process until the pipe is closed.

    An answer is an exception in words or None, and the rows.

    Args:
        pipe: descriptor of the pipe.
        state: descriptor of the file that has the episode in flight and, on SIGUSR1, the stacks.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in ``harness.__main__``
    os.lseek(state, _HEAD, os.SEEK_SET)
    faulthandler.register(signal.SIGUSR1, state)
    # When the parent ends, its end of standard input closes, and the kernel ends this process group
    # by SIGIO, even if a strategy hangs in C code.
    fcntl.fcntl(0, fcntl.F_SETOWN, -os.getpgrp())
    fcntl.fcntl(0, fcntl.F_SETFL, fcntl.fcntl(0, fcntl.F_GETFL) | os.O_ASYNC)
    connection, tell = Connection(pipe), _teller(state)

    def answer() -> tuple[str | None, "TaskRows | None"]:
        try:
            from harness.studies.running.episodes import run_task

            return None, run_task(connection.recv(), tell)
        except BaseException as error:
            return (str(error) if isinstance(error, HarnessError) else in_one_line(error)), None

    # A broken pipe means that the parent has ended.
    with suppress(EOFError, OSError):
        with suppress(Exception):  # the task raises it again
            import_module("harness.engine.session").interface()
            import_arrow()
            import_module("harness.studies.running.episodes")
        while connection.poll(_IDLE_S):
            connection.send(answer())


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
