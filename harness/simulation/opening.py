"""A scenario's simulation is read and checked; what its arms share comes out."""

import hashlib
import math
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path

from harness.core.errors import InputError, nearest_name, unknown_name
from harness.encounter.arms import asks_model
from harness.engine.configuration import (
    SumoConfig,
    defined_types,
    people_come,
    read_config,
)
from harness.engine.installation import scratch_folder
from harness.model.interaction import InteractionModel, check_support
from harness.scenario import Scenario
from harness.scenario.consistency import check_perception
from harness.scenario.sections import EgoSection, SimulationSection
from harness.simulation import demand
from harness.simulation.files import run_untouched
from harness.simulation.setup import CROSSWALK, Setup
from harness.simulation.shares import sumo_seed
from harness.site.town import Crosswalk, Town
from harness.site.zone import Zones

_BASE_SEED = 23423
"""SUMO's default seed, of ``[traffic]``."""
_CAR_DECEL_MPS2 = EgoSection().max_deceleration_mps2
_FASTEST_MPS = 60.0
"""No road allows more, as for ``ego.initial_speed_mps``."""

_zones = lru_cache(1)(Zones)
"""The zones in a network; a process keeps those of the last one."""


@lru_cache(1)
def _town(net: Path, _digest: str) -> Town:
    return Town.read(net)


def opened_traffic(scenario: Scenario, pair: int, folder: Path) -> Setup:
    """The simulation of a pair of ``[traffic]``, whose files are written into a folder."""
    traffic = scenario.known_traffic
    seed = sumo_seed(scenario.experiment.seed, _BASE_SEED, pair)
    config = demand.write_demand(scenario, pair, seed, folder)
    return Setup(
        scenario=scenario,
        config=config,
        zones=_zones(_town(config.net, _digest(config.net)), scenario.experiment.step_s),
        crosswalks=(CROSSWALK,),
        av_share=traffic.av_share,
        av_types=frozenset((demand.CAR,)),
        begin_s=traffic.warm_up_s,
        end_s=traffic.warm_up_s + traffic.duration_s,
    )


def town_of(file: Path, step_s: float | None = None) -> tuple[SumoConfig, Town]:
    """A SUMO configuration and its network.

    Args:
        file: the configuration.
        step_s: another step; None keeps the configuration's.

    Raises:
        InputError: it is refused.
    """
    config = read_config(file, step_s)
    return config, _town(config.net, _digest(config.net))


def opened(scenario: Scenario) -> Setup:
    """The simulation of a scenario with ``[simulation]``.

    Raises:
        InputError: the configuration, a crosswalk, or a key that does not fit it is refused.
    """
    simulation = scenario.known_simulation
    config, town = town_of(Path(simulation.file), simulation.step_s)
    crosswalks = tuple(dict.fromkeys(simulation.crossings))
    experiment = scenario.experiment.model_copy(update={"step_s": config.step_s})
    scenario = scenario.model_copy(update={"experiment": experiment})
    check_perception(scenario)
    _check_people(scenario, config)
    _check_types(simulation.av_types, config)
    for name in crosswalks:
        _check_crosswalk(name, town, scenario.ego.trigger_range_m)
    begin_s, end_s = _counted_s(simulation, config)
    return Setup(
        scenario=scenario,
        config=config,
        zones=_zones(town, config.step_s, crosswalks),
        crosswalks=crosswalks,
        av_share=simulation.av_share,
        av_types=frozenset(simulation.av_types),
        begin_s=begin_s,
        end_s=end_s,
    )


def check_roads(setup: Setup, model: InteractionModel) -> None:
    """Refuse limits before the chosen crosswalks that lie outside the data of a model in use.

    Raises:
        InputError: names the crosswalk.
    """
    scenario, town = setup.scenario, setup.town
    checked = asks_model(scenario) and not scenario.model.extrapolate
    for name in setup.crosswalks if checked else ():
        where = f"the limit before {name} (simulation.crossings)"
        for limit_mps in town.limits_mps(name):
            check_support(model, scenario.ego.trigger_range_m, limit_mps, where)


def check_demand(config: SumoConfig) -> None:
    """Refuse a configuration with a route that SUMO cannot build.

    Raises:
        InputError: SUMO does not begin with all routes loaded.
    """
    with scratch_folder() as scratch:
        now = {"route-steps": "0", "end": f"{config.begin_s + config.step_s:.3f}"}
        run_untouched(config, Path(scratch), now)


def digests(config: SumoConfig) -> Mapping[str, str]:
    """The hashes of a configuration's files, by their paths."""
    return {str(file): _digest(file) for file in config.inputs}


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def chosen(town: Town, name: str, where: str) -> Crosswalk:
    """The crosswalk that an option or a key names.

    Raises:
        InputError: it is not there, or not usable.
    """
    allowed = "a crosswalk that `harness crossings` lists as usable"
    crosswalk = town.crosswalks.get(name)
    if crosswalk is None:
        near = nearest_name(name, town.crosswalks)
        raise InputError(where, f"unknown crosswalk {name!r}", allowed, near)
    if crosswalk.refused is not None:
        raise InputError(where, f"{name}: {crosswalk.refused}", allowed)
    return crosswalk


def _check_crosswalk(name: str, town: Town, range_m: float) -> None:
    where = "simulation.crossings"
    crosswalk, fastest_mps = chosen(town, name, where), town.limits_mps(name)[-1]
    if fastest_mps > _FASTEST_MPS:
        problem = f"the limit before {name} is {fastest_mps:g} m/s"
        raise InputError(where, problem, f"at most {_FASTEST_MPS:g} m/s")
    needed_m = math.ceil(fastest_mps**2 / (2 * _CAR_DECEL_MPS2) + crosswalk.width_m / 2)
    if range_m < needed_m:
        problem = f"nobody stops within {range_m:g} m from {fastest_mps:g} m/s before {name}"
        raise InputError("ego.trigger_range_m", problem, f"at least {needed_m:g} m")


def _check_people(scenario: Scenario, config: SumoConfig) -> None:
    flow = scenario.pedestrians.anyone_comes
    if flow and config.end_s is None and scenario.known_simulation.end is None:
        problem = "is not given, nor an end in the configuration: people would come for ever"
        raise InputError("simulation.end", problem, "a time, with pedestrians.flow_per_hour")
    if not flow and not people_come(config):
        allowed = "people in its files, or pedestrians.flow_per_hour"
        raise InputError(str(config.path), "nobody comes on foot", allowed)


def _counted_s(simulation: SimulationSection, config: SumoConfig) -> tuple[float, float]:
    """Begin and end of the counted time; the end may be infinite."""
    first_s, last_s = config.begin_s, math.inf if config.end_s is None else config.end_s
    begin_s = first_s if simulation.begin is None else simulation.begin
    end_s = last_s if simulation.end is None else simulation.end
    for key, time_s, right in (
        ("begin", begin_s, first_s <= begin_s < last_s),
        ("end", end_s, begin_s < end_s <= last_s),
    ):
        if not right:
            allowed = f"begin < end, within {first_s:g} to {last_s:g} s"
            raise InputError(f"simulation.{key}", f"{time_s:g} s", allowed)
    return begin_s, end_s


def _check_types(names: Iterable[str], config: SumoConfig) -> None:
    """Refuse a name that is neither the class nor the id of a vehicle type."""
    missing, known = set(names), set[str]()
    for name in defined_types(config):
        known.add(name)
        missing.discard(name)
        if not missing:
            return
    raise unknown_name("simulation.av_types", "vehicle type or class", min(missing), known)
