"""The command line in this process: how it ends, what it prints, and where it writes."""

import contextlib
import io
import os
import signal
import sys
import tempfile
import unicodedata
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import matplotlib.font_manager
import pytest
from typer.main import get_command

from harness.cli import app as cli

HANG_S = 120
"""No case takes nearly as long; what does, hangs."""

_HIDDEN = (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning)
"""Warnings that Python does not show to a user."""


@dataclass
class Ended:
    """How a command ended.  ``written``: every path it opened to write, made, moved or removed."""

    code: int
    out: str
    err: str
    written: set[str] = field(default_factory=set)


class HangError(BaseException):
    """A command did not end; nothing of the harness catches this."""


_watched: set[str] | None = None


def _note_writing(event: str, arguments: tuple[Any, ...]) -> None:
    if _watched is None:
        return
    if event == "open":
        path, _, flags = arguments
        if isinstance(path, int) or not flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            return
        paths: tuple[Any, ...] = (path,)
    elif event in ("os.remove", "os.rmdir") and arguments[1] >= 0:
        return  # relative to an open folder: a part of shutil.rmtree, of which the whole is noted
    elif event in ("os.rename", "os.link", "os.symlink"):
        paths = arguments[:2]
    elif event in ("os.mkdir", "os.remove", "os.rmdir", "os.truncate", "os.chmod", "shutil.rmtree"):
        paths = arguments[:1]
    else:
        return
    _watched.update(os.path.realpath(os.fsdecode(path)) for path in paths if path is not None)


# Typer builds it anew for every call, which is half the time of a case.
cli.app = get_command(cli.app)  # type: ignore[assignment]

# It makes its folder and its list of fonts once, for all programs of the user.
matplotlib.get_configdir()
sys.addaudithook(_note_writing)


def harness(*words: object) -> Ended:
    """Run ``harness`` with these words; whatever it raises instead of ending fails the test."""
    global _watched
    out, err = io.StringIO(), io.StringIO()
    arguments, sys.argv = sys.argv, ["harness", *map(str, words)]
    written: set[str] = set()
    with warnings.catch_warnings(record=True) as shown, _alarm():
        warnings.simplefilter("always")
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                _watched = written
                cli.main()
        except SystemExit as end:
            code = end.code
        finally:
            _watched = None
            sys.argv = arguments
    seen = [f"{w.category.__name__}: {w.message}" for w in shown if w.category not in _HIDDEN]
    assert not seen, seen
    assert isinstance(code, int)
    return Ended(code, out.getvalue(), err.getvalue(), written)


def done_or_refused(*words: object, inside: Path, codes: tuple[int, ...] = (0, 2)) -> bool:
    """Whether a command does what it is told; else it refuses in one line with exit code 2.

    Args:
        words: what follows ``harness``.
        inside: the only folder it may write in.
        codes: exit codes that are no surprise.
    """
    ended = harness(*words)
    assert ended.code in codes, ended
    # A terminal obeys control characters, wherever they come from.
    for text in (ended.out, ended.err):
        strange = {char for char in text if unicodedata.category(char) in ("Cc", "Cs")} - {"\n"}
        assert not strange, (strange, ended)
        assert "Traceback" not in text
    allowed = (os.path.realpath(inside), os.path.realpath(os.devnull))
    temporary = os.path.join(os.path.realpath(tempfile.gettempdir()), "crosswalk-harness-")  # noqa: PTH118
    for path in ended.written:
        within = path in allowed or path.startswith((allowed[0] + os.sep, temporary))
        assert within, (path, ended)
    if ended.code == 2:
        assert ended.out == "", ended
        assert ended.err.startswith("harness: "), ended
        assert ended.err.count("\n") == 1, ended
        assert ended.err.endswith("\n"), ended
    return ended.code != 2


@contextlib.contextmanager
def _alarm() -> Iterator[None]:
    """Turns a hang into a failure."""

    def ring(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        raise HangError(f"no end after {HANG_S} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(HANG_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tasks run where they are submitted, and fail as they do in a worker."""
    from concurrent.futures import Future

    from harness.workers.pool import LocalPool
    from harness.workers.tasks import TaskFailedError

    def made(pool: LocalPool, workers: int, *_: Any, **__: Any) -> None:  # noqa: ARG001
        pool.workers = 1

    def submit(pool: LocalPool, function: Any, argument: Any) -> "Future[Any]":  # noqa: ARG001
        future: Future[Any] = Future()
        try:
            future.set_result(function(argument))
        except Exception as error:
            future.set_exception(TaskFailedError(f"{type(error).__name__}: {error}"))
        return future

    monkeypatch.setattr(LocalPool, "__init__", made)
    monkeypatch.setattr(LocalPool, "submit", submit)
    monkeypatch.setattr(LocalPool, "stop", lambda pool: None)  # noqa: ARG005
