"""Turns every failure on data that a command cannot use into one line."""

import functools
from collections.abc import Callable
from typing import Any

from harness.errors import reading

Command = Callable[..., None]


def reads(argument: str) -> Callable[[Command], Command]:
    """Marks a command that works on a file or run folder somebody handed in.

    Args:
        argument: the command's argument that names the file, or a list of files.
    """

    def decorate(command: Command) -> Command:
        @functools.wraps(command)
        def guarded(**given: Any) -> None:
            files = given[argument]
            with reading(", ".join(map(str, files)) if isinstance(files, list) else files):
                command(**given)

        return guarded

    return decorate
