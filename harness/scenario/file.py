"""Scenario files: TOML in, a checked ``Scenario`` out.

Every key has a default and unknown keys are refused, so a file holds only what differs from the
defaults.  Users name a key by its dotted path (``pedestrians.flow_per_hour``).
"""

import copy
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
from pydantic import ValidationError

from harness.core.documents import parse_toml, shortened
from harness.core.errors import InputError, nearest_name, unknown_name
from harness.core.resources import shipped_directory
from harness.scenario.consistency import check_consistency, check_time_out
from harness.scenario.scenario import Scenario
from harness.scenario.sections import ConflictsSection
from harness.scenario.units import in_si, unit_of


class Setting(NamedTuple):
    """A dotted key, its value, and the name of its option in messages."""

    key: str
    value: Any
    source: str = "--set"


@dataclass(frozen=True)
class ScenarioFile:
    """A scenario file as read: it is valid TOML, but its keys have not been checked.

    ``sweep`` is its ``[sweep]`` table, or None.  Relative paths are relative to the file's folder.
    """

    name: str
    source: str
    tree: dict[str, Any]
    sweep: dict[str, Any] | None
    settings: tuple[Setting, ...]
    folder: Path

    def scenario(self, more: Sequence[Setting] = ()) -> Scenario:
        """The checked scenario with all settings applied; later settings replace earlier ones.

        Raises:
            InputError: a key or value is not accepted.
        """
        tree = copy.deepcopy(self.tree)
        sources = {}
        for setting in (*self.settings, *more):
            apply_setting(tree, setting)
            if setting.key in ("model.path", "simulation.file"):
                # An option's path is relative to the shell's folder, a file's to the file's.
                in_file = setting.source.startswith(f"{self.source}:")
                _anchor_paths(tree, self.folder if in_file else Path.cwd())
            sources[setting.key] = setting.source
        scenario = validate(tree, self.source, sources)
        check_time_out(scenario, sources.get("experiment.timeout_s", f"{self.source}:"))
        return scenario


Settings = Sequence[Setting] | Mapping[str, Any]
"""Settings from the command line, or a dictionary of values by dotted key."""


def read_scenario_file(name_or_path: str | Path, settings: Settings = ()) -> ScenarioFile:
    """Read a scenario file, or a shipped scenario by its name (``cctc``).

    Args:
        name_or_path: a TOML file, or the name of a shipped scenario.
        settings: values that replace the file's, e.g. ``{"experiment.pairs": 20}``.

    Raises:
        InputError: the file does not exist or is not TOML.
    """
    path = _find(name_or_path)
    try:
        tree = parse_toml(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(str(path), f"not a TOML file ({error})") from None
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({error.strerror})") from None
    if not path.stem.isprintable():
        raise InputError(str(path), "has an unprintable name", "a file name that can be printed")
    _anchor_paths(tree, path.parent)
    sweep = tree.pop("sweep", None)
    if sweep is not None and not isinstance(sweep, dict):
        raise InputError(f"{path.name}: sweep", f"{shortened(sweep)} is not accepted", "a table")
    if isinstance(settings, Mapping):
        settings = [Setting(key, value, "settings") for key, value in settings.items()]
    return ScenarioFile(path.stem, path.name, tree, sweep, tuple(settings), path.parent)


def load_scenario(name_or_path: str | Path, settings: Settings = ()) -> Scenario:
    """The scenario of a file without its sweep, checked; see ``read_scenario_file``."""
    return read_scenario_file(name_or_path, settings).scenario()


def scenario_of_encounters(
    scenario: Scenario | str | Path, settings: Mapping[str, Any] | None
) -> Scenario:
    """The scenario of a Python caller, who may give it as an object, a name or a file.

    Raises:
        InputError: the scenario or a setting is refused, or it has ``[traffic]``.
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario, settings or {})
    elif settings:
        problem = "cannot be combined with a Scenario"
        raise InputError("settings", problem, "a name or file, or no settings")
    if scenario.traffic is not None:
        raise InputError("scenario", "has a [traffic] table", "a scenario without [traffic]")
    return scenario


def parse_setting(text: str) -> Setting:
    """Split ``key=value``; a value that is not valid TOML is a string."""
    key, equals, raw = text.partition("=")
    key = key.strip()
    if not equals or not key:
        allowed = "key=value, e.g. pedestrians.flow_per_hour=250"
        raise InputError(f"--set {text}", "not of the form key=value", allowed)
    return Setting(key, toml_value(raw))


def toml_value(text: str) -> Any:
    """The value of an option's text: parsed as TOML, or the text itself if it is not TOML."""
    try:
        return parse_toml(f"value = {text}")["value"]
    except ValueError:
        return text.strip()


def validate(
    tree: Mapping[str, Any], source: str, key_sources: Mapping[str, str] | None = None
) -> Scenario:
    """Check a tree of keys and values; the first mistake becomes an ``InputError``.

    Args:
        tree: nested tables as read from TOML.
        source: name of the file in messages.
        key_sources: name of the source of every key that is not from the file (``--set``).
    """
    try:
        whole = in_si(dict(tree), source, key_sources or {})
        scenario = Scenario.model_validate(whole)
        if scenario.simulation is not None:
            # SUMO's people come; the harness's do if a flow is given.
            people = {"flow_per_hour": 0.0, **whole.get("pedestrians", {})}
            scenario = Scenario.model_validate({**whole, "pedestrians": people})
        check_consistency(scenario, source)
    except ValidationError as error:
        raise _explain(error, source, key_sources or {}) from None
    except InputError as error:
        key = error.where.removeprefix(f"{source}: ")
        named = _set_by(key, key_sources or {})
        if named is None:
            raise
        where = f"{(key_sources or {})[named]} {key}"
        raise InputError(where, error.problem, error.allowed, error.nearest) from None
    return scenario


def _set_by(key: str, key_sources: Mapping[str, str]) -> str | None:
    """The setting of a key, or of the array that contains it; None if no setting gave it."""
    return next((full for full in key_sources if f"{key}.".startswith(f"{full}.")), None)


def _find(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    try:
        is_file, is_folder = path.is_file(), path.is_dir()
    except (OSError, ValueError) as error:
        raise InputError(str(path), f"not a usable path ({error})", "a scenario file") from None
    if is_file:
        return path
    folder = shipped_directory("scenarios")
    shipped = sorted(file.stem for file in folder.glob("*.toml"))
    if str(name_or_path) in shipped:
        return folder / f"{name_or_path}.toml"
    if is_folder:
        raise InputError(str(path), "is a folder", "a scenario file (TOML)")
    raise InputError(
        str(path),
        "no such scenario file",
        f"a TOML file, or a shipped scenario: {', '.join(shipped)}",
        nearest_name(path.stem, shipped),
    )


def _anchor_paths(tree: dict[str, Any], folder: Path) -> None:
    for name, key in (("model", "path"), ("simulation", "file")):
        section = tree.get(name)
        if isinstance(section, dict) and isinstance(section.get(key), str):
            section[key] = os.path.normpath(folder.absolute() / section[key])


def apply_setting(tree: dict[str, Any], setting: Setting) -> None:
    """Set one dotted key of a nested table; missing tables are added.

    Raises:
        InputError: the key is not a dotted key (in TOML's syntax, parts may be quoted), or one of
            its parts is a value and not a table.
    """
    key = setting.key
    try:
        # TOML's own key syntax, so that quoted parts may contain dots and colons.
        branch = parse_toml(f"{key} = 0")
    except ValueError:
        branch = {}
    # Comments and texts of several lines are refused, although they are valid TOML.
    if len(branch) != 1 or "\n" in key:
        raise InputError(
            f"{setting.source} {key}", "not a dotted key", _how_written(setting)
        ) from None
    node = tree
    while True:
        (name,) = branch
        if not isinstance(branch[name], dict):
            node[name] = as_plain(setting.value)
            return
        branch = branch[name]
        if node.get(name) is None:  # an absent optional table is null in a manifest
            node[name] = {}
        if not isinstance(node[name], dict):
            raise InputError(f"{setting.source} {key}", f"{name!r} is not a table")
        node = node[name]


def as_plain(value: Any) -> Any:
    """A value with NumPy's numbers and arrays converted to Python's numbers and lists."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [as_plain(part) for part in value]
    if isinstance(value, Mapping):
        return {key: as_plain(part) for key, part in value.items()}
    return value


def _how_written(setting: Setting) -> str:
    """The correct form of a key that lacks quotes; on a command line the shell may remove them."""
    table, _, parameter = setting.key.rpartition(".")
    name = table.removeprefix("strategies.")
    if name == table or '"' in name or "'" in name:
        return "e.g. ego.initial_speed_mps"
    quoted = f'strategies."{name}".{parameter}'
    if not setting.source.startswith("--"):
        return f"quotes around the name: {quoted}"
    return f"quotes that the shell keeps: '{quoted}=…'"


_TOML_WORDS = {
    "model_type": "a table",
    "dict_type": "a table",
    "tuple_type": "an array",
    "bool_type": "true or false",
    "float_type": "a number",
}
"""TOML's names for types that pydantic calls by Python's names."""

_NUMBER, _NUMBERS = "constrained-float", "tuple[constrained-float, ...]"
"""A key may be a number or a list of numbers; pydantic reports an error for each of the two."""


_BARE = re.compile(r"[\w-]+")
"""A part of a key that needs no quotes in TOML."""


def _explain(error: ValidationError, source: str, key_sources: Mapping[str, str]) -> InputError:
    first, *others = error.errors(include_url=False)
    if _NUMBER in first["loc"] and isinstance(first["input"], list | tuple):
        first = others[0]
    path = [str(part) for part in first["loc"] if part not in (_NUMBER, _NUMBERS)]
    if path[:1] == ["strategies"]:
        path = path[:3]  # the rest is the type of a parameter's value
    key = ".".join(part if _BARE.fullmatch(part) else f'"{part}"' for part in path)
    # A misspelt table is reported at the option that set one of its keys.
    named = [full for full in key_sources if full.startswith(f"{key}.")]
    by = _set_by(key, key_sources)
    where = f"{source}: {key}"
    if by is not None:
        where = f"{key_sources[by]} {key}"
    elif named:
        where = f"{key_sources[named[-1]]} {named[-1]}"
    if first["type"] == "extra_forbidden":
        return unknown_name(where, "key", path[-1], _keys_of(path[:-1]))
    message = first["msg"].removeprefix("Input should be ")
    allowed = _TOML_WORDS.get(first["type"], message[0].lower() + message[1:])
    if first["type"] == "float_type" and (named_unit := unit_of(path[-1])) is not None:
        allowed += f", in {named_unit[1]}"
    return InputError(where, f"{shortened(first['input'])} is not accepted", allowed)


def _keys_of(path: list[str]) -> list[str]:
    section: Any = Scenario
    for name in path:
        if not name.isdecimal():  # a number is an index into an array of tables
            annotation: Any = section.model_fields[name].annotation
            # An optional table is a union with None.
            section = next(iter(get_args(annotation)), annotation)
    return list(section.model_fields)


def set_thresholds(settings: Sequence[Setting], source: str) -> ConflictsSection:
    """The conflict thresholds with some of them set (``conflicts.…``).

    Raises:
        InputError: a setting is not a threshold, or its value is not allowed.
    """
    thresholds = [f"conflicts.{name}" for name in ConflictsSection.model_fields]
    tree: dict[str, Any] = {}
    sources = {setting.key: setting.source for setting in settings}
    for setting in settings:
        if setting.key not in thresholds:
            nearest = nearest_name(setting.key, thresholds)
            problem = "is not a conflict threshold"
            where = f"{setting.source} {setting.key}"
            raise InputError(where, problem, ", ".join(thresholds), nearest)
        apply_setting(tree, setting)
    return validate(tree, source, sources).conflicts
