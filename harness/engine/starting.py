"""Command line and additional file of SUMO, from a place and a vehicle.

docs/sumo.md explains the choices and has the measurements behind them.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from harness.core.encounter import Crossing, Vehicle
from harness.site import Place, Site, read_site

_WALKER = {"vClass": "pedestrian", "speedDev": 0, "sigma": 0}

AV_COLOUR = {"color": "0,114,178"}
"""Colour of AVs in sumo-gui (blue of Okabe and Ito)."""


def scratch_prefix(process: int) -> str:
    """The prefix of the names of a process's temporary folders."""
    return f"crosswalk-harness-{process}-"


def start_command(
    net: Path, types: Path, step_s: float, outputs: Mapping[str, str] | None = None
) -> list[str]:
    """SUMO's command line; ``outputs`` are further options."""
    options: dict[str, Any] = {
        "--net-file": net,
        "--additional-files": types,
        "--seed": 1,  # no result depends on it
        "--step-length": f"{step_s:.3f}",
        "--step-method.ballistic": "true",
        "--insertion-checks": "none",
        "--collision.check-junctions": "true",
        "--collision.mingap-factor": "0",
        "--collision.action": "warn",
        "--pedestrian.striping.dawdling": "0",
        "--pedestrian.striping.jamtime": "-1",
        "--pedestrian.striping.jamtime.crossing": "-1",
        "--time-to-teleport": "-1",
        "--no-step-log": "true",
        "--no-warnings": "true",
        **(outputs or {}),
    }
    return ["sumo", *(str(part) for option in options.items() for part in option)]


def site_and_types(place: Place, vehicle: Vehicle, crossing: Crossing) -> tuple[Site, str]:
    """A crosswalk's site, and SUMO's types of vehicles and pedestrians as XML.

    No attribute is random.  The type of an AV differs only in name and colour.
    """
    ego = {
        "vClass": "passenger",
        "length": vehicle.length_m,
        "width": vehicle.width_m,
        "accel": vehicle.max_acceleration_mps2,
        "decel": vehicle.max_deceleration_mps2,
        "emergencyDecel": vehicle.max_deceleration_mps2,
        "minGap": 0,
        "maxSpeed": 100,
        "speedFactor": _speed_factor(
            vehicle, crossing.speed_limit_mps or vehicle.initial_speed_mps
        ),
        "speedDev": 0,
        "sigma": 0,
    }
    types = {"walker": _WALKER, "ego": ego, "av": ego | AV_COLOUR}
    return read_site(place), "".join(
        f"<vType {' '.join(f'{name}={quoteattr(str(value))}' for name, value in type_.items())}/>"
        for type_ in ({"id": name, **attributes} for name, attributes in types.items())
    )


def _speed_factor(vehicle: Vehicle, speed_limit_mps: float) -> float:
    """The speedFactor with which SUMO accepts a vehicle that is faster than the road's limit."""
    if vehicle.initial_speed_mps <= speed_limit_mps:
        return 1.0
    return vehicle.initial_speed_mps / speed_limit_mps * (1 + 1e-9)


def write_additional(folder: str, elements: str) -> Path:
    """Write a SUMO additional file into a folder."""
    path = Path(folder) / "types.add.xml"
    path.write_text(f"<additional>{elements}</additional>\n", encoding="utf-8")
    return path
