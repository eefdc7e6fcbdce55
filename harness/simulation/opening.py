"""A scenario's simulation is read and checked; what its arms share comes out."""

import hashlib
import math
import os
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from harness.core.encounter import Arm, Strategy
from harness.core.errors import EngineError, InputError, StrategyError, in_one_line, nearest_name
from harness.encounter.arms import asks_model, make_strategy
from harness.encounter.arrivals import planned_arrivals
from harness.encounter.walking_speeds import WalkingSpeeds
from harness.engine.starting import scratch_prefix
from harness.model.interaction import InteractionModel, check_support
from harness.scenario import Scenario
from harness.scenario.consistency import SUMO_DRIVER
from harness.scenario.sections import EgoSection
from harness.scenario.sight import check_sight
from harness.simulation import demand
from harness.simulation.arm import Behaving, Setup
from harness.simulation.driving import Zones
from harness.simulation.files import Kept, check_outputs, write_config
from harness.simulation.shares import number_of
from harness.site.configuration import (
    SumoConfig,
    first_error,
    people_come,
    read_config,
    sumo_program,
)
from harness.site.town import Town
from harness.site.vehicle_types import types_that_come
from harness.strategies.perception.sensor import sensor_of

_BASE_SEED = 23423
"""SUMO's default seed, of ``[traffic]``."""
_SEEDS_APART = 1_000_003
"""Distance of SUMO's seeds of two successive values of ``experiment.seed``; odd, so that the values
do not repeat before all of SUMO's seeds are used."""
_SEEDS = 2**31
"""SUMO's seeds lie below this."""
_MOST_NAMES = 20
"""Greatest number of names that an error lists."""
_kept: dict[tuple[str, float], Zones] = {}
_CAR_DECEL_MPS2 = EgoSection().max_deceleration_mps2
_FASTEST_MPS = 60.0
"""No road allows more, as for ``ego.initial_speed_mps``."""


@dataclass(frozen=True)
class Opened:
    """A scenario whose simulation has been read.

    Attributes:
        scenario: the scenario, with the simulation's step.
        config, town: the configuration and its network.
        crosswalks: ids of the chosen crosswalks.
        av_share, av_types: the share of AVs among vehicles of these vTypes and vClasses.
        begin_s, end_s: the counted time; the end may be infinite.
        step_s: a step other than the configuration's.
        outputs: the outputs of the configuration that are kept.
    """

    scenario: Scenario
    config: SumoConfig
    town: Town
    crosswalks: tuple[str, ...]
    av_share: float
    av_types: frozenset[str]
    begin_s: float
    end_s: float
    step_s: float | None = None
    outputs: frozenset[str] = frozenset()

    def seed(self, pair: int) -> int:
        """SUMO's seed of a pair."""
        # That of ``[traffic]`` has been written for its pair.
        traffic = self.scenario.traffic is not None
        return self.config.seed if traffic else sumo_seed(self.scenario, self.config.seed, pair)

    def setup(self, model: InteractionModel, speeds: list[WalkingSpeeds]) -> Setup:
        """What all arms share.

        Args:
            model: the interaction model.
            speeds: receives what counts the uses of the model for each crosswalk of an arm.
        """
        scenario, ego = self.scenario, self.scenario.ego
        comes = scenario.pedestrians.anyone_comes

        def make(driver: Arm, pair: int, vehicle: str) -> Strategy | None:
            if scenario.arms.driver(driver) == SUMO_DRIVER:
                return None
            of_pair, key = model.of_pair(pair), number_of(vehicle)
            try:
                return make_strategy(scenario, driver, pair, of_pair, key)
            except (Exception, SystemExit) as error:
                what = f"vehicle {vehicle}: the strategy could not be made: {in_one_line(error)}"
                raise StrategyError(what, error) from None

        return Setup(
            config=self.config,
            town=self.town,
            zones=_zones(self.config, scenario.experiment.step_s),
            crosswalks=self.crosswalks,
            av_share=self.av_share,
            av_types=self.av_types,
            begin_s=self.begin_s,
            end_s=self.end_s,
            range_m=ego.trigger_range_m,
            detection_m=ego.detection_range_m or ego.trigger_range_m,
            resume_mps2=ego.resume_acceleration_mps2,
            names={driver: scenario.arms.driver(driver) for driver in Arm},
            make=make,
            late=scenario.late,
            sensors={driver: sensor_of(scenario, driver) for driver in Arm},
            own=dict.fromkeys(self.crosswalks, self._behaving(model, speeds)) if comes else {},
            until_empty=scenario.traffic is not None,
        )

    def _behaving(self, model: InteractionModel, speeds: list[WalkingSpeeds]) -> Behaving:
        """The harness's people; in its own network they have the streams of an encounter's."""
        scenario, since_s = self.scenario, self.config.begin_s
        last_s = self.config.end_s
        horizon_s = (self.end_s if last_s is None else last_s) - since_s
        people = scenario.pedestrians

        def choose_speed(pair: int) -> WalkingSpeeds:
            speeds.append(WalkingSpeeds(scenario, model.of_pair(pair)))
            return speeds[-1]

        return Behaving(
            arrivals=lambda pair, crosswalk: planned_arrivals(
                scenario,
                pair,
                horizon_s=horizon_s,
                begin_s=self.begin_s - since_s,
                key=() if crosswalk == demand.CROSSWALK else (number_of(crosswalk),),
            ),
            choose_speed=choose_speed,
            behaviour=people.behaviour,
            kerb_wait_s=people.kerb_wait_s,
            threshold=people.threshold,
        )


def sumo_seed(scenario: Scenario, config_seed: int, pair: int) -> int:
    """SUMO's seed of a pair: the configuration's plus the pair's number, for seed 1.

    Another ``experiment.seed`` has other seeds for all pairs, below a million pairs.
    """
    seed = scenario.experiment.seed
    return (config_seed + pair + _SEEDS_APART * (seed - 1)) % _SEEDS


def opened_traffic(scenario: Scenario, pair: int, folder: Path) -> Opened:
    """The simulation of a pair of ``[traffic]``, whose files are written into a folder."""
    traffic = scenario.known_traffic
    seed = sumo_seed(scenario, _BASE_SEED, pair)
    config = demand.write_demand(scenario, pair, seed, folder)
    return Opened(
        scenario=scenario,
        config=config,
        town=_zones(config, scenario.experiment.step_s).town,
        crosswalks=(demand.CROSSWALK,),
        av_share=traffic.av_share,
        av_types=frozenset(demand.type_names(traffic, automated=True)),
        begin_s=traffic.warm_up_s,
        end_s=traffic.warm_up_s + traffic.duration_s,
    )


def opened(scenario: Scenario) -> Opened:
    """The simulation of a scenario with ``[simulation]``.

    Raises:
        InputError: the configuration, a crosswalk, or a key that does not fit it is refused.
    """
    simulation = scenario.known_simulation
    path = Path(simulation.file)
    try:
        config = read_config(path, simulation.step_s)
        step_s = config.step_s if simulation.step_s is None else simulation.step_s
        town = _zones(config, step_s).town
    except EngineError as error:
        raise InputError(str(path), str(error)) from None
    experiment = scenario.experiment.model_copy(update={"step_s": step_s})
    scenario = scenario.model_copy(update={"experiment": experiment})
    check_sight(scenario, "simulation")
    _check_people(scenario, config)
    _check_types(simulation.av_types, config)
    check_outputs(config, simulation.outputs, "simulation.outputs")
    _check_crosswalks(simulation.crossings, town, scenario.ego.trigger_range_m)
    begin_s, end_s = _counted_s(scenario, config)
    return Opened(
        scenario=scenario,
        config=config,
        town=town,
        crosswalks=tuple(dict.fromkeys(simulation.crossings)),
        av_share=simulation.av_share,
        av_types=frozenset(simulation.av_types),
        begin_s=begin_s,
        end_s=end_s,
        step_s=simulation.step_s,
        outputs=frozenset(simulation.outputs),
    )


def check_roads(found: Opened, model: InteractionModel) -> None:
    """Refuse limits before the chosen crosswalks that lie outside the data of a model in use.

    Raises:
        InputError: names the crosswalk.
    """
    scenario = found.scenario
    if asks_model(scenario) and not scenario.model.extrapolate:
        for name in found.crosswalks:
            where = f"the limit before {name} (simulation.crossings)"
            for limit_mps in _limits_mps(found.town, name):
                check_support(model, scenario.ego.trigger_range_m, limit_mps, where)


def check_demand(config: SumoConfig) -> None:
    """Refuse a configuration with a route that SUMO cannot build.

    Raises:
        InputError: SUMO does not begin with all routes loaded.
    """
    with TemporaryDirectory(prefix=scratch_prefix(os.getpid())) as scratch:
        now = {"route-steps": "0", "end": f"{config.begin_s + config.step_s:.3f}"}
        path = write_config(config, Kept(Path(scratch), frozenset()), config.seed, None, now)
        command = [sumo_program(), "-c", str(path)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(str(config.path), f"SUMO refuses it ({first_error(done.stderr)})")


def digests(config: SumoConfig) -> Mapping[str, str]:
    """The hashes of a configuration's files, by their paths."""
    return {str(file): _digest(file) for file in config.inputs}


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _zones(config: SumoConfig, step_s: float) -> Zones:
    """The zones in a configuration's network; a process keeps those of the last one."""
    key = _digest(config.net), step_s
    if key not in _kept:
        _kept.clear()
        _kept[key] = Zones(Town.read(config.net), step_s)
    return _kept[key]


def _limits_mps(town: Town, crosswalk: str) -> Iterable[float]:
    """The speed limits of the lanes before a crosswalk."""
    links = town.connections(crosswalk)
    return sorted({town.lane(each.from_lane).limit_mps for each in links})


def _check_crosswalks(names: Iterable[str], town: Town, range_m: float) -> None:
    where = "simulation.crossings"
    for name in names:
        crosswalk = town.crosswalks.get(name)
        if crosswalk is None:
            some = ", ".join([*town.crosswalks][:5]) + ", …" * (len(town.crosswalks) > 5)
            near = nearest_name(name, town.crosswalks)
            raise InputError(where, f"no crossing {name!r}", some or "there are none", near)
        if crosswalk.refused is not None:
            allowed = "a crosswalk that `harness crossings` lists as usable"
            raise InputError(where, f"{name}: {crosswalk.refused}", allowed)
        fastest_mps = max(_limits_mps(town, name))
        if fastest_mps > _FASTEST_MPS:
            problem = f"the limit before {name} is {fastest_mps:g} m/s"
            raise InputError(where, problem, f"at most {_FASTEST_MPS:g} m/s")
        stops_m = fastest_mps**2 / (2 * _CAR_DECEL_MPS2)
        needed_m = math.ceil(stops_m + crosswalk.width_m / 2)
        if range_m < needed_m:
            problem = f"nobody stops within {range_m:g} m from {fastest_mps:g} m/s before {name}"
            raise InputError("ego.trigger_range_m", problem, f"at least {needed_m:g} m")


def _check_people(scenario: Scenario, config: SumoConfig) -> None:
    where, flow = str(config.path), scenario.pedestrians.anyone_comes
    if flow and config.end_s is None and scenario.known_simulation.end is None:
        problem = "is not given, nor an end in the configuration: people would come for ever"
        raise InputError("simulation.end", problem, "a time, with pedestrians.flow_per_hour")
    if not flow and not people_come(config):
        allowed = "people in its files, or pedestrians.flow_per_hour"
        raise InputError(where, "nobody comes on foot", allowed)


def _counted_s(scenario: Scenario, config: SumoConfig) -> tuple[float, float]:
    """Begin and end of the counted time; the end may be infinite."""
    simulation, where, last_s = scenario.known_simulation, "simulation", config.end_s
    begin_s = config.begin_s if simulation.begin is None else simulation.begin
    end_s = last_s if simulation.end is None else simulation.end
    if begin_s < config.begin_s or (last_s is not None and begin_s >= last_s):
        allowed = f"from {config.begin_s:g} s, before the simulation's end"
        raise InputError(f"{where}.begin", f"{begin_s:g} s", allowed)
    if end_s is not None and (end_s <= begin_s or (last_s is not None and end_s > last_s)):
        most = "" if last_s is None else f", at most {last_s:g} s"
        raise InputError(f"{where}.end", f"{end_s:g} s", f"after begin = {begin_s:g} s{most}")
    return begin_s, math.inf if end_s is None else end_s


def _check_types(names: Iterable[str], config: SumoConfig) -> None:
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
    near = nearest_name(name, classes | types)
    raise InputError("simulation.av_types", f"no vehicle of {name!r} comes", allowed, near)
