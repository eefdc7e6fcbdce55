"""Parameters of strategies: a constructor in; the form of a scenario's table, and its check, out.

The form is made by pydantic from the constructor's annotations.  A range is part of an annotation:
``Annotated[float, Field(gt=0)]``.
"""

import inspect
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any, get_type_hints

from pydantic import BaseModel, ConfigDict, create_model
from pydantic.errors import PydanticUserError

from harness.core.documents import as_plain, check_form
from harness.core.errors import InputError
from harness.core.vocabulary import StrategyFactory

GIVEN_BY_HARNESS = ("model", "rng", "step_s")
"""Constructor arguments that the harness passes; they are never keys of a scenario."""

_OPEN = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
"""Kinds of arguments that have no name of their own."""

KNOWS_THE_MODEL = "It is given the model from which the pedestrians are drawn."
"""What is said of a strategy that knows more than real drivers do."""

_SIGNS = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
"""Signs by the names of pydantic's limits."""


@lru_cache
def form_of(strategy: StrategyFactory) -> type[BaseModel]:
    """The form of a ``[strategies.<name>]`` table: the constructor's parameters as fields.

    A parameter whose annotation does not exist at run time, or is no type that pydantic can check,
    takes any value.  With ``**parameters`` other keys are allowed.
    """
    given = inspect.signature(strategy).parameters.values()
    constructor: Any = strategy.__init__ if isinstance(strategy, type) else strategy  # type: ignore[misc]
    try:
        hints = get_type_hints(constructor, include_extras=True)
    except (NameError, TypeError):
        hints = {}
    takes_any = any(each.kind is inspect.Parameter.VAR_KEYWORD for each in given)
    config = ConfigDict(
        extra="allow" if takes_any else "forbid",
        strict=True,
        allow_inf_nan=False,
        arbitrary_types_allowed=True,
        protected_namespaces=(),
    )
    keys = [each for each in given if each.name not in GIVEN_BY_HARNESS and each.kind not in _OPEN]
    defaults = {
        each.name: ... if each.default is inspect.Parameter.empty else each.default for each in keys
    }
    typed: Any = {name: (hints.get(name, Any), default) for name, default in defaults.items()}
    try:
        return create_model("Parameters", __config__=config, **typed)
    except PydanticUserError:
        untyped: Any = {name: (Any, default) for name, default in defaults.items()}
        return create_model("Parameters", __config__=config, **untyped)


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

    Raises:
        InputError: a key is unknown or missing, or a value is not what its annotation allows.
    """
    try:
        check_form(form_of(strategy), as_plain(parameters), "")
    except InputError as error:
        raise error.at(f"{where}.{error.where}") from None


def defaults_of(strategy: StrategyFactory) -> dict[str, Any]:
    """The defaults of the parameters that have one."""
    fields = form_of(strategy).model_fields
    return {name: field.default for name, field in fields.items() if not field.is_required()}


def rows_of(name: str, strategy: StrategyFactory) -> Iterator[dict[str, str | None]]:
    """Yield rows for a user: what a strategy does, then the type and range of each parameter."""
    meaning = (strategy.__doc__ or "no description").strip().splitlines()[0]
    if knows_the_model(strategy):
        meaning += f" {KNOWS_THE_MODEL}"
    yield {"strategy": name, "parameter": None, "default": None, "meaning": meaning}
    for key, field in form_of(strategy).model_fields.items():
        bounds = [
            f"{sign} {getattr(limit, end):g}"
            for limit in field.metadata
            for end, sign in _SIGNS.items()
            if hasattr(limit, end)
        ]
        typed = ", ".join([inspect.formatannotation(field.annotation), *bounds])
        default = "none" if field.is_required() else repr(field.default)
        yield {"strategy": name, "parameter": key, "default": default, "meaning": typed}
