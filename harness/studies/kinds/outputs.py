"""Options for SUMO's own outputs of an arm that is repeated."""

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from harness.core.encounter import Crossing
from harness.scenario import Scenario

SUMO_FILES = {
    "--fcd-output": "fcd.xml",
    "--tripinfo-output": "tripinfo.xml",
    "--collision-output": "collisions.xml",
}

PRECISION = "6"
"""Number of decimals in the outputs."""

_FURTHER_OPTIONS = {
    "--fcd-output.acceleration": "true",
    "--tripinfo-output.write-unfinished": "true",
    "--precision": PRECISION,
    # The harness places the pedestrians, so SUMO's records of their walks would be meaningless.
    "--personinfo-output": os.devnull,
}


def outputs_in(folder: Path, files: Mapping[str, str] = SUMO_FILES) -> dict[str, str]:
    """Return the options with which SUMO writes these files into a folder."""
    return {option: str(folder / name) for option, name in files.items()} | _FURTHER_OPTIONS


def with_speed_limit(scenario: Scenario) -> Crossing:
    """Return the crosswalk on a road with a speed limit, which SUMO needs for its time loss.

    If the scenario has no limit, v0 is used, as in the harness's own delay.  SUMO's own driver
    would obey this limit, so with that driver the road keeps the limit of the run.
    """
    crossing = scenario.crosswalk()
    arms = (scenario.arms.av, scenario.arms.human)
    if crossing.speed_limit_mps is not None or "sumo_driver" in arms:
        return crossing
    return replace(crossing, speed_limit_mps=scenario.ego.initial_speed_mps)
