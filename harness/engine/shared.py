"""The SUMO simulation of this process: scenario in, open engine out.

libsumo allows one simulation per process, so the simulation is kept and used again.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from harness.core.vocabulary import Arm
from harness.engine.plain import PlainEngine
from harness.engine.protocol import Engine
from harness.scenario import EngineName, Scenario

if TYPE_CHECKING:
    from harness.engine.sumo_engine import SumoEngine

_engine: "tuple[str, SumoEngine] | None" = None


def open_engine(scenario: Scenario, name: EngineName = "sumo") -> Engine:
    """The engine of a given name; SUMO's restarts if site, vehicle or step length change."""
    global _engine
    step_s = scenario.experiment.step_s
    if name == "plain":
        return PlainEngine(scenario.vehicle(), step_s)
    key = repr((scenario.crossing, scenario.ego, step_s))
    if _engine is not None and (_engine[0] != key or _engine[1].closed):
        close_engine()
    if _engine is None:
        _engine = key, _started(scenario, {})
    return _engine[1]


def close_engine() -> None:
    """Close this process's simulation, if there is one."""
    global _engine
    if _engine is not None and not _engine[1].closed:
        _engine[1].close()
    _engine = None


_OUTPUTS = {
    "fcd-output": "fcd.xml",
    "tripinfo-output": "tripinfo.xml",
    "collision-output": "collisions.xml",
}
_FURTHER = {
    "fcd-output.acceleration": "true",
    "tripinfo-output.write-unfinished": "true",
    "precision": "6",
    # The harness places the pedestrians, so SUMO's records of their walks would mean nothing.
    "personinfo-output": os.devnull,
}


def recording_engine(folder: Path, arm: Arm, scenario: Scenario) -> "SumoEngine":
    """A new SUMO of this process that writes its outputs into a folder."""
    outputs = {option: str(folder / name) for option, name in _OUTPUTS.items()} | _FURTHER
    engine = _started(scenario, outputs)
    engine.automated = arm is Arm.AV
    return engine


def _started(scenario: Scenario, options: Mapping[str, str]) -> "SumoEngine":
    """A new engine in this process; what is not needed is not imported."""
    from harness.engine.starting import session_of
    from harness.engine.sumo_engine import SumoEngine

    return SumoEngine(session_of(scenario, options), scenario)
