"""This process's one SUMO simulation: libsumo allows no second one."""

from harness.engine.control import SumoEngine
from harness.engine.protocol import Engine
from harness.network import network_of
from harness.scenario import Scenario

_engine: tuple[str, SumoEngine] | None = None


def engine_for(scenario: Scenario) -> Engine:
    """This process's SUMO simulation, started again only for another site, vehicle or step."""
    global _engine
    from harness.engine.sumo import libsumo_engine

    key = repr((scenario.crossing, scenario.ego, scenario.experiment.step_s))
    if _engine is not None and (_engine[0] != key or _engine[1].closed):
        close_engine()
    if _engine is None:
        vehicle, crossing = scenario.vehicle(), scenario.crosswalk()
        step_s = scenario.experiment.step_s
        _engine = (key, libsumo_engine(network_of(scenario), vehicle, crossing, step_s))
    return _engine[1]


def close_engine() -> None:
    """Close this process's simulation, if there is one."""
    global _engine
    if _engine is not None and not _engine[1].closed:
        _engine[1].close()
    _engine = None
