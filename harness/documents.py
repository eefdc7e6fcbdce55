"""TOML and JSON that somebody else may have written: parsed, never evaluated.

What a parser lets through and the rest of a program breaks on is refused here: nesting that no
recursive function gets through, whole numbers that fit no column, characters that a terminal obeys.
"""

import json
import tomllib
import unicodedata
from collections.abc import Callable
from typing import Any

MAX_DEPTH = 40
"""Tables and lists within each other; a scenario needs six, a model file five."""

_TOO_DEEP = f"nested more than {MAX_DEPTH} deep"


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        ValueError: no TOML, nested too deeply, a whole number of more than 64 bits (TOML's own
            limit), or text with control characters.
    """
    # Some editors put a byte order mark in front, which is no part of the text.
    tables: dict[str, Any] = _parsed(tomllib.loads, text.removeprefix("\ufeff"))
    return tables


def parse_json(content: str | bytes) -> Any:
    """The value of a JSON text; refused is what ``parse_toml`` refuses, and NaN and infinity."""
    document = _parsed(json.loads, content)
    # Python reads both, and 1e999 too, but no JSON has them.
    json.dumps(document, allow_nan=False)
    return document


def _parsed(parse: Callable[[Any], Any], content: str | bytes) -> Any:
    try:
        document = parse(content)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    level = [document]
    for _ in range(MAX_DEPTH):
        for value in level:
            _check(value)
        level = [inner for value in level for inner in _inside(value)]
        if not level:
            return document
    raise ValueError(_TOO_DEEP)


def _inside(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return [*value, *value.values()]
    return value if isinstance(value, list) else []


def _check(value: Any) -> None:
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ValueError("a whole number of more than 64 bits")
    if isinstance(value, str) and not value.isprintable():
        strange = [char for char in value if unicodedata.category(char) in ("Cc", "Cs")]
        if set(strange) - {"\n", "\t"}:
            raise ValueError(f"text with a control character, {value[:40]!r}")
