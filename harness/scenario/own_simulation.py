"""``[simulation]``: a user's own SUMO scenario defines the step, the vehicles and the people."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from harness.core.errors import InputError, nearest_name
from harness.scenario.scenario import Scenario
from harness.site.configuration import SumoConfig, people_come
from harness.site.simulation import Setting, setting_at
from harness.site.vehicle_types import types_that_come

_EGO_KEYS = ("trigger_range_m", "detection_range_m", "resume_acceleration_mps2")
"""Keys of ``[ego]`` that apply to every vehicle; vehicle types define the other properties."""

_PEOPLE_KEYS = ("flow_per_hour", "behaviour")

_SEEDS_APART = 1_000_003
"""Distance of SUMO's seeds of two successive values of ``experiment.seed``; odd, so that the values
do not repeat before all of SUMO's seeds are used."""

_SEEDS = 2**31
"""SUMO's seeds lie below this."""

_MOST_NAMES = 20
"""Greatest number of names of types that an error lists."""


def with_own_simulation(
    tree: Mapping[str, Any], scenario: Scenario, source: str
) -> Mapping[str, Any]:
    """The tree of a scenario, with the values that its SUMO configuration defines.

    A tree whose configuration has been read before (a manifest's) is unchanged and needs no file.

    Raises:
        InputError: keys exclude each other, or the configuration cannot be simulated.
    """
    if scenario.simulation is None:
        return tree
    simulation = scenario.known_simulation
    range_m = scenario.ego.trigger_range_m
    request = (simulation.config, simulation.crossings, range_m, simulation.step_s)
    read = simulation.read
    if read is not None and request == (read.config, read.named, read.range_m, read.step_s):
        return tree
    if read is None:
        _refuse(scenario, source)
    where = f"{source}: simulation"
    path = Path(simulation.config)
    setting = setting_at(path, simulation.step_s, simulation.crossings, range_m, where)
    config = setting.config
    _check_times(scenario, config, where)
    if read is None:
        _check_types(simulation.av_types, config, f"{where}.av_types")
    people = dict(tree.get("pedestrians", {}))
    people = {"flow_per_hour": 0.0, **people, "behaviour": "sumo"}
    if people["flow_per_hour"] and config.end_s is None and simulation.end is None:
        problem = "is not given, nor an end in the configuration: people would be added for ever"
        raise InputError(f"{where}.end", problem, "a time, if pedestrians.flow_per_hour is above 0")
    if not people["flow_per_hour"] and not people_come(config):
        allowed = "people in its files, or pedestrians.flow_per_hour"
        raise InputError(f"{where}.config", f"{path}: nobody comes on foot", allowed)
    words = dict(zip(("config", "named", "range_m", "step_s"), request, strict=True))
    facts = {
        # A run whose files have changed is refused when it is simulated.
        "sha256": setting.sha256 if read is None else read.sha256,
        "crossings": [crosswalk.id for crosswalk in setting.crosswalks],
        "bent": setting.bent,
        "options": dict(config.options),
    }
    return {
        **tree,
        "pedestrians": people,
        "simulation": {**dict(tree["simulation"]), "read": {**words, **facts}},
        "experiment": {**dict(tree.get("experiment", {})), "step_s": setting.step_s},
    }


def setting_of(scenario: Scenario) -> Setting:
    """The chosen crosswalks of a scenario's simulation.

    Raises:
        InputError: the configuration or a crosswalk is refused, or a file has changed since the
            scenario was read.
    """
    simulation = scenario.known_simulation
    setting = setting_at(
        Path(simulation.config),
        simulation.step_s,
        simulation.crossings,
        scenario.ego.trigger_range_m,
        "simulation",
    )
    read = simulation.read
    if read is not None and read.sha256 != setting.sha256:
        problem = f"the files of {read.config} have changed (sha256 {setting.sha256[:12]}…)"
        raise InputError("simulation.config", problem, f"the files of sha256 {read.sha256}")
    return setting


def sumo_seed(scenario: Scenario, config: SumoConfig, pair: int = 0) -> int:
    """SUMO's seed of a pair: the configuration's plus the pair's number, for seed 1.

    Another ``experiment.seed`` has other seeds for all pairs, below a million pairs.
    """
    seed = scenario.experiment.seed
    if seed == 1:
        return config.seed + pair
    return (config.seed + pair + _SEEDS_APART * (seed - 1)) % _SEEDS


def _refuse(scenario: Scenario, source: str) -> None:
    """Refuse keys that the user's own scenario defines."""
    if scenario.traffic is not None:
        problem = "cannot be combined with [simulation], whose demand is the configuration's"
        raise InputError(f"{source}: traffic", problem, "one of the two")
    if scenario.crossing.model_fields_set:
        key = sorted(scenario.crossing.model_fields_set)[0]
        problem = "cannot be combined with [simulation], whose network defines it"
        raise InputError(f"{source}: crossing.{key}", problem, "simulation.crossings")
    for key in sorted(scenario.ego.model_fields_set - {*_EGO_KEYS}):
        problem = "cannot be combined with [simulation], whose vehicle types define it"
        raise InputError(f"{source}: ego.{key}", problem, ", ".join(_EGO_KEYS))
    for key in sorted(scenario.pedestrians.model_fields_set - {*_PEOPLE_KEYS}):
        problem = "is not supported with [simulation]: SUMO moves the people"
        raise InputError(f"{source}: pedestrians.{key}", problem, ", ".join(_PEOPLE_KEYS))
    if isinstance(scenario.pedestrians.flow_per_hour, tuple):
        problem = "a list is not supported with [simulation]"
        raise InputError(f"{source}: pedestrians.flow_per_hour", problem, "one flow")
    given = scenario.pedestrians.model_fields_set
    if "behaviour" in given and scenario.pedestrians.behaviour != "sumo":
        problem = f"{scenario.pedestrians.behaviour!r} is not supported with [simulation]"
        raise InputError(f"{source}: pedestrians.behaviour", problem, "sumo")
    if own := {"step_s", "timeout_s"} & scenario.experiment.model_fields_set:
        problem = "cannot be combined with [simulation]"
        raise InputError(f"{source}: experiment.{min(own)}", problem, "simulation.step_s")


def _check_times(scenario: Scenario, config: SumoConfig, where: str) -> None:
    """Refuse a counted time that is not within the simulation's time."""
    simulation = scenario.known_simulation
    begin_s = config.begin_s if simulation.begin is None else simulation.begin
    end_s = config.end_s if simulation.end is None else simulation.end
    last_s = config.end_s
    if begin_s < config.begin_s or (last_s is not None and begin_s >= last_s):
        allowed = f"from {config.begin_s:g} s, before the simulation's end"
        raise InputError(f"{where}.begin", f"{begin_s:g} s", allowed)
    if end_s is not None and (end_s <= begin_s or (last_s is not None and end_s > last_s)):
        allowed = f"after begin = {begin_s:g} s" + (
            "" if last_s is None else f", at most {last_s:g} s"
        )
        raise InputError(f"{where}.end", f"{end_s:g} s", allowed)


def _check_types(names: Iterable[str], config: SumoConfig, where: str) -> None:
    """Refuse a name that is neither the class nor the type of a vehicle that comes."""
    missing, types, classes = set(names), set[str](), set[str]()
    for type_id, vehicle_class in types_that_come(config):
        types.add(type_id)
        classes.add(vehicle_class)
        missing -= {type_id, vehicle_class}
        if not missing:
            return
    name = min(missing)
    listed = sorted(classes) + sorted(types - classes)[:_MOST_NAMES]
    allowed = f"a class or a type that comes: {', '.join(listed) or 'there is none'}"
    nearest = nearest_name(name, classes | types)
    raise InputError(where, f"no vehicle of {name!r} comes", allowed, nearest)
