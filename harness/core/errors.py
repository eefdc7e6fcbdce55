"""The errors that the package raises for a caller to handle, and the checks of arguments.

Every message is one line.  It has the place, the problem, the allowed values and, for a misspelt
name, the nearest valid name.
"""

import difflib
import inspect
import os
import re
import shlex
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from numbers import Integral, Real
from pathlib import Path
from types import UnionType
from typing import Any, Literal, NamedTuple, ParamSpec, Self, TypeVar, Union, get_args, get_origin

Asked = ParamSpec("Asked")
Answer = TypeVar("Answer")

_FRAMES = 20
"""Number of a strategy's innermost traceback frames that are kept."""


class HarnessError(Exception):
    """Base class of every error that this package raises on purpose.

    Args:
        message: what happened; it is put on one line.

    >>> str(EngineError("SUMO failed:\\n\\tno lane"))
    'SUMO failed: no lane'
    """

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


class Parameter(NamedTuple):
    """A function's parameter, and its value or a key in it; a command has an option instead.

    >>> str(Parameter("by", "pet_s"))
    'by pet_s'
    """

    name: str
    value: object = None

    def __str__(self) -> str:
        """The place of an error: the value is left out if the problem has it."""
        return self.name if self.value is None else f"{self.name} {self.value}"


Place = str | Path | Parameter
"""The file or key of an error, or the parameter of the function that refuses it."""


def inside(place: Place, key: str) -> Place:
    """The place of a key in a parameter or in anything else that holds keys."""
    return place._replace(value=key) if isinstance(place, Parameter) else f"{place} {key}"


class InputError(HarnessError):
    """The user's input is refused; the command line prints one line and exits with code 2.

    Args:
        where: the place, e.g. ``cctc.toml: pedestrians.flow_per_hour``; ``where`` is its text.
        problem: the problem there, with the value.
        allowed: the values that are accepted.
        nearest: the valid name closest to a misspelt one.
    """

    def __init__(
        self, where: Place, problem: str, allowed: str | None = None, nearest: str | None = None
    ) -> None:
        self.place = where
        self.where = str(where)
        self.problem = problem
        self.allowed = allowed
        self.nearest = nearest
        hints = allowed and f"allowed: {allowed}", nearest and f"did you mean {nearest!r}?"
        super().__init__("; ".join([f"{self.where}: {problem}", *filter(None, hints)]))

    def at(self, where: Place) -> Self:
        """The same error at another place."""
        return type(self)(where, self.problem, self.allowed, self.nearest)

    def __reduce__(self) -> tuple[type[Self], tuple[Place | None, ...]]:
        """Its parts, so that it may come from another process."""
        return type(self), (self.place, self.problem, self.allowed, self.nearest)


class EngineError(HarnessError):
    """The simulation engine could not simulate an episode (not the user's fault)."""


class StrategyError(HarnessError):
    """A strategy raised an exception, or returned a command that is not an acceleration.

    Args:
        message: what happened; it is put on one line.
        cause: the strategy's exception; the traceback is kept without the harness's own frames.
    """

    def __init__(self, message: str, cause: BaseException | None = None) -> None:
        super().__init__(message)
        self.traceback: str | None = None
        if cause is not None and cause.__traceback__ is not None:
            # The first frame is the harness's call.
            frames = cause.__traceback__.tb_next
            lines = traceback.format_exception(type(cause), cause, frames, limit=-_FRAMES)
            self.traceback = "".join(lines)

    def at(self, where: str) -> Self:
        """The same error with a place before its message."""
        error = type(self)(f"{where}: {self}")
        error.traceback = self.traceback
        return error


class InterruptedRunError(KeyboardInterrupt):
    """A run was interrupted; its folder keeps the finished pairs.

    It is a ``KeyboardInterrupt``, as after every Ctrl-C, so ``except Exception`` does not catch it.
    """

    def __init__(self, folder: object) -> None:
        super().__init__(f"interrupted; to continue: {advised('resume', folder)}")


@contextmanager
def refused_at(where: str) -> Iterator[None]:
    """Put a place before those that ``InputError`` in this block name, unless they begin with it.

    Args:
        where: the place; if it is empty, nothing changes.
    """
    try:
        yield
    except InputError as error:
        if not where or error.where.startswith(where):
            raise
        raise error.at(f"{where} {error.where}") from error


_REFUSED = (ArithmeticError, LookupError, NotImplementedError, OSError, TypeError, ValueError)
"""Exceptions that a library's parser raises if it cannot use a file."""


@contextmanager
def reading(file: object) -> Iterator[None]:
    """Turn the exceptions of a library's parser into an ``InputError``.

    Only the parser's call belongs in the block: an exception there means that the file is damaged,
    but an exception elsewhere is a mistake of this package.

    Args:
        file: the file that is parsed, for the message.

    Raises:
        InputError: the file is damaged.
    """
    try:
        yield
    except _REFUSED as error:
        raise InputError(str(file), f"is damaged ({in_one_line(error)})") from error


def one_line(text: str) -> str:
    """Text on one line; unprintable characters are escaped, because a terminal would obey them."""
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode()
        for char in " ".join(text.split())
    )


def reason_of(error: Exception) -> str:
    """Why a file cannot be read or written: the system's word, or else the error's own."""
    return getattr(error, "strerror", None) or str(error)


def advised(function: str, folder: object) -> str:
    """The call that an error advises to make of a folder; the command line shows a command.

    >>> advised("resume", "runs/cctc-1"), in_shell(advised("resume", "my runs/1"))
    ('harness.resume("runs/cctc-1")', "harness resume 'my runs/1'")
    """
    return f'harness.{function}("{folder}")'


def in_shell(text: str) -> str:
    """A text with commands of the shell in place of the calls that ``advised`` makes."""
    return _ADVISED.sub(lambda call: f"harness {call[1]} {shlex.quote(call[2])}", text)


_ADVISED = re.compile(r'harness\.(\w+)\("(.+?)"\)')


def unknown_name(where: Place, kind: str, name: object, valid: Iterable[str]) -> InputError:
    """The error for a name that is not in a known set; it holds the nearest valid name."""
    names = sorted(valid)
    allowed = ", ".join(names) or f"none: there is no {kind}"
    return InputError(where, f"unknown {kind} {name!r}", allowed, nearest_name(str(name), names))


def nearest_name(name: str, valid: Iterable[str]) -> str | None:
    """The valid name closest to a misspelt or brief one; None if none is similar.

    >>> nearest_name("flow", ["speed", "flow_per_hour"])
    'flow_per_hour'
    """
    names = list(valid)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    # ``flow`` is too short to be similar to ``flow_per_hour``.
    whole = [valid_name for valid_name in names if name in valid_name.split("_")]
    return next(iter(close + whole), None)


def place_of(error: BaseException) -> str | None:
    """``file:line`` where an error was raised; None if it has no traceback.

    Frames of the import machinery do not count.  The path of a file in the working directory is
    relative to it.
    """
    frames = traceback.extract_tb(error.__traceback__)
    own = [(each.filename, each.lineno) for each in frames if "importlib" not in each.filename]
    if isinstance(error, SyntaxError) and error.filename:
        own.append((error.filename, error.lineno))
    if not own:
        return None
    file, line = own[-1]
    path, here = Path(file), Path.cwd()
    return f"{path.relative_to(here) if path.is_relative_to(here) else file}:{line}"


def in_one_line(error: BaseException) -> str:
    """The last line of an error's traceback, and its place."""
    text = error.msg if isinstance(error, SyntaxError) else str(error)
    place = place_of(error)
    return f"{type(error).__name__}: {text}" + (f" ({place})" if place else "")


def brief(value: Any) -> str:
    """A value in the form in which messages show it: at most 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


_ALSO: dict[Any, Any] = {int: Integral, float: Real, Path: os.PathLike}
"""What stands for a class in annotations."""

_EXCEPT = ((bool, int), (bool, float), (str, Sequence))
"""Values of Python that are of a kind which a caller does not mean by them."""


def checked(function: Callable[Asked, Answer]) -> Callable[Asked, Answer]:
    """The function, which first refuses arguments that its annotations do not allow.

    The values of dictionaries are not looked at.  An annotation in quotes, or none at all, allows
    anything.

    Raises:
        InputError: an argument is refused; names the parameter.
        TypeError: an argument is missing or has an unknown name, as in every call.
    """
    signature = inspect.signature(function)

    @wraps(function)
    def call(*args: Asked.args, **kwargs: Asked.kwargs) -> Answer:
        for name, value in signature.bind(*args, **kwargs).arguments.items():
            parameter = signature.parameters[name]
            several = parameter.kind is inspect.Parameter.VAR_POSITIONAL
            for each in value if several else [value]:
                _check(name, each, parameter.annotation)
        return function(*args, **kwargs)

    return call


def _check(name: str, value: Any, annotation: Any) -> None:
    """Raise an ``InputError`` if an argument is not what its annotation allows."""
    united = get_origin(annotation) in (Union, UnionType)
    names: list[str] = []
    for option in get_args(annotation) if united else [annotation]:
        kind = get_origin(option) or option
        if kind is Literal:
            names += get_args(option)
        elif kind in (Any, inspect.Parameter.empty) or isinstance(kind, str):
            return
        elif isinstance(value, _ALSO.get(kind, kind)) and (type(value), kind) not in _EXCEPT:
            for number, part in enumerate(value if kind is Sequence else ()):
                _check(f"{name}[{number}]", part, *get_args(option))
            return
    if isinstance(value, str) and value in names:
        return
    if isinstance(value, str) and names:
        raise unknown_name(Parameter(name), name, value, names)
    allowed = re.sub(r"\b\w+\.", "", inspect.formatannotation(annotation))
    raise InputError(Parameter(name), f"{brief(value)} is not accepted", allowed)


def whole_number(where: Place, value: Any, least: int) -> int:
    """A whole number of Python or NumPy, at least ``least``, as an ``int``.

    Raises:
        InputError: the value is anything else; ``where`` names the option.
    """
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise InputError(where, f"{value!r} is not accepted", f"a whole number, {least} or more")
    return int(value)
