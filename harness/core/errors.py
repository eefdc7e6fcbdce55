"""The few kinds of error a caller can act on.

Every message is one line that says where, what, what is allowed and, for a misspelt name, the
nearest valid one.
"""

import difflib
import shlex
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

_FRAMES = 20
"""Frames of a strategy's traceback that are kept: the innermost ones."""


class HarnessError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(HarnessError):
    """The user's input was refused; the shell turns it into one line and exit code 2.

    Args:
        where: the file, key or option, e.g. ``cctc.toml: pedestrians.flow_per_hour``.
        problem: what was found there, with the value.
        allowed: what would have been accepted.
        nearest: the valid name closest to a misspelt one.
    """

    def __init__(
        self, where: str, problem: str, allowed: str | None = None, nearest: str | None = None
    ) -> None:
        self.where = where
        self.problem = problem
        self.allowed = allowed
        self.nearest = nearest
        parts = [f"{where}: {problem}"]
        if allowed:
            parts.append(f"allowed: {allowed}")
        if nearest:
            parts.append(f"did you mean {nearest!r}?")
        super().__init__(one_line("; ".join(parts)))


class EngineError(HarnessError):
    """The simulation engine could not carry out an episode (not the user's fault)."""


class StrategyError(EngineError):
    """A strategy raised, or asked for something that is no acceleration.

    Args:
        message: one line.
        cause: what it raised; its traceback, from the strategy's own frames on, is kept.
    """

    def __init__(self, message: str, cause: BaseException | None = None) -> None:
        super().__init__(one_line(message))
        self.traceback: str | None = None
        if cause is not None and cause.__traceback__ is not None:
            # The first frame is the harness's call.
            own = cause.__traceback__.tb_next
            lines = traceback.format_exception(type(cause), cause, own, limit=-_FRAMES)
            self.traceback = "".join(lines)


class InterruptedRunError(KeyboardInterrupt):
    """A run was stopped from outside; what is finished is kept in its folder.

    In Python it is the ``KeyboardInterrupt`` that Ctrl-C always is: ``except Exception`` does not
    take it for a failure.
    """

    def __init__(self, folder: object) -> None:
        super().__init__(f"interrupted; go on with: {resume_command(folder)}")


_REFUSED = (ArithmeticError, LookupError, NotImplementedError, OSError, TypeError, ValueError)
"""Exceptions that a library's parser raises on a file it cannot use."""


@contextmanager
def reading(file: object) -> Iterator[None]:
    """Around a library's parser alone: what it raises is the file's fault.

    What it gives is checked then.  Whatever breaks later is a mistake of this package.

    Args:
        file: what is parsed, for the message.

    Raises:
        InputError: the file is damaged.
    """
    try:
        yield
    except _REFUSED as error:
        raise InputError(str(file), f"is damaged ({in_one_line(error)})") from error


def one_line(text: str) -> str:
    """Text on one line, what cannot be printed spelled out: a terminal obeys control characters."""
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode()
        for char in " ".join(text.split())
    )


def resume_command(folder: object) -> str:
    """The shell command that finishes a run."""
    return f"harness resume {shlex.quote(str(folder))}"


def unknown_name(where: str, kind: str, name: str, valid: Iterable[str]) -> InputError:
    """The refusal of a name that is not in a known set, with the nearest valid one."""
    names = sorted(valid)
    return InputError(
        where,
        f"unknown {kind} {name!r}",
        ", ".join(names) or f"none, as there is no {kind}",
        nearest_name(name, names),
    )


def nearest_name(name: str, valid: Iterable[str]) -> str | None:
    """The valid name closest to a misspelt or shortened one, None where none is near."""
    names = list(valid)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    # ``flow`` for ``flow_per_hour`` is too short to look alike.
    whole = [valid_name for valid_name in names if name in valid_name.split("_")]
    return next(iter(close + whole), None)


def place_of(error: BaseException) -> str | None:
    """``file:line`` where an error was raised, None without a traceback.

    Frames of the import machinery do not count; a file in the working directory is named from
    there.
    """
    if isinstance(error, SyntaxError) and error.filename:
        return f"{_from_here(error.filename)}:{error.lineno}"
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if "importlib" not in frame.filename
    ]
    return f"{_from_here(frames[-1].filename)}:{frames[-1].lineno}" if frames else None


def in_one_line(error: BaseException) -> str:
    """The last line of an error's traceback, and its place."""
    text = error.msg if isinstance(error, SyntaxError) else str(error)
    place = place_of(error)
    return f"{type(error).__name__}: {text}" + (f" ({place})" if place else "")


def _from_here(file: str) -> str:
    path, here = Path(file), Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else file
