"""TOML and JSON that somebody else may have written: parsed, never evaluated, held to a form.

The parsers let through what breaks a program or a terminal much later; it is refused here.
"""

import json
import tomllib
import unicodedata
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from harness.core.errors import InputError, unknown_name

MAX_DEPTH = 40
"""Tables and lists within each other; a scenario needs six, a model file five."""

Form = TypeVar("Form", bound=BaseModel)


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
    """The value of a JSON text.

    Raises:
        ValueError: no JSON, NaN or infinity, or anything else that ``parse_toml`` refuses.
    """
    document = _parsed(json.loads, content)
    # Python reads NaN, Infinity and 1e999, but no JSON has them.
    json.dumps(document, allow_nan=False)
    return document


def check_form(form: type[Form], document: Any, where: str) -> Form:
    """A parsed document as the record that its kind of file has to be.

    Args:
        form: the record's class.
        document: as parsed.
        where: the file, for messages.

    Raises:
        InputError: the first key that is missing, unknown, or of another type or range.
    """
    try:
        return form.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        path = [str(part) for part in first["loc"]]
        key = f"{where}: {'.'.join(path)}" if path else where
        if first["type"] == "extra_forbidden":
            known = [field.alias or name for name, field in form.model_fields.items()]
            raise unknown_name(key, "key", path[-1], known) from None
        if first["type"] == "missing":
            raise InputError(key, "is missing") from None
        raise InputError(
            key, f"{shortened(first['input'])} is not accepted", first["msg"]
        ) from None


def shortened(value: Any) -> str:
    """A value as it is shown in a message."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _parsed(parse: Callable[[Any], Any], content: str | bytes) -> Any:
    try:
        document = parse(content)
    except RecursionError:
        raise ValueError(f"nested more than {MAX_DEPTH} deep") from None
    _check(document, MAX_DEPTH)
    return document


def _check(value: Any, depth: int) -> None:
    if not depth:
        raise ValueError(f"nested more than {MAX_DEPTH} deep")
    if isinstance(value, Mapping):
        value = [*value, *value.values()]
    if isinstance(value, list):
        for inner in value:
            _check(inner, depth - 1)
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ValueError("a whole number of more than 64 bits")
    elif isinstance(value, str) and not value.isprintable():
        strange = {char for char in value if unicodedata.category(char) in ("Cc", "Cs")}
        if strange - {"\n", "\t"}:
            raise ValueError(f"text with a control character, {value[:40]!r}")
