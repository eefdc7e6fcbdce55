"""An encounter's SUMO: scenario in, running session out.

docs/simulations.md explains the choices and has the measurements behind them.
"""

from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

from harness.engine.installation import scratch_folder
from harness.engine.network import network_of
from harness.engine.session import Module, Session
from harness.scenario import Scenario

_OPTIONS = {
    "seed": "1",  # no result depends on it
    "step-method.ballistic": "true",
    "insertion-checks": "none",
    "collision.check-junctions": "true",
    "collision.mingap-factor": "0",
    "collision.action": "warn",
    "pedestrian.striping.dawdling": "0",
    "pedestrian.striping.jamtime": "-1",
    "pedestrian.striping.jamtime.crossing": "-1",
    "time-to-teleport": "-1",
    "no-warnings": "true",
}

_WALKER = {"vClass": "pedestrian", "speedDev": 0, "sigma": 0}

AV_COLOUR = {"color": "0,114,178"}
"""Colour of AVs in sumo-gui (blue of Okabe and Ito)."""


def session_of(
    scenario: Scenario,
    options: Mapping[str, str] | None = None,
    files: Mapping[str, str] | None = None,
    module: Module = "libsumo",
) -> Session:
    """Start SUMO for a scenario's encounters.

    Args:
        scenario: the scenario.
        options: further options of SUMO by name.
        files: the contents of further input files, by the option that takes the file.
        module: where SUMO runs.

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
        return Session(config, given, module)


def _types(scenario: Scenario) -> str:
    """SUMO's types of vehicles and pedestrians; no attribute is random.

    The type of an AV differs only in name and colour.
    """
    vehicle, v0 = scenario.vehicle(), scenario.ego.initial_speed_mps
    ego = {
        "vClass": "passenger",
        "length": vehicle.length_m,
        "width": vehicle.width_m,
        "accel": vehicle.max_acceleration_mps2,
        "decel": vehicle.max_deceleration_mps2,
        "emergencyDecel": vehicle.max_deceleration_mps2,
        "minGap": 0,
        "maxSpeed": 100,
        # SUMO accepts a vehicle that is faster than the road's limit.
        "speedFactor": max(1.0, v0 / scenario.speed_limit_mps * (1 + 1e-9)),
        "speedDev": 0,
        "sigma": 0,
    }
    types = {"walker": _WALKER, "ego": ego, "av": ego | AV_COLOUR}
    elements = "".join(
        f"<vType {' '.join(f'{name}={quoteattr(str(value))}' for name, value in type_.items())}/>"
        for type_ in ({"id": name, **attributes} for name, attributes in types.items())
    )
    return f"<additional>{elements}</additional>\n"
