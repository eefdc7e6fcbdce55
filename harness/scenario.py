"""Scenario files: TOML in, a frozen and fully checked ``Scenario`` out.

Every key has a default and unknown keys are refused, so a scenario file says only what differs.
Keys are dotted paths (``pedestrians.flow_per_hour``) wherever a user names one.
"""

import copy
import difflib
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from harness.encounter import PEDESTRIAN_RADIUS_M, Behaviour, Crossing, Leg, Side, Vehicle
from harness.errors import InputError, unknown_name
from harness.resources import shipped_directory
from harness.walking import timed_path

MAX_TRIGGER_RANGE_M = 300.0
"""Longest range at which the ego can be inserted: the networks' approach road ends beyond it."""

MAX_BEFORE_KERB_M = 8.0
"""How far before his kerb a timed pedestrian may start: a footpath is 10 m long."""

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class CrossingSection(_Section):
    """``[crossing]``: the place and shape of the crosswalk."""

    latitude_deg: Annotated[float, Field(ge=-80, le=84)] = 42.278415
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] = -83.735580
    bearing_deg: Annotated[float, Field(ge=0, lt=360)] = 316.5
    length_m: Annotated[float, Field(ge=4, le=40)] = 9.0
    width_m: Annotated[float, Field(ge=1, le=20)] = 4.0
    pedestrian_priority: bool = True


class EgoSection(_Section):
    """``[ego]``: the vehicle, the same in both arms."""

    initial_speed_mps: Annotated[float, Field(gt=0, le=60)] = 5.0
    trigger_range_m: Annotated[float, Field(gt=0, le=MAX_TRIGGER_RANGE_M)] = 30.0
    detection_range_m: Positive | None = None
    length_m: Annotated[float, Field(ge=1, le=25)] = 5.0
    width_m: Annotated[float, Field(ge=0.5, le=5)] = 1.8
    max_acceleration_mps2: Annotated[float, Field(gt=0, le=20)] = 3.0
    max_deceleration_mps2: Annotated[float, Field(gt=0, le=20)] = 4.5
    resume_acceleration_mps2: Annotated[float, Field(gt=0, le=20)] = 1.0


class TimedSection(_Section):
    """``[[pedestrians.timed]]``: someone whom a car that never brakes would hit."""

    name: str = ""
    side: Literal["near", "far"]
    start_lateral_m: Positive
    acceleration_distance_m: NonNegative = 0.0
    speed_mps: Annotated[float, Field(gt=0, le=10)]
    impact_share: Share


class GapAcceptanceSection(_Section):
    """``[pedestrians.gap_acceptance]``: the distribution of critical gaps."""

    distribution: Literal["lognormal", "logistic"] = "lognormal"
    mean_s: Positive = 4.0
    std_s: NonNegative = 2.5


class PedestriansSection(_Section):
    """``[pedestrians]``: who comes, from where, how they decide and walk."""

    flow_per_hour: Annotated[float, Field(ge=0, le=100_000)] = 250.0
    max_count: Annotated[int, Field(ge=0)] | None = None
    first_at_trigger: bool = False
    near_side_share: Share = 0.5
    kerb_wait_s: NonNegative = 2.0
    pairing: Literal["quantile", "speed"] = "quantile"
    behaviour: Behaviour = "constant"
    gap_acceptance: GapAcceptanceSection = GapAcceptanceSection()
    timed: Annotated[tuple[TimedSection, ...], Field(strict=False)] = ()
    timed_case: str | None = None


class ModelSection(_Section):
    """``[model]``: the interaction model, a shipped one by ``name`` or a file by ``path``."""

    name: str = "dut"
    path: str | None = None
    pedestrian_reading: Literal["marginal", "curve"] = "marginal"


class ArmsSection(_Section):
    """``[arms]``: which strategy drives in each arm."""

    av: str = "soft_yield"
    human: str = "human_gmm"


class ConflictsSection(_Section):
    """``[conflicts]``: thresholds of the measures beyond which an episode counts as a conflict."""

    ttc_s: NonNegative = 1.5
    time_advantage_s: NonNegative = 1.5
    pet_s: NonNegative = 1.5
    drac_mps2: NonNegative = 3.35


class ExperimentSection(_Section):
    """``[experiment]``: how many pairs, from which seed, at which step."""

    pairs: Annotated[int, Field(ge=1, le=10_000_000)] = 50
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1
    step_s: Annotated[float, Field(ge=0.001, le=1)] = 0.1
    timeout_s: Annotated[float, Field(gt=0, le=3600)] = 60.0


class LimitsSection(_Section):
    """``[limits]``: below which a strategy is allowed; for comparing, no part of a simulation."""

    mu0: Positive | None = None
    kappa0: Annotated[float, Field(gt=0, le=1)] | None = None


class Scenario(_Section):
    """One experiment, complete: what a run of it needs and nothing else."""

    crossing: CrossingSection = CrossingSection()
    ego: EgoSection = EgoSection()
    pedestrians: PedestriansSection = PedestriansSection()
    model: ModelSection = ModelSection()
    arms: ArmsSection = ArmsSection()
    strategies: dict[str, dict[str, Any]] = Field(default_factory=dict)
    conflicts: ConflictsSection = ConflictsSection()
    experiment: ExperimentSection = ExperimentSection()
    limits: LimitsSection = LimitsSection()

    def vehicle(self) -> Vehicle:
        """The ego's constants; the detection range defaults to the trigger range."""
        values = self.ego.model_dump()
        if values["detection_range_m"] is None:
            values["detection_range_m"] = values["trigger_range_m"]
        return Vehicle(**values)

    def crosswalk(self) -> Crossing:
        """The crosswalk's constants."""
        return Crossing(self.crossing.length_m, self.crossing.width_m)

    def timed_walks(self) -> tuple[tuple[Side, tuple[Leg, ...]], ...]:
        """Side and path of every timed pedestrian of the case, or of all where none is named."""
        case = self.pedestrians.timed_case
        return tuple(
            (Side(timed.side), _path_of(timed, self))
            for timed in self.pedestrians.timed
            if case is None or timed.name == case
        )


class Setting(NamedTuple):
    """A dotted key with the value it gets, and the option to name in messages about it."""

    key: str
    value: Any
    source: str = "--set"


@dataclass(frozen=True)
class ScenarioFile:
    """A scenario file as read: nothing checked yet but that it is TOML.

    ``sweep`` is its ``[sweep]`` table, None where there is none.  A relative ``model.path`` has
    been taken from the file's folder.
    """

    name: str
    source: str
    tree: dict[str, Any]
    sweep: dict[str, Any] | None
    settings: tuple[Setting, ...]
    folder: Path

    def scenario(self, more: Sequence[Setting] = ()) -> Scenario:
        """The checked scenario with all settings applied, later ones over earlier ones.

        Raises:
            InputError: a key or value is not accepted.
        """
        tree = copy.deepcopy(self.tree)
        sources = {}
        for setting in (*self.settings, *more):
            apply_setting(tree, setting)
            if setting.key == "model.path":
                # An option's path is the shell's, a path in the file is the file's.
                on_shell = setting.source.startswith("--")
                _anchor_model_path(tree, Path.cwd() if on_shell else self.folder)
            sources[setting.key] = setting.source
        return validate(tree, self.source, sources)


def read_scenario_file(name_or_path: str | Path, settings: Sequence[Setting] = ()) -> ScenarioFile:
    """Read a scenario file, or a shipped scenario by its name (``cctc``).

    Args:
        name_or_path: a TOML file, or the name of a shipped scenario.
        settings: to be applied over the file's values.

    Raises:
        InputError: the file is missing or no TOML.
    """
    path = _find(name_or_path)
    try:
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(str(path), f"not a TOML file ({error})") from None
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({error.strerror})") from None
    _anchor_model_path(tree, path.parent)
    sweep = tree.pop("sweep", None)
    if sweep is not None and not isinstance(sweep, dict):
        raise InputError(f"{path.name}: sweep", f"{_shorten(sweep)} is not accepted", "a table")
    return ScenarioFile(path.stem, path.name, tree, sweep, tuple(settings), path.parent)


def load_scenario(name_or_path: str | Path, settings: Sequence[Setting] = ()) -> Scenario:
    """The scenario of a file without its sweep, checked; see ``read_scenario_file``."""
    return read_scenario_file(name_or_path, settings).scenario()


def parse_setting(text: str) -> Setting:
    """Split ``key=value``; the value is read as TOML, and as a string where it is none."""
    key, equals, raw = text.partition("=")
    key = key.strip()
    if not equals or not key:
        raise InputError(f"--set {text}", "no key=value", "e.g. pedestrians.flow_per_hour=250")
    try:
        return Setting(key, tomllib.loads(f"value = {raw}")["value"])
    except tomllib.TOMLDecodeError:
        return Setting(key, raw.strip())


def validate(
    tree: Mapping[str, Any], source: str, key_sources: Mapping[str, str] | None = None
) -> Scenario:
    """Check a tree of keys and values; the first thing wrong becomes an ``InputError``.

    Args:
        tree: nested tables as read from TOML.
        source: what to call the file in messages.
        key_sources: for keys that came from elsewhere (``--set``), where from.
    """
    try:
        scenario = Scenario.model_validate(tree)
    except ValidationError as error:
        raise _explain(error, source, key_sources or {}) from None
    _check_consistency(scenario, source)
    return scenario


def _find(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    try:
        is_file, is_folder = path.is_file(), path.is_dir()
    except (OSError, ValueError) as error:
        raise InputError(str(path), f"is no usable path ({error})", "a scenario file") from None
    if is_file:
        return path
    folder = shipped_directory("scenarios")
    shipped = sorted(file.stem for file in folder.glob("*.toml"))
    if str(name_or_path) in shipped:
        return folder / f"{name_or_path}.toml"
    if is_folder:
        raise InputError(str(path), "is a folder", "a scenario file (TOML)")
    close = difflib.get_close_matches(path.stem, shipped, n=1)
    raise InputError(
        str(path),
        "no such scenario file",
        f"a TOML file, or a shipped scenario: {', '.join(shipped)}",
        close[0] if close else None,
    )


def _anchor_model_path(tree: dict[str, Any], folder: Path) -> None:
    model = tree.get("model")
    if isinstance(model, dict) and isinstance(model.get("path"), str):
        model["path"] = os.path.normpath(folder.absolute() / model["path"])


def apply_setting(tree: dict[str, Any], setting: Setting) -> None:
    """Set one dotted key of a nested table, making the tables on its way.

    Raises:
        InputError: not a dotted key (TOML's syntax, parts may be quoted), or it leads through a
            value that is no table.
    """
    key = setting.key
    try:
        # TOML's own key syntax, so that quoted parts may contain dots and colons.
        branch = tomllib.loads(f"{key} = 0")
    except tomllib.TOMLDecodeError:
        branch = {}
    # A remark, or several lines, is TOML too.
    if len(branch) != 1 or "\n" in key:
        raise InputError(
            f"{setting.source} {key}", "not a dotted key", "e.g. ego.initial_speed_mps"
        ) from None
    node = tree
    while True:
        (name,) = branch
        if not isinstance(branch[name], dict):
            node[name] = setting.value
            return
        branch = branch[name]
        if not isinstance(node.setdefault(name, {}), dict):
            raise InputError(f"{setting.source} {key}", f"{name!r} is not a table")
        node = node[name]


def _explain(error: ValidationError, source: str, key_sources: Mapping[str, str]) -> InputError:
    first = error.errors(include_url=False)[0]
    path = [str(part) for part in first["loc"]]
    key = ".".join(path)
    # A misspelt table is wrong in whatever option named a key of it.
    named = [full for full in key_sources if full == key or full.startswith(f"{key}.")]
    where = f"{key_sources[named[-1]]} {named[-1]}" if named else f"{source}: {key}"
    if first["type"] == "extra_forbidden":
        return unknown_name(where, "key", path[-1], _keys_of(path[:-1]))
    message = first["msg"]
    allowed = message[0].lower() + message[1:]
    return InputError(where, f"{_shorten(first['input'])} is not accepted", allowed)


def _keys_of(path: list[str]) -> list[str]:
    section: type[BaseModel] = Scenario
    for name in path:
        if name.isdecimal():  # an entry of [[pedestrians.timed]], the only array of tables
            section = TimedSection
        elif name != "timed":
            annotation = section.model_fields[name].annotation
            assert isinstance(annotation, type)
            section = annotation
    return list(section.model_fields)


def _shorten(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _check_consistency(scenario: Scenario, source: str) -> None:
    """What one key alone cannot tell."""
    ego, crossing, experiment = scenario.ego, scenario.crossing, scenario.experiment
    if ego.width_m > crossing.length_m / 2:
        raise InputError(
            f"{source}: ego.width_m",
            f"{ego.width_m:g} m does not fit the lane",
            f"at most crossing.length_m / 2 = {crossing.length_m / 2:g} m",
        )
    # SUMO's approach lane ends 1.5 m before the crosswalk: the ego cannot be inserted beyond it.
    nearest = crossing.width_m / 2 + 1.5
    if ego.trigger_range_m < nearest:
        raise InputError(
            f"{source}: ego.trigger_range_m",
            f"{ego.trigger_range_m:g} m is on the crosswalk or too near",
            f"at least crossing.width_m / 2 + 1.5 = {nearest:g} m",
        )
    _check_pedestrians(scenario, f"{source}: pedestrians")
    milliseconds = experiment.step_s * 1000
    if abs(milliseconds - round(milliseconds)) > 1e-9:
        raise InputError(
            f"{source}: experiment.step_s",
            f"{experiment.step_s!r} s",
            "whole milliseconds, SUMO's resolution",
        )
    steps = experiment.timeout_s / experiment.step_s
    if steps < 1 - 1e-9 or abs(steps - round(steps)) > 1e-6:
        raise InputError(
            f"{source}: experiment.timeout_s",
            f"{experiment.timeout_s:g} s",
            f"whole steps of experiment.step_s = {experiment.step_s:g} s",
        )


def _path_of(timed: TimedSection, scenario: Scenario) -> tuple[Leg, ...]:
    return timed_path(
        Side(timed.side),
        timed.start_lateral_m,
        timed.acceleration_distance_m,
        timed.speed_mps,
        timed.impact_share,
        scenario.vehicle(),
        scenario.crosswalk(),
    )


def _check_pedestrians(scenario: Scenario, where: str) -> None:
    pedestrians = scenario.pedestrians
    if pedestrians.pairing == "speed" and pedestrians.behaviour in ("reactive", "sumo"):
        raise InputError(
            f"{where}.pairing",
            f"'speed' with behaviour {pedestrians.behaviour!r}, who has no one speed",
            "quantile",
        )
    names = [timed.name for timed in pedestrians.timed]
    case = pedestrians.timed_case
    if case is not None and case not in names:
        raise unknown_name(f"{where}.timed_case", "case", case, names)
    for number, timed in enumerate(pedestrians.timed):
        _check_timed(timed, scenario, f"{where}.timed.{number}")


def _check_timed(timed: TimedSection, scenario: Scenario, where: str) -> None:
    """He starts on his footpath or on the road, clear of the car, and not before the trigger."""
    ego, length_m = scenario.ego, scenario.crossing.length_m
    to_kerb_m = length_m / 4 if timed.side == "near" else 3 * length_m / 4
    nearest, farthest = ego.width_m / 2 + PEDESTRIAN_RADIUS_M, to_kerb_m + MAX_BEFORE_KERB_M
    if not nearest < timed.start_lateral_m <= farthest:
        raise InputError(
            f"{where}.start_lateral_m",
            f"{timed.start_lateral_m:g} m",
            f"above {nearest:g} m, where the car would touch him, up to {farthest:g} m",
        )
    start_s = _path_of(timed, scenario)[0].time_s
    if start_s < 0:
        # Each metre of trigger range is 1/v0 of time.
        needed = ego.trigger_range_m - start_s * ego.initial_speed_mps
        raise InputError(
            f"{where}.speed_mps",
            f"he would have to start {-start_s:.3g} s before the trigger",
            f"ego.trigger_range_m of at least {needed:.4g} m, or a faster walk",
        )
