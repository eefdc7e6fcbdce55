"""A SUMO of this process that writes its own outputs."""

import os
from dataclasses import replace
from pathlib import Path

from harness.core.encounter import Arm
from harness.engine.control import SumoEngine
from harness.engine.network import place_of
from harness.engine.sumo import libsumo_engine
from harness.scenario import Scenario

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
    crossing = scenario.crosswalk()
    if crossing.speed_limit_mps is None:
        crossing = replace(crossing, speed_limit_mps=scenario.ego.initial_speed_mps)
    outputs = {option: str(folder / name) for option, name in _OUTPUTS.items()} | _FURTHER
    place, step_s = place_of(scenario), scenario.experiment.step_s
    engine = libsumo_engine(place, scenario.vehicle(), crossing, step_s, outputs=outputs)
    engine.automated = arm is Arm.AV
    return engine
