"""From one scenario file to the cells of a study: a single cell, or a grid of varied keys."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import time
from decimal import Decimal, InvalidOperation
from types import MappingProxyType
from typing import Any

from harness.documents import parse_toml
from harness.errors import InputError
from harness.scenario.file import (
    ScenarioFile,
    Setting,
    apply_setting,
    as_plain,
    toml_value,
    validate,
)
from harness.scenario.scenario import Scenario
from harness.scenario.units import in_si

MAX_CELLS = 100_000


@dataclass(frozen=True)
class Cell:
    """One point of a study.

    ``number`` is its place in the tables; it never enters a seed.  ``varied`` holds the varied
    keys with this cell's values.
    """

    number: int
    varied: Mapping[str, Any]
    scenario: Scenario

    def __post_init__(self) -> None:
        """Nobody changes what a cell varies, whoever holds the dictionary it was made from."""
        object.__setattr__(self, "varied", MappingProxyType(dict(self.varied)))

    @property
    def but_for_arms(self) -> str:
        """Two cells with the same text meet the same pedestrians, with the same parameters."""
        return repr(self.scenario.model_copy(update={"arms": None}))

    def __reduce__(self) -> tuple[type["Cell"], tuple[int, dict[str, Any], Scenario]]:
        """Pickled, as for a worker, by what it was made of: a read-only mapping cannot be."""
        return Cell, (self.number, dict(self.varied), self.scenario)


@dataclass(frozen=True)
class Study:
    """All cells of a run, in order: the last varied key changes fastest.

    ``base`` is the scenario without the variation.
    """

    name: str
    base: Scenario
    cells: tuple[Cell, ...]

    @property
    def in_traffic(self) -> bool:
        """Whether its cells are hours of traffic; all of them are, or none."""
        return self.cells[0].scenario.traffic is not None

    @property
    def driven(self) -> list[str]:
        """The strategies that drive in any cell, by name, each once."""
        arms = (cell.scenario.arms.model_dump().values() for cell in self.cells)
        return list(dict.fromkeys(name for names in arms for name in names))

    @property
    def varied_keys(self) -> list[str]:
        """The varied keys, in the order given; none for a run of one cell."""
        return list(self.cells[0].varied)


Variation = tuple[str, list[Any]]


def study_of(file: ScenarioFile, variations: Sequence[Variation] = ()) -> Study:
    """The cells of a run: of ``variations``, else of the file's ``[sweep]`` table, else one cell.

    Raises:
        InputError: a key or value is not accepted, a key varies twice, two cells are the same.
    """
    if variations and file.sweep is not None:
        raise InputError(
            "--vary", f"{file.source} has a [sweep] table of its own", "one of the two"
        )
    points, source = [dict[str, Any]()], "--vary"
    if file.sweep is not None:
        points, source = _points_of_table(file.sweep, file.source), f"{file.source}: sweep"
    elif variations:
        points = _grid([(key, as_plain(values)) for key, values in variations], source)
    keys = list(dict.fromkeys(key for point in points for key in point))
    if "experiment.pairs" in keys:
        raise InputError(
            f"{source} experiment.pairs", "varies", "one number for all cells: --pairs"
        )
    cells = []
    seen: dict[str, int] = {}
    for number, point in enumerate(points):
        scenario = file.scenario([Setting(key, value, source) for key, value in point.items()])
        dumped = scenario.model_dump()
        # A speed with a unit is a number from here on.
        written = in_si(point, source, {})
        varied = {key: written.get(key, _value_at(dumped, key)) for key in keys}
        # A class is a name from here on.
        varied |= {key: _value_at(dumped, key) for key in keys if isinstance(varied[key], type)}
        if (first := seen.setdefault(repr(dumped), number)) != number:
            what = ", ".join(f"{key}={value}" for key, value in varied.items())
            problem = f"cells {first} and {number} are the same ({what})"
            raise InputError(source, problem, "each value once")
        cells.append(Cell(number, varied, scenario))
    if len({cell.scenario.traffic is None for cell in cells}) > 1:
        allowed = "[traffic] in every cell, or in none"
        raise InputError(source, "some cells are hours of traffic, others are not", allowed)
    return Study(file.name, file.scenario(), tuple(cells))


def study_from(document: Mapping[str, Any], where: str) -> Study:
    """The study a manifest describes: its scenario and the varied keys of each cell.

    Args:
        document: with ``name``, ``scenario`` and ``cells``.
        where: the file, for messages.

    Raises:
        InputError: the scenario or a varied value is not accepted.
    """
    base = validate(document["scenario"], where)
    cells = []
    for number, varied in enumerate(document["cells"]):
        tree = base.model_dump()
        for key, value in varied.items():
            if value is not None:
                apply_setting(tree, Setting(key, value))
        cells.append(Cell(number, dict(varied), validate(tree, where)))
    return Study(document["name"], base, tuple(cells))


def of_today(tree: Mapping[str, Any]) -> dict[str, Any]:
    """A manifest's scenario, which an earlier version may have written, in the keys of this one."""
    pedestrians, model = tree.get("pedestrians"), tree.get("model")
    today = dict(tree)
    if isinstance(pedestrians, dict) and pedestrians.get("pairing") == "quantile":
        today["pedestrians"] = {k: v for k, v in pedestrians.items() if k != "pairing"}
    if isinstance(model, dict):
        # Conditions outside the model's box were clamped without asking.
        today["model"] = {"extrapolate": True, **model}
    return today


def parse_variation(text: str) -> Variation:
    """Split ``key=v1,v2,…``; values are TOML or text, ``0:1:0.1`` is a range with its end.

    Raises:
        InputError: no such form, or a range that never ends.
    """
    key, equals, raw = text.partition("=")
    where = f"--vary {text}"
    if not equals or not key.strip() or not raw.strip():
        raise InputError(where, "no key=v1,v2,…", "e.g. pedestrians.flow_per_hour=50,100,250")
    try:
        values: list[Any] = parse_toml(f"values = [{raw}]")["values"]
    except ValueError:
        values = [toml_value(part.strip()) for part in raw.split(",")]
    return key.strip(), _expand(values, where)


def _expand(values: Sequence[Any], where: str) -> list[Any]:
    """Replace ranges given as text by their numbers."""
    expanded: list[Any] = []
    for value in values:
        # TOML reads 10:50:10 as a time of day.
        text = value.isoformat() if isinstance(value, time) else value
        parts = text.split(":") if isinstance(text, str) else []
        numbers = [_decimal(part) for part in parts]
        if len(numbers) != 3 or any(number is None for number in numbers):
            expanded.append(value)
            continue
        # Decimals, so that 0:1:0.1 is 0.3 and not 0.30000000000000004.
        begin, end, step = (number for number in numbers if number is not None)
        if step == 0 or (end - begin) / step < 0 or (end - begin) / step > MAX_CELLS:
            raise InputError(where, f"range {text!r}", "begin:end:step that reaches its end")
        whole = all(number == number.to_integral_value() for number in (begin, end, step))
        for index in range(int((end - begin) / step) + 1):
            number = begin + index * step
            expanded.append(int(number) if whole else float(number))
    return expanded


def _decimal(text: str) -> Decimal | None:
    try:
        number = Decimal(text.strip())
    except InvalidOperation:
        return None
    return number if number.is_finite() and abs(number.adjusted()) < 300 else None


def _points_of_table(table: Mapping[str, Any], source: str) -> list[dict[str, Any]]:
    where = f"{source}: sweep"
    named = table.get("cells")
    if named is None:
        flat = flatten(table)
        if not flat:
            raise InputError(where, "nothing to vary", "a list of values for each key that varies")
        for key, values in flat.items():
            if not isinstance(values, list):
                raise InputError(f"{where}.{key}", f"{values!r} is no list", "a list of values")
        return _grid(
            [(key, _expand(values, f"{where}.{key}")) for key, values in flat.items()], where
        )
    if len(table) > 1:
        other = next(key for key in table if key != "cells")
        raise InputError(f"{where}.{other}", "stands beside [[sweep.cells]]", "one of the two")
    if not isinstance(named, list) or not all(isinstance(cell, dict) for cell in named):
        raise InputError(f"{where}.cells", "is no array of tables", "[[sweep.cells]]")
    if len(named) > MAX_CELLS:
        raise InputError(f"{where}.cells", f"{len(named)} cells", f"at most {MAX_CELLS}")
    if not named:
        raise InputError(f"{where}.cells", "nothing to vary", "at least one cell")
    return [flatten(cell) for cell in named]


def _grid(variations: Sequence[Variation], where: str) -> list[dict[str, Any]]:
    keys = [key for key, _ in variations]
    for key, values in variations:
        if keys.count(key) > 1:
            raise InputError(where, f"{key} varies twice", "each key once")
        if not values:
            raise InputError(f"{where} {key}", "no values", "at least one")
    # Counted before they are made: two long ranges are more than the memory holds.
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
            flat |= flatten(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def as_written(value: Any) -> str:
    """A scenario's value as a user would write it."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _value_at(tree: Mapping[str, Any], key: str) -> Any:
    """A varied key's value in a cell that does not name it; None where there is no such key."""
    probe: dict[str, Any] = {}
    apply_setting(probe, Setting(key, None))
    node: Any = tree
    while isinstance(probe, dict):
        (name,) = probe
        if not isinstance(node, Mapping) or name not in node:
            return None
        node, probe = node[name], probe[name]
    return node
