"""The SUMO simulation of this process: scenario in, open engine out.

libsumo allows one simulation per process, so the simulation is kept and used again.
"""

import os
from dataclasses import replace
from pathlib import Path

from harness.core.encounter import Arm
from harness.engine.control import SumoEngine
from harness.engine.network import place_of
from harness.engine.protocol import Engine
from harness.scenario import EngineName, Scenario

_engine: tuple[str, SumoEngine] | None = None


def engine_for(scenario: Scenario) -> Engine:
    """The SUMO engine of this process; it restarts if site, vehicle or step length change."""
    global _engine
    step_s = scenario.experiment.step_s
    key = repr((scenario.crossing, scenario.ego, step_s))
    if _engine is not None and (_engine[0] != key or _engine[1].closed):
        close_engine()
    if _engine is None:
        from harness.engine.sumo import libsumo_engine

        vehicle, crossing = scenario.vehicle(), scenario.crosswalk()
        _engine = key, libsumo_engine(place_of(scenario), vehicle, crossing, step_s)
    return _engine[1]


def open_engine(scenario: Scenario, name: EngineName) -> Engine:
    """The engine of a given name, open for a scenario."""
    if name == "plain":
        from harness.engine.plain import PlainEngine

        return PlainEngine(scenario.vehicle(), scenario.experiment.step_s)
    return engine_for(scenario)


def close_engine() -> None:
    """Close this process's simulation, if there is one."""
    global _engine
    if _engine is not None and not _engine[1].closed:
        _engine[1].close()
    _engine = None


_OUTPUTS = {
    "--fcd-output": "fcd.xml",
    "--tripinfo-output": "tripinfo.xml",
    "--collision-output": "collisions.xml",
}
_FURTHER = {
    "--fcd-output.acceleration": "true",
    "--tripinfo-output.write-unfinished": "true",
    "--precision": "6",
    # The harness places the pedestrians, so SUMO's records of their walks would mean nothing.
    "--personinfo-output": os.devnull,
}


def recording_engine(folder: Path, arm: Arm, scenario: Scenario) -> SumoEngine:
    """A new SUMO of this process that writes its outputs into a folder.

    A road without a limit gets v0, which SUMO needs for its time loss.
    """
    from harness.engine.sumo import libsumo_engine

    crossing = scenario.crosswalk()
    if crossing.speed_limit_mps is None:
        crossing = replace(crossing, speed_limit_mps=scenario.ego.initial_speed_mps)
    outputs = {option: str(folder / name) for option, name in _OUTPUTS.items()} | _FURTHER
    place, step_s = place_of(scenario), scenario.experiment.step_s
    engine = libsumo_engine(place, scenario.vehicle(), crossing, step_s, outputs=outputs)
    engine.automated = arm is Arm.AV
    return engine
