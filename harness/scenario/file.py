"""Scenario files: TOML in, a ``Scenario`` out whose keys are checked, alone and together.

Every key has a default and unknown keys are refused, so a file holds only what differs from the
defaults.  Users name a key by its dotted path (``pedestrians.flow_per_hour``).
"""

import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from harness.core.documents import as_plain, check_form, parse_toml
from harness.core.errors import InputError, Parameter, Place, brief, checked, inside, nearest_name
from harness.core.files import read_file, shipped_directory
from harness.core.freezing import Frozen, frozen
from harness.core.vocabulary import SECONDS_PER_HOUR
from harness.scenario.consistency import check_consistency, check_effects
from harness.scenario.scenario import Scenario

UNITS = MappingProxyType(
    {
        "m/s": (1.0, 1.0),
        "km/h": (1000.0, SECONDS_PER_HOUR),
        "mph": (1609.344, SECONDS_PER_HOUR),
        "ft/s": (0.3048, 1.0),
    }
)
"""Units of speed as (metres, seconds); they are exact by definition."""

_PATHS = (("model", "path"), ("simulation", "file"))
"""The keys whose values are paths, as table and key."""

_SPEED = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S+)\s*")
"""The text of a speed: a number and a unit."""


class Setting(NamedTuple):
    """A dotted key, its value, and where it is given, for messages."""

    key: str
    value: Any
    source: Place = Parameter("settings")


@dataclass(frozen=True)
class ScenarioFile(Frozen):
    """A scenario file as read: it is valid TOML, but its keys have not been checked.

    ``sweep`` is its ``[sweep]`` table, or the values by dotted key of each cell, or None.  Relative
    paths are relative to the file's folder.
    """

    name: str
    source: str
    tree: Mapping[str, Any]
    sweep: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None
    settings: tuple[Setting, ...]
    folder: Path

    def scenario(self) -> Scenario:
        """The scenario with all settings applied; each key that is set has an effect.

        Raises:
            InputError: a key or value is not accepted, or a key has no effect.
        """
        scenario = self.cell()
        with self.located():
            check_effects([scenario])
        return scenario

    @contextmanager
    def located(self, more: Sequence[Setting] = ()) -> Iterator[None]:
        """Put the file or setting before the key at which ``InputError`` is raised in the block.

        Args:
            more: settings besides the file's.
        """
        try:
            yield
        except InputError as error:
            key, sources = error.where, {each.key: each.source for each in (*self.settings, *more)}
            # The setting of the key, or of an array that contains it, or of a key of the table.
            over = [full for full in sources if f"{key}.".startswith(f"{full}.")]
            named = over or [full for full in sources if full.startswith(f"{key}.")]
            if not named:
                raise error.at(f"{self.source}: {key}") from None
            raise error.at(inside(sources[named[-1]], key if over else named[-1])) from None

    def cell(self, more: Sequence[Setting] = ()) -> Scenario:
        """The scenario with all settings applied; later settings replace earlier ones.

        It is one of a study's: keys without effect are refused for all of them together.

        Raises:
            InputError: a key or value is not accepted.
        """
        tree = as_plain(self.tree)
        for setting in (*self.settings, *more):
            apply_setting(tree, setting)
            if tuple(parts_of(setting)) in _PATHS:
                # An option's path is relative to the shell's folder, a file's to the file's.
                in_file = str(setting.source).startswith(f"{self.source}:")
                _anchor_paths(tree, self.folder if in_file else Path.cwd())
        with self.located(more):
            scenario = check_form(Scenario, _in_si(tree), "")
            check_consistency(scenario)
        return scenario


Settings = Sequence[Setting] | Mapping[str, Any]
"""Settings from the command line, or a dictionary of values by dotted key."""


def as_settings(settings: Settings, **experiment: int | None) -> tuple[Setting, ...]:
    """Settings in the order of application.

    Args:
        settings: the settings.
        experiment: the last ones: keys of ``[experiment]`` that are parameters of their own.
    """
    if isinstance(settings, Mapping):
        settings = [Setting(key, value) for key, value in settings.items()]
    own = [Setting(f"experiment.{key}", each, Parameter(key)) for key, each in experiment.items()]
    return *settings, *(setting for setting in own if setting.value is not None)


@checked
def read_scenario_file(scenario: Scenario | str | Path, settings: Settings = ()) -> ScenarioFile:
    """Read a scenario file, or a shipped scenario by its name (``cctc``).

    Args:
        scenario: a TOML file, the name of a shipped scenario, or a scenario, as if a file had it.
        settings: values that replace the file's, e.g. ``{"experiment.pairs": 20}``.

    Returns:
        The file's content, not yet checked; ``study_of`` and ``ScenarioFile.scenario`` check it.

    Raises:
        InputError: the file does not exist or is not TOML.
    """
    given = tuple(each._replace(value=frozen(each.value)) for each in as_settings(settings))
    if isinstance(scenario, Scenario):
        return ScenarioFile("scenario", "scenario", scenario.model_dump(), None, given, Path.cwd())
    shipped = sorted(shipped_directory("scenarios").glob("*.toml"))
    known = {file.stem: file for file in shipped}
    path = Path(scenario)
    if path.name in known and str(path) == path.name and not path.is_file():
        path = known[path.name]
    try:
        tree = parse_toml(read_file(path).decode())
    except InputError as error:
        allowed = f"a TOML file, or a shipped scenario: {', '.join(known)}"
        near = nearest_name(path.stem, known)
        raise InputError(error.where, error.problem, allowed, near) from None
    except ValueError as error:
        raise InputError(str(path), f"not a TOML file ({error})") from None
    if not path.stem.isprintable():
        raise InputError(str(path), "has an unprintable name", "a file name that can be printed")
    _anchor_paths(tree, path.parent)
    sweep = tree.pop("sweep", None)
    if sweep is not None and not isinstance(sweep, dict):
        raise InputError(f"{path.name}: sweep", f"{brief(sweep)} is not accepted", "a table")
    return ScenarioFile(path.stem, path.name, tree, sweep, given, path.parent)


@checked
def load_scenario(scenario: Scenario | str | Path, settings: Settings = ()) -> Scenario:
    """The scenario of a file, without its sweep: each key is checked, and so are all together.

    Names and parameters of strategies and models are checked where they are loaded: when a run,
    risk or environment begins.

    Args:
        scenario: a TOML file, the name of a shipped scenario, or a scenario made in Python.
        settings: values that replace the file's, e.g. ``{"experiment.pairs": 20}``.

    Raises:
        InputError: the file does not exist or is not TOML, or a key or value is not accepted.
    """
    return read_scenario_file(scenario, settings).scenario()


def parse_setting(text: str) -> Setting:
    """Split ``key=value``; a value that is not valid TOML is a string."""
    key, equals, raw = text.partition("=")
    key = key.strip()
    if not equals or not key:
        allowed = "key=value, e.g. pedestrians.flow_per_hour=250"
        raise InputError(Parameter("settings", text), "not of the form key=value", allowed)
    return Setting(key, toml_value(raw))


def toml_value(text: str) -> Any:
    """The value of an option's text: parsed as TOML, or the text itself if it is not TOML."""
    try:
        return parse_toml(f"value = {text}")["value"]
    except ValueError:
        return text.strip()


def validate(tree: Mapping[str, Any], source: str) -> Scenario:
    """Check a tree of keys and values; the first mistake becomes an ``InputError``.

    Args:
        tree: nested tables as read from TOML.
        source: name of the file in messages.
    """
    return ScenarioFile("", source, tree, None, (), Path()).cell()


def parts_of(setting: Setting) -> list[str]:
    """The parts of a setting's dotted key.

    Raises:
        InputError: it is not a dotted key in TOML's syntax, in which parts may be quoted.
    """
    try:
        # TOML's own syntax, so that quoted parts may contain dots and colons.
        node: Any = parse_toml(f"{setting.key} = 0")
    except ValueError:
        node = {}
    # Comments and texts of several lines are refused, although they are valid TOML.
    if len(node) != 1 or "\n" in str(setting.key):
        allowed = 'e.g. ego.length_m, or strategies."my_module:Mine".margin_s with the quotes'
        raise InputError(inside(setting.source, setting.key), "not a dotted key", allowed)
    parts = []
    while isinstance(node, dict):
        ((name, node),) = node.items()
        parts.append(name)
    return parts


def apply_setting(tree: dict[str, Any], setting: Setting) -> None:
    """Set one dotted key of a nested table; missing tables are added.

    Raises:
        InputError: the key is not a dotted key, or one of its parts is a value and not a table.
    """
    *tables, last = parts_of(setting)
    for name in tables:
        if tree.get(name) is None:  # an absent optional table is null in a manifest
            tree[name] = {}
        tree = tree[name]
        if not isinstance(tree, dict):
            raise InputError(inside(setting.source, setting.key), f"{name!r} is not a table")
    tree[last] = as_plain(setting.value)


def _anchor_paths(tree: dict[str, Any], folder: Path) -> None:
    for name, key in _PATHS:
        section = tree.get(name)
        if isinstance(section, dict) and isinstance(section.get(key), str):
            section[key] = os.path.normpath(folder.absolute() / section[key])


def _in_si(value: Any, key: str = "") -> Any:
    """A tree of keys and values in which every speed with a unit is a number in m/s.

    Args:
        value: the tree, or a value in it.
        key: the dotted key of ``value``.

    Raises:
        InputError: the text of a key that ends in ``_mps`` is not a speed.
    """
    if isinstance(value, dict | list):
        named = value.items() if isinstance(value, dict) else enumerate(value)
        parts = {name: _in_si(part, f"{key}.{name}".lstrip(".")) for name, part in named}
        return parts if isinstance(value, dict) else [*parts.values()]
    if not (isinstance(value, str) and key.endswith("_mps")):
        return value
    written = _SPEED.fullmatch(value)
    if written is not None and written[2] in UNITS:
        metres, seconds = UNITS[written[2]]
        if math.isfinite(speed := float(written[1]) * metres / seconds):
            return speed
    allowed = f"a number in m/s, or text with a unit: {', '.join(UNITS)}"
    raise InputError(key, f"{brief(value)} is not accepted", allowed)
