"""The built-in strategies and their parameters, as rows of a screen."""

import inspect

from harness.core.vocabulary import StrategyFactory
from harness.strategies.parameters import form_of, knows_the_model
from harness.strategies.registry import KNOWS_THE_MODEL, STRATEGIES


def strategy_rows() -> list[dict[str, str | None]]:
    """Rows for a user: of each built-in strategy its first line, then its parameters."""
    rows: list[dict[str, str | None]] = []
    for name, factory in STRATEGIES.items():
        meaning = (factory.__doc__ or "no description").strip().splitlines()[0]
        if knows_the_model(factory):
            meaning += f" {KNOWS_THE_MODEL}"
        no_parameter = {"parameter": None, "default": None}
        rows.append({"strategy": name, **no_parameter, "meaning": meaning})
        rows += [
            {
                "strategy": name,
                "parameter": key,
                "default": "none" if field.is_required() else repr(field.default),
                "meaning": _in_words(factory, key),
            }
            for key, field in form_of(factory).model_fields.items()
        ]
    return rows


_SIGNS = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
"""Signs by the names of pydantic's limits."""


def _in_words(strategy: StrategyFactory, name: str) -> str:
    """The type and the range of a parameter, as its annotation says them."""
    field = form_of(strategy).model_fields[name]
    bounds = [
        f"{sign} {getattr(limit, key):g}"
        for limit in field.metadata
        for key, sign in _SIGNS.items()
        if hasattr(limit, key)
    ]
    return ", ".join([inspect.formatannotation(field.annotation), *bounds])
