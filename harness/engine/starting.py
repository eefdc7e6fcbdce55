"""An encounter's SUMO: scenario in, running session out.

docs/simulations.md explains the choices and has the measurements behind them.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

from harness.core.freezing import frozen
from harness.core.vocabulary import ROUNDING, Vehicle
from harness.engine.installation import scratch_folder
from harness.engine.network import network_of
from harness.engine.session import Runs, Session
from harness.scenario import Scenario

OWN_ROADS: Mapping[str, str] = frozen({
    "step-method.ballistic": "true",
    "collision.check-junctions": "true",
    "collision.mingap-factor": "0",
    "collision.action": "warn",
    "time-to-teleport": "-1",
})  # fmt: skip
"""SUMO's options on every road that the harness builds: exact steps; a collision ends nothing."""

_OPTIONS = {
    **OWN_ROADS,
    "seed": "1",  # no result depends on it
    "insertion-checks": "none",
    "pedestrian.striping.dawdling": "0",
    "pedestrian.striping.jamtime": "-1",
    "pedestrian.striping.jamtime.crossing": "-1",
    "no-warnings": "true",
}
"""Its further options in encounters."""

_WALKER = {"vClass": "pedestrian", "speedDev": 0, "sigma": 0}
"""The attributes of the type of pedestrians."""

_AV_COLOUR = {"color": "0,114,178"}
"""Colour of AVs in sumo-gui (blue of Okabe and Ito)."""


def session_of(
    scenario: Scenario,
    options: Mapping[str, str] | None = None,
    files: Mapping[str, str] | None = None,
    runs: Runs = "here",
) -> Session:
    """Start SUMO for a scenario's encounters.

    Args:
        scenario: the scenario.
        options: further options of SUMO by name.
        files: the contents of further input files, by the option that takes the file.
        runs: where SUMO runs.

    Raises:
        EngineError: SUMO does not start, or a simulation is already running in this process.
    """
    given = {"net-file": str(network_of(scenario))}
    given |= {"step-length": f"{scenario.experiment.step_s:.3f}", **_OPTIONS, **(options or {})}
    with scratch_folder() as folder:
        config = Path(folder, "encounter.sumocfg")
        config.write_text('<configuration><no-step-log value="true"/></configuration>')
        for option, text in {"additional-files": _types(scenario), **(files or {})}.items():
            file = Path(folder, f"{option}.xml")
            file.write_text(text, encoding="utf-8")
            given[option] = str(file)
        return Session(config, given, runs)


def vehicle_type(vehicle: Vehicle, limit_mps: float) -> dict[str, object]:
    """A vehicle's attributes in SUMO; none is random.

    Args:
        vehicle: the vehicle.
        limit_mps: the road's speed limit; SUMO accepts a vehicle that is faster.
    """
    return {
        "vClass": "passenger",
        "length": vehicle.length_m,
        "width": vehicle.width_m,
        "accel": vehicle.max_acceleration_mps2,
        "decel": vehicle.max_deceleration_mps2,
        "emergencyDecel": vehicle.max_deceleration_mps2,
        "speedFactor": max(1.0, vehicle.initial_speed_mps / limit_mps * (1 + ROUNDING)),
        "speedDev": 0,
        "sigma": 0,
    }


def _types(scenario: Scenario) -> str:
    """SUMO's types; that of an AV differs only in name and colour."""
    ego = vehicle_type(scenario.vehicle(), scenario.speed_limit_mps)
    ego |= {"minGap": 0, "maxSpeed": 100}
    types = {"walker": _WALKER, "ego": ego, "av": ego | _AV_COLOUR}
    root = ET.Element("additional")
    for name, attributes in types.items():
        values = {key: str(value) for key, value in attributes.items()}
        ET.SubElement(root, "vType", {"id": name, **values})
    return ET.tostring(root, "unicode")
