"""The SUMO simulation of this process: scenario in, open engine out.

libsumo allows one simulation per process, so the simulation is kept and used again.
"""

from collections.abc import Callable
from typing import TypeVar, cast

from harness.engine.control import SumoEngine
from harness.engine.network import place_of
from harness.engine.protocol import Engine
from harness.engine.road import SumoRoad
from harness.engine.starting import Following
from harness.scenario import EngineName, Scenario

_engine: tuple[str, SumoEngine | SumoRoad] | None = None

_Kind = TypeVar("_Kind", SumoEngine, SumoRoad)


def engine_for(scenario: Scenario) -> Engine:
    """The SUMO engine of this process; it restarts if site, vehicle or step length change."""

    def start() -> SumoEngine:
        from harness.engine.sumo import libsumo_engine

        vehicle, crossing = scenario.vehicle(), scenario.crosswalk()
        step_s = scenario.experiment.step_s
        return libsumo_engine(place_of(scenario), vehicle, crossing, step_s)

    return _started("one ego", scenario, start)


def open_engine(scenario: Scenario, name: EngineName) -> Engine:
    """The engine of a given name, open for a scenario."""
    if name == "plain":
        from harness.engine.plain import PlainEngine

        return PlainEngine(scenario.vehicle(), scenario.experiment.step_s)
    return engine_for(scenario)


def road_for(scenario: Scenario) -> SumoRoad:
    """The SUMO road of this process for hours of traffic; see ``engine_for``.

    It also restarts if the car following changes.
    """
    following = following_of(scenario)

    def start() -> SumoRoad:
        from harness.engine.sumo import libsumo_road

        vehicle, crossing = scenario.vehicle(), scenario.crosswalk()
        step_s, place = scenario.experiment.step_s, place_of(scenario)
        return libsumo_road(place, vehicle, crossing, step_s, following)

    return _started(repr(following), scenario, start)


def following_of(scenario: Scenario) -> Following:
    """The car following of a scenario with traffic."""
    traffic = scenario.known_traffic
    names = (kind.name for kind in traffic.types)
    types = tuple(zip(names, scenario.vehicles(), strict=False))
    return Following(traffic.following, traffic.tau_s, traffic.min_gap_m, types)


def close_engine() -> None:
    """Close this process's simulation, if there is one."""
    global _engine
    if _engine is not None and not _engine[1].closed:
        _engine[1].close()
    _engine = None


def _started(kind: str, scenario: Scenario, start: Callable[[], _Kind]) -> _Kind:
    global _engine
    key = repr((kind, scenario.crossing, scenario.ego, scenario.experiment.step_s))
    if _engine is not None and (_engine[0] != key or _engine[1].closed):
        close_engine()
    if _engine is None:
        _engine = (key, start())
    return cast(_Kind, _engine[1])
