"""The engine's name and the numbers that a caller gives, checked; none changes a pair's result."""

import operator
from typing import Literal, SupportsIndex, cast, get_args

from harness.core.errors import InputError, unknown_name

EngineName = Literal["sumo", "plain"]
"""SUMO, or the same kinematics in plain Python."""


def engine_named(name: str) -> EngineName:
    """The engine with a given name.

    Raises:
        InputError: there is no such engine.
    """
    if name not in get_args(EngineName):
        raise unknown_name("engine", "engine", str(name), get_args(EngineName))
    return cast(EngineName, name)


def whole_number(where: str, value: object, least: int) -> int:
    """A whole number of Python or NumPy, at least ``least``, as an ``int``.

    Raises:
        InputError: the value is anything else; ``where`` names the option.
    """
    try:
        if isinstance(value, bool) or not isinstance(value, SupportsIndex):
            raise TypeError
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if number < least:
        raise InputError(where, f"{value!r} is not accepted", f"a whole number, {least} or more")
    return number
