"""``--vary`` or a ``[sweep]`` table in; each cell's changed keys with their values out."""

import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from harness.core.documents import as_plain, parse_toml
from harness.core.errors import InputError, Parameter, Place, brief, checked, inside
from harness.scenario.file import ScenarioFile, Setting, parts_of, toml_value

MAX_CELLS = 100_000
"""The most cells of a sweep."""

Variation = tuple[str, Sequence[Any]]
"""A dotted key and its values."""


def planned_cells(
    file: ScenarioFile, variations: Sequence[Variation], source: Place
) -> list[dict[str, Any]]:
    """The values that each cell changes, by key, from ``variations`` or a file's ``[sweep]``.

    Args:
        file: the scenario file.
        variations: keys with their values; if there are any, they replace the ``[sweep]`` table.
        source: where the values are given, for messages.

    Raises:
        InputError: a key varies twice or is also set, or a key has no list of values.
    """
    sweep = None if variations else as_plain(file.sweep)
    grid: list[Variation] = [(key, _values_of(of, inside(source, key))) for key, of in variations]
    points = sweep if isinstance(sweep, list) else None
    if isinstance(sweep, dict) and "cells" in sweep:
        points = _named_cells(sweep, source)
    elif isinstance(sweep, dict):
        grid = _lists_of(sweep, source)
    keys = (
        [key for key, _ in grid] if points is None else [key for point in points for key in point]
    )
    given = {key: setting for key in keys if (setting := _setting_of(key, file.settings))}
    if given and (variations or points is not None):
        key, setting = next(iter(given.items()))
        problem = f"{setting.key} is also set, to {as_plain(setting.value)!r}"
        raise InputError(inside(source, key), problem, "one of the two")
    if points is None:
        points = _grid([(key, values) for key, values in grid if key not in given], source)
    return points


def _setting_of(key: str, settings: Sequence[Setting]) -> Setting | None:
    """The setting that sets a key, a part of it, or its table."""
    path = parts_of(Setting(key, None))
    for setting in settings:
        if all(a == b for a, b in zip(path, parts_of(setting), strict=False)):
            return setting
    return None


@checked
def parse_variation(text: str) -> Variation:
    """The key and the values of a text ``key=v1,v2,…``; a value is TOML or text.

    Raises:
        InputError: the text has another form.
    """
    key, equals, raw = text.partition("=")
    if not equals or not key.strip() or not raw.strip():
        allowed = "key=v1,v2,…, e.g. pedestrians.flow_per_hour=50,100,250"
        raise InputError(Parameter("vary", text), "not of the form key=v1,v2,…", allowed)
    try:
        values: list[Any] = parse_toml(f"values = [{raw}]")["values"]
    except ValueError:
        values = [toml_value(part.strip()) for part in raw.split(",")]
    return key.strip(), values


def _values_of(values: Any, where: Place) -> list[Any]:
    """The values of a key; a single value is refused."""
    if isinstance(values, str | bytes | Mapping) or not isinstance(values, Iterable):
        raise InputError(where, f"{brief(values)} is not a list", "a list of values")
    return [*map(as_plain, values)]


def _lists_of(table: Mapping[str, Any], where: Place) -> list[Variation]:
    """The keys of a ``[sweep]`` with their values."""
    flat = flatten(table)
    if not flat:
        raise InputError(where, "nothing to vary", "a list of values for each key that varies")
    return [(key, _values_of(values, f"{where}.{key}")) for key, values in flat.items()]


def _named_cells(table: Mapping[str, Any], where: Place) -> list[dict[str, Any]]:
    """The keys with their values of each of the ``[[sweep.cells]]``."""
    named = table["cells"]
    if len(table) > 1:
        other = next(key for key in table if key != "cells")
        problem = "cannot be combined with [[sweep.cells]]"
        raise InputError(f"{where}.{other}", problem, "one of the two")
    tables = isinstance(named, list) and all(isinstance(cell, dict) for cell in named)
    if not tables or not 0 < len(named) <= MAX_CELLS:
        allowed = f"1 to {MAX_CELLS} tables [[sweep.cells]]"
        raise InputError(f"{where}.cells", f"{brief(named)} is not accepted", allowed)
    return [flatten(cell) for cell in named]


def _grid(variations: Sequence[Variation], where: Place) -> list[dict[str, Any]]:
    keys = [key for key, _ in variations]
    for key, values in variations:
        if keys.count(key) > 1:
            raise InputError(where, f"{key} varies twice", "each key once")
        if not values:
            raise InputError(inside(where, key), "no values", "at least one")
    # The cells are counted first, because two long ranges would not fit into memory.
    count = math.prod(len(values) for _, values in variations)
    if count > MAX_CELLS:
        raise InputError(where, f"{count} cells", f"at most {MAX_CELLS}")
    points = itertools.product(*(values for _, values in variations))
    return [dict(zip(keys, values, strict=True)) for values in points]


def flatten(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, f"{prefix}{_part(key)}.")
        else:
            flat[f"{prefix}{_part(key)}"] = value
    return flat


def _part(key: str) -> str:
    """A part of a dotted key, quoted if TOML requires it: ``"my_strategy:MyStrategy"``."""
    return key if re.fullmatch(r"[\w-]+", key, re.ASCII) else f'"{key}"'
