"""Parameters of strategies, and the check of a scenario's table against a constructor."""

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.errors import PydanticUserError

from harness.core.encounter import StrategyFactory
from harness.core.errors import InputError, unknown_name

GIVEN_BY_HARNESS = ("model", "rng", "step_s")
"""Constructor arguments that the harness passes; they are never keys of a scenario."""

_OPEN = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)


@dataclass(frozen=True)
class StrategyParameter:
    """One key of a ``[strategies.<name>]`` table; it is ``required`` if it has no default."""

    name: str
    default: Any
    annotation: Any

    @property
    def required(self) -> bool:
        """Whether a scenario must set it."""
        return self.default is inspect.Parameter.empty


def parameters_of(strategy: StrategyFactory) -> list[StrategyParameter]:
    """The parameters that a scenario may set, in the order of the strategy's constructor."""
    try:
        hints = get_type_hints(_constructor(strategy))
    except (NameError, TypeError):
        # A user's annotation may not exist at run time, e.g. if only type checkers import it.
        hints = {}
    return [
        StrategyParameter(parameter.name, parameter.default, hints.get(parameter.name, Any))
        for parameter in inspect.signature(strategy).parameters.values()
        if parameter.name not in GIVEN_BY_HARNESS and parameter.kind not in _OPEN
    ]


@lru_cache
def needs(strategy: StrategyFactory) -> tuple[str, ...]:
    """The arguments of ``GIVEN_BY_HARNESS`` that the constructor names."""
    names = inspect.signature(strategy).parameters
    return tuple(name for name in GIVEN_BY_HARNESS if name in names)


def knows_the_model(strategy: StrategyFactory) -> bool:
    """Whether the strategy gets the interaction model, from which pedestrians are drawn too."""
    return "model" in needs(strategy)


def check_parameters(strategy: StrategyFactory, parameters: Mapping[str, Any], where: str) -> None:
    """Check a ``[strategies.<name>]`` table against the constructor's signature.

    Of the parameters that the attribute ``ALTERNATIVES`` of a class lists, a table may have one.

    Raises:
        InputError: a key is unknown, a value has another type than the annotation, or two keys are
            alternatives.
    """
    known = {parameter.name: parameter for parameter in parameters_of(strategy)}
    takes_any = any(
        parameter.kind is inspect.Parameter.VAR_KEYWORD
        for parameter in inspect.signature(strategy).parameters.values()
    )
    for name, value in parameters.items():
        if name not in known:
            if takes_any and name not in GIVEN_BY_HARNESS:
                continue
            if not known:
                raise InputError(f"{where}.{name}", "this strategy has no parameters")
            raise unknown_name(f"{where}.{name}", "parameter", name, known)
        if not _fits(value, known[name].annotation):
            raise InputError(
                f"{where}.{name}", f"{value!r} is not accepted", describe(known[name].annotation)
            )
    both = [name for name in getattr(strategy, "ALTERNATIVES", ()) if name in parameters]
    if len(both) > 1:
        raise InputError(
            f"{where}.{both[0]}", f"excludes {both[1]}, which is set too", "one of both"
        )


def check_complete(strategy: StrategyFactory, parameters: Mapping[str, Any], where: str) -> None:
    """Check that every parameter without a default is set.

    Raises:
        InputError: a parameter is missing; names the first one.
    """
    for parameter in parameters_of(strategy):
        if parameter.required and parameter.name not in parameters:
            raise InputError(
                f"{where}.{parameter.name}",
                "is missing and has no default",
                describe(parameter.annotation),
            )


def describe(annotation: Any) -> str:
    """An annotation in plain words, such as ``finite number`` or ``'mode' or 'sampled'``."""
    if get_origin(annotation) is Literal:
        return " or ".join(repr(choice) for choice in get_args(annotation))
    if get_origin(annotation) in (Union, UnionType):
        return " or ".join(describe(part) for part in get_args(annotation))
    words = {
        float: "finite number",
        int: "integer",
        bool: "true or false",
        str: "text",
        NoneType: "nothing",
        Any: "any value",
    }
    return words.get(annotation, getattr(annotation, "__name__", str(annotation)))


def _constructor(strategy: StrategyFactory) -> Any:
    return strategy.__init__ if isinstance(strategy, type) else strategy  # type: ignore[misc]


def _fits(value: Any, annotation: Any) -> bool:
    config = ConfigDict(strict=True, allow_inf_nan=False, arbitrary_types_allowed=True)
    try:
        TypeAdapter(annotation, config=config).validate_python(value)
    except ValidationError:
        return False
    except PydanticUserError:
        # Pydantic cannot check this annotation.
        return True
    return True
