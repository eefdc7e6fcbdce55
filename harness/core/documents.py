"""TOML and JSON from untrusted sources: parsed, never evaluated, and checked against a form.

Values that a parser accepts but that would break a program or a terminal later are refused.
"""

import json
import re
import tomllib
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, TypeVar, get_args

import numpy as np
from pydantic import BaseModel, Field, ValidationError

from harness.core.errors import InputError, brief, nearest_name, unknown_name

MAX_DEPTH = 40
"""Greatest nesting of tables and lists; a scenario needs six levels, a model file five."""

JsonObject = dict[str, Any]
"""An object of a JSON document, or a table of a TOML file."""

Filled = TypeVar("Filled", bound=BaseModel)
"""A form with a document's values."""

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
"""Numbers of a range, for the fields of forms."""


def parse_toml(text: str) -> JsonObject:
    """The tables of a TOML text.

    Raises:
        ValueError: the text is not TOML, is nested too deeply, or contains a whole number of more
            than 64 bits (TOML's limit) or a control character.
    """
    # Some editors put a byte order mark in front of the text.
    tables: JsonObject = _parsed(tomllib.loads, text.removeprefix("\ufeff"))
    return tables


def parse_json(content: str | bytes) -> Any:
    """The value of a JSON text.

    Raises:
        ValueError: the text is not JSON, has NaN or infinity, or has anything else that
            ``parse_toml`` refuses.
    """
    document = _parsed(json.loads, content)
    # Python reads NaN, Infinity and 1e999, but JSON does not allow them.
    json.dumps(document, allow_nan=False)
    return document


def check_form(form: type[Filled], document: Any, where: str) -> Filled:
    """A parsed document as a record of a given class.

    Args:
        form: the record's class.
        document: the parsed document.
        where: name of the file in messages.

    Raises:
        InputError: a key is missing or unknown, or has a wrong type or value; names the first such
            key, as it is written, and of an unknown one the nearest.
    """
    try:
        return form.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
    path = _path_in(document, first["loc"], missing=first["type"] == "missing")
    key = ".".join(part if _BARE.fullmatch(part) else f'"{part}"' for part in path)
    key = f"{where}: {key}" if where and key else where or key
    if first["type"] == "extra_forbidden":
        raise unknown_name(key, "key", path[-1], _keys_of(form, path[:-1]))
    if first["type"] == "missing":
        raise InputError(key, "is missing")
    message = first["msg"].removeprefix("Input should be ")
    allowed = _TOML_WORDS.get(first["type"], message[0].lower() + message[1:])
    if first["type"] == "float_type" and (named_unit := unit_of(path[-1])) is not None:
        allowed += f", in {named_unit[1]}"
    names = re.findall(r"'(\w+)'", message) if first["type"] == "literal_error" else ()
    near = nearest_name(str(first["input"]), names)
    raise InputError(key, f"{brief(first['input'])} is not accepted", allowed, near)


_BARE = re.compile(r"[\w-]+")
"""A part of a key that needs no quotes in TOML."""

_TOML_WORDS = {
    "model_type": "a table",
    "dict_type": "a table",
    "tuple_type": "an array",
    "bool_type": "true or false",
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "text",
    "too_short": "a longer array",
    "too_long": "a shorter array",
}
"""TOML's names for types that pydantic calls by Python's names."""


def _path_in(document: Any, place: Sequence[str | int], *, missing: bool) -> list[str]:
    """The keys of a place; where a form has alternatives, pydantic puts their names among them."""
    path, node = [], document
    for part in place:
        is_index = isinstance(part, int) and isinstance(node, list | tuple)
        if is_index or (isinstance(node, Mapping) and part in node):
            path.append(str(part))
            node = node[part]
    return [*path, str(place[-1])] if missing else path


def _keys_of(form: Any, path: Sequence[str]) -> list[str]:
    """The keys of a table in a form."""
    for name in path:
        if not name.isdecimal():  # a number is an index into an array of tables
            annotation: Any = form.model_fields[name].annotation
            # An optional table is a union with None.
            form = next(iter(get_args(annotation)), annotation)
    return [field.alias or name for name, field in form.model_fields.items()]


_ENDINGS = {"_mps3": "m/s³", "_mps2": "m/s²", "_mps": "m/s", "_m": "m", "_s": "s", "_deg": "°"}
"""Units by the endings of keys; the longer of two endings that fit comes first."""


def unit_of(name: str) -> tuple[str, str] | None:
    """The ending of a key that says its unit, and the unit; None if the name says none.

    >>> unit_of("max_deceleration_mps2"), unit_of("friction")
    (('_mps2', 'm/s²'), None)
    """
    return next((each for each in _ENDINGS.items() if name.endswith(each[0])), None)


def as_plain(value: Any) -> Any:
    """A copy of a value in Python's own types: numbers, lists and dictionaries, all of them new."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [as_plain(part) for part in value]
    if isinstance(value, Mapping):
        return {key: as_plain(part) for key, part in value.items()}
    return value


def _parsed(parse: Callable[[Any], Any], content: str | bytes) -> Any:
    try:
        document = parse(content)
    except RecursionError:
        raise ValueError(f"nested more than {MAX_DEPTH} levels deep") from None
    _check(document, MAX_DEPTH)
    return document


def _check(value: Any, depth: int) -> None:
    """Raise a ``ValueError`` if a parsed value is nested deeper, or has a part that is refused."""
    if not depth:
        raise ValueError(f"nested more than {MAX_DEPTH} levels deep")
    if isinstance(value, Mapping):
        value = [*value, *value.values()]
    if isinstance(value, list):
        for inner in value:
            _check(inner, depth - 1)
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ValueError("a whole number of more than 64 bits")
    elif isinstance(value, str) and not value.isprintable():
        controls = {char for char in value if unicodedata.category(char) in ("Cc", "Cs")}
        if controls - {"\n", "\t"}:
            raise ValueError(f"text with a control character, {value[:40]!r}")
