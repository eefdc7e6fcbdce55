"""A scenario's simulation is read, or drawn from ``[traffic]``; what its arms share comes out."""

import math
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np

from harness.core.errors import InputError, Place, nearest_name, unknown_name
from harness.core.seeding import stream, sumo_seed
from harness.core.vocabulary import ROUNDING, SECONDS_PER_HOUR
from harness.encounter.arms import asks_model
from harness.engine.configuration import (
    DEFAULT_SEED,
    SumoConfig,
    defined_types,
    digest_of,
    people_in,
    read_config,
)
from harness.engine.protocol import CAR
from harness.engine.sources import CROSSWALK
from harness.engine.traffic_files import Due, types_of, write_traffic
from harness.model.interaction import InteractionModel, check_support
from harness.scenario import Scenario
from harness.scenario.consistency import check_perception
from harness.scenario.sections import MAX_SPEED_MPS, SimulationSection
from harness.simulation.own_people import OWN_PREFIX
from harness.simulation.setup import Setup
from harness.site.town import Crosswalk, Town

_LEAST_CLEARING_S = 900.0
"""Time for the road to empty after the counted time, at least."""
_SATURATED = 0.9
"""In a saturated lane a vehicle is due after this share of the least headway: one always waits."""


@lru_cache(1)
def _town(net: Path, _content: str) -> Town:
    """The network of a file with this digest."""
    from harness.engine.town_reader import read_town  # slow

    return read_town(net)


def opened_traffic(scenario: Scenario, model: InteractionModel, pair: int, folder: Path) -> Setup:
    """The simulation of a pair of ``[traffic]``, whose files are written into a folder."""
    traffic = scenario.known_traffic
    counted_until_s = traffic.warm_up_s + traffic.duration_s
    clearing_s = 0.0 if traffic.saturated else max(traffic.duration_s, _LEAST_CLEARING_S)
    end_s = counted_until_s + clearing_s
    seed = sumo_seed(scenario.experiment.seed, DEFAULT_SEED, pair)
    config = write_traffic(scenario, vehicles_due(scenario, pair), seed, end_s, folder)
    simulation = SimulationSection(
        file=str(config.path),
        crossings=(CROSSWALK,),
        av_share=traffic.av_share,
        av_types=tuple(types_of(scenario)),
        begin_s=traffic.warm_up_s,
        end_s=counted_until_s,
    )
    return _setup(scenario, model, config, simulation)


def opened(scenario: Scenario, model: InteractionModel) -> Setup:
    """The simulation of a scenario with ``[simulation]``.

    Raises:
        InputError: the configuration, a crosswalk or the counted time is refused.
    """
    simulation = scenario.known_simulation
    config = read_config(Path(simulation.file), simulation.step_s)
    experiment = scenario.experiment.model_copy(update={"step_s": config.step_s})
    scenario = scenario.model_copy(update={"experiment": experiment})
    return _setup(scenario, model, config, simulation)


def _setup(
    scenario: Scenario, model: InteractionModel, config: SumoConfig, simulation: SimulationSection
) -> Setup:
    town, where = town_of(config), "simulation.crossings"
    crosswalks = {name: chosen(town, name, where) for name in simulation.crossings}
    begin_s, end_s = _counted_s(simulation, config)
    return Setup(scenario, model, config, town, crosswalks, simulation, begin_s, end_s)


def town_of(config: SumoConfig) -> Town:
    """The network of a configuration.

    Raises:
        InputError: it is refused.
    """
    return _town(config.net, digest_of(config.net))


def check(setup: Setup) -> None:
    """Refuse keys of a scenario that do not fit its configuration and roads.

    Limits before the chosen crosswalks have to lie within the data of a model in use.

    Raises:
        InputError: names the key, or the configuration.
    """
    scenario, config = setup.scenario, setup.config
    check_perception(scenario)
    asks = asks_model(scenario) and not scenario.model.extrapolate
    for crosswalk in setup.crosswalks.values():
        _check_limits(crosswalk, scenario.ego.trigger_range_m, setup.model if asks else None)
    if scenario.pedestrians.anyone_comes:
        if config.end_s is None and setup.simulation.end_s is None:
            problem = "is not given, nor an end in the configuration: people would come for ever"
            raise InputError("simulation.end_s", problem, "a time, with pedestrians.flow_per_hour")
        for name in people_in(config):
            if name.startswith(OWN_PREFIX):
                problem = f"a person is named {name!r}, as the harness names its own people"
                raise InputError(str(config.path), problem, f"a name without {OWN_PREFIX!r}")
    elif not any(people_in(config)):
        allowed = "people in its files, or pedestrians.flow_per_hour"
        raise InputError(str(config.path), "nobody comes on foot", allowed)
    known = {*defined_types(config)}
    for name in setup.simulation.av_types:
        if name not in known:
            raise unknown_name("simulation.av_types", "vehicle type or class", name, known)


def chosen(town: Town, name: str, where: Place) -> Crosswalk:
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


def _check_limits(crosswalk: Crosswalk, range_m: float, model: InteractionModel | None) -> None:
    """Refuse limits from which nobody stops within R0, or which are outside the model's data."""
    limits_mps, name = crosswalk.limits_mps, crosswalk.id
    fastest_mps = limits_mps[-1]
    if fastest_mps > MAX_SPEED_MPS:
        problem = f"the limit before {name} is {fastest_mps:g} m/s"
        raise InputError("simulation.crossings", problem, f"at most {MAX_SPEED_MPS:g} m/s")
    needed_m = math.ceil(fastest_mps**2 / (2 * CAR.deceleration_mps2) + crosswalk.width_m / 2)
    if range_m < needed_m:
        problem = f"nobody stops within {range_m:g} m from {fastest_mps:g} m/s before {name}"
        raise InputError("ego.trigger_range_m", problem, f"at least {needed_m:g} m")
    if model is not None:
        for limit_mps in limits_mps:
            where = f"the limit before {name} (simulation.crossings)"
            check_support(model, range_m, limit_mps, where)


def _counted_s(simulation: SimulationSection, config: SumoConfig) -> tuple[float, float]:
    """Begin and end of the counted time; the end may be infinite."""
    first_s, last_s = config.begin_s, math.inf if config.end_s is None else config.end_s
    begin_s = first_s if simulation.begin_s is None else simulation.begin_s
    end_s = last_s if simulation.end_s is None else simulation.end_s
    for key, time_s, right in (
        ("begin_s", begin_s, first_s <= begin_s < last_s),
        ("end_s", end_s, begin_s < end_s <= last_s),
    ):
        if not right:
            allowed = f"begin_s < end_s, within {first_s:g} to {last_s:g} s"
            raise InputError(f"simulation.{key}", f"{time_s:g} s", allowed)
    return begin_s, end_s


def vehicles_due(scenario: Scenario, pair: int) -> Iterator[Due]:
    """The vehicles of all lanes, lane by lane; in every cell the same if demand and road are.

    The lanes of a direction share its flow equally.  Headways in a lane of flow q are shifted
    exponential: at least h (the following headway at v0), and beyond h with the hazard 1/(1/q − h).
    So the mean headway is 1/q.  Times are rounded up to steps.

    Args:
        scenario: a scenario with ``[traffic]``.
        pair: index of the pair.
    """
    traffic, experiment, road = scenario.known_traffic, scenario.experiment, scenario.crossing
    for direction, way in enumerate(("forward", "oncoming")):
        lanes = road.oncoming_lanes if direction else road.lanes
        flow = traffic.oncoming_per_hour if direction else traffic.flow_per_hour
        for lane in range(lanes):
            due = _of_a_flow(scenario, (pair, direction, lane), flow / lanes / SECONDS_PER_HOUR)
            if traffic.saturated:
                apart_s = max(experiment.step_s, _SATURATED * scenario.least_headway_s())
                due = iter(np.arange(0.0, traffic.warm_up_s + traffic.duration_s, apart_s).tolist())
            for number, time_s in enumerate(due):
                yield Due(f"{way}-{lane}-{number}", direction, lane, time_s)


def _of_a_flow(scenario: Scenario, key: tuple[int, ...], per_s: float) -> Iterator[float]:
    """Time from the begin, in whole steps, of each vehicle of the lane with a stream's key."""
    traffic, step_s = scenario.known_traffic, scenario.experiment.step_s
    headway_s = scenario.least_headway_s()
    hazard = per_s / (1 - per_s * headway_s)
    time_s, earliest, last_s = 0.0, 0, traffic.warm_up_s + traffic.duration_s - ROUNDING
    uniforms = stream(scenario.experiment.seed, "vehicle_arrival", *key).random
    while per_s:
        time_s -= math.log1p(-uniforms()) / hazard
        step = max(earliest, math.ceil(time_s / step_s - ROUNDING))
        if step * step_s >= last_s:
            return
        yield step * step_s
        earliest = step + round(headway_s / step_s)
        time_s += headway_s
