"""``--vary`` or a ``[sweep]`` table in; each cell's changed keys with their values out."""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from datetime import time
from decimal import Decimal, InvalidOperation
from typing import Any

from harness.core.documents import parse_toml, shortened
from harness.core.errors import InputError
from harness.scenario.file import ScenarioFile, as_plain, toml_value

MAX_CELLS = 100_000


Variation = tuple[str, list[Any]]


def planned_cells(
    file: ScenarioFile, variations: Sequence[Variation], source: str
) -> list[dict[str, Any]]:
    """The values that each cell changes, by key, from ``variations`` or a file's ``[sweep]``.

    Args:
        file: the scenario file.
        variations: keys with their values; if there are any, they replace the ``[sweep]`` table.
        source: name of the variations in messages.

    Raises:
        InputError: a key varies twice, or a key has no list of values.
    """
    if variations or file.sweep is None:
        return _grid([(key, as_plain(values)) for key, values in variations], source)
    return _points_of_table(file.sweep, file.source)


def parse_variation(text: str) -> Variation:
    """Split ``key=v1,v2,…``; a value is TOML or text, and ``0:1:0.1`` is a range up to its end.

    Raises:
        InputError: the text has another form, or a range never reaches its end.
    """
    key, equals, raw = text.partition("=")
    where = f"--vary {text}"
    if not equals or not key.strip() or not raw.strip():
        allowed = "key=v1,v2,…, e.g. pedestrians.flow_per_hour=50,100,250"
        raise InputError(where, "not of the form key=v1,v2,…", allowed)
    try:
        values: list[Any] = parse_toml(f"values = [{raw}]")["values"]
    except ValueError:
        values = [toml_value(part.strip()) for part in raw.split(",")]
    return key.strip(), _expand(values, where)


def _expand(values: Sequence[Any], where: str) -> list[Any]:
    """Replace each range, given as text, by its numbers."""
    expanded: list[Any] = []
    for value in values:
        # TOML reads 10:50:10 as a time of day.
        text = value.isoformat() if isinstance(value, time) else value
        numbers = _numbers(text) if isinstance(text, str) else []
        if len(numbers) == 2:
            raise InputError(where, f"range {text!r} has no step", "begin:end:step")
        if len(numbers) != 3:
            expanded.append(value)
            continue
        # Decimals, so that 0:1:0.1 is 0.3 and not 0.30000000000000004.
        begin, end, step = numbers
        if step == 0 or not 0 <= (end - begin) / step <= MAX_CELLS:
            problem = f"range {text!r} does not reach its end in {MAX_CELLS} steps"
            raise InputError(where, problem, "begin:end:step")
        whole = int if all(number == int(number) for number in numbers) else float
        expanded += [whole(begin + i * step) for i in range(int((end - begin) / step) + 1)]
    return expanded


def _numbers(text: str) -> list[Decimal]:
    """The numbers between colons; none if a part is no finite number that a float can hold."""
    try:
        numbers = [Decimal(part.strip()) for part in text.split(":")]
    except InvalidOperation:
        return []
    return numbers if all(n.is_finite() and abs(n.adjusted()) < 300 for n in numbers) else []


def _points_of_table(table: Mapping[str, Any], source: str) -> list[dict[str, Any]]:
    where = f"{source}: sweep"
    if "cells" not in table:
        flat = flatten(table)
        if not flat:
            raise InputError(where, "nothing to vary", "a list of values for each key that varies")
        for key, values in flat.items():
            if not isinstance(values, list):
                raise InputError(f"{where}.{key}", f"{values!r} is not a list", "a list of values")
        return _grid([(key, _expand(of, f"{where}.{key}")) for key, of in flat.items()], where)
    named = table["cells"]
    if len(table) > 1:
        other = next(key for key in table if key != "cells")
        problem = "cannot be combined with [[sweep.cells]]"
        raise InputError(f"{where}.{other}", problem, "one of the two")
    tables = isinstance(named, list) and all(isinstance(cell, dict) for cell in named)
    if not tables or not 0 < len(named) <= MAX_CELLS:
        allowed = f"1 to {MAX_CELLS} tables [[sweep.cells]]"
        raise InputError(f"{where}.cells", f"{shortened(named)} is not accepted", allowed)
    return [flatten(cell) for cell in named]


def _grid(variations: Sequence[Variation], where: str) -> list[dict[str, Any]]:
    keys = [key for key, _ in variations]
    for key, values in variations:
        if keys.count(key) > 1:
            raise InputError(where, f"{key} varies twice", "each key once")
        if not values:
            raise InputError(f"{where} {key}", "no values", "at least one")
    # The cells are counted first, because two long ranges would not fit into memory.
    count = math.prod(len(values) for _, values in variations)
    if count > MAX_CELLS:
        raise InputError(where, f"{count} cells", f"at most {MAX_CELLS}")
    return [
        dict(zip(keys, values, strict=True))
        for values in itertools.product(*(values for _, values in variations))
    ]


def flatten(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict):
            flat |= flatten(value, f"{prefix}{_part(key)}.")
        else:
            flat[f"{prefix}{_part(key)}"] = value
    return flat


def _part(key: str) -> str:
    """A part of a dotted key, quoted if TOML requires it: ``"my_strategy:MyStrategy"``."""
    return key if re.fullmatch(r"[\w-]+", key, re.ASCII) else f'"{key}"'
