"""How SUMO is started: its options, and the types of ego and pedestrians.

The choices are explained, with the measurements behind them, in docs/sumo.md.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from harness.encounter import Vehicle

_WALKER = {"vClass": "pedestrian", "speedDev": 0, "sigma": 0}

AV_COLOUR = {"color": "0,114,178"}
"""Of AVs in sumo-gui, whose other vehicles are yellow; Okabe and Ito's blue."""

_STANDS_NEARER_M = {"IDM": 0.4}
"""So much nearer than its minGap SUMO's IDM stops (1.61 m where 2 m are asked)."""


@dataclass(frozen=True, slots=True)
class Following:
    """How vehicles keep their distance: SUMO's model, its headway and its gap at a stop."""

    model: str
    tau_s: float
    min_gap_m: float


def scratch_prefix(process: int) -> str:
    """How the names of a process's temporary folders begin."""
    return f"crosswalk-harness-{process}-"


def start_command(
    net: Path, types: Path, step_s: float, sumo_seed: int, outputs: Mapping[str, str] | None = None
) -> list[str]:
    """The command line SUMO is started with, ``outputs`` being further options."""
    options: dict[str, Any] = {
        "--net-file": net,
        "--additional-files": types,
        "--seed": sumo_seed,
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


def types_file(vehicle: Vehicle, speed_limit_mps: float | None) -> str:
    """The types of ego and pedestrians as a SUMO additional file; nothing in them is random.

    An AV differs in name and colour alone.  The ego is ``driven`` while SUMO's own driver drives
    it.  SUMO refuses an ego that is to be faster than the road's limit, unless its speed factor
    says so.
    """
    ego = {
        "vClass": "passenger",
        "length": vehicle.length_m,
        "width": vehicle.width_m,
        "accel": vehicle.max_acceleration_mps2,
        "decel": vehicle.max_deceleration_mps2,
        "emergencyDecel": vehicle.max_deceleration_mps2,
        # No random number may decide anything: no speed factor, no dawdling.
        "speedFactor": _speed_factor(vehicle, speed_limit_mps),
        "speedDev": 0,
        "sigma": 0,
        "minGap": 0,
        "maxSpeed": 100,
    }
    driven = ego | {
        "accel": vehicle.resume_acceleration_mps2,
        "maxSpeed": vehicle.initial_speed_mps,
    }
    types = {"ego": ego, "driven": driven, "walker": _WALKER}
    types |= {"av": ego | AV_COLOUR, "av_driven": driven | AV_COLOUR}
    return additional_file(_written(types))


def traffic_types(vehicle: Vehicle, speed_limit_mps: float | None, following: Following) -> str:
    """The types of an hour of traffic: vehicles that follow each other, and pedestrians.

    An AV differs in name and colour alone.
    """
    car = {
        "vClass": "passenger",
        "length": vehicle.length_m,
        "width": vehicle.width_m,
        "carFollowModel": following.model,
        "tau": following.tau_s,
        "minGap": following.min_gap_m + _STANDS_NEARER_M.get(following.model, 0.0),
        "accel": vehicle.resume_acceleration_mps2,
        "decel": vehicle.max_deceleration_mps2,
        "emergencyDecel": vehicle.max_deceleration_mps2,
        "speedFactor": _speed_factor(vehicle, speed_limit_mps),
        "speedDev": 0,
        "sigma": 0,
        "maxSpeed": vehicle.initial_speed_mps,
    }
    return _written({"vehicle": car, "av": car | AV_COLOUR, "walker": _WALKER})


def _speed_factor(vehicle: Vehicle, speed_limit_mps: float | None) -> float:
    if speed_limit_mps is None or vehicle.initial_speed_mps <= speed_limit_mps:
        return 1.0
    return vehicle.initial_speed_mps / speed_limit_mps * (1 + 1e-9)


def e2_detectors(lanes: Iterable[str], file: Path) -> str:
    """A lane area detector over the whole of each lane, named like it, a row for each minute.

    A vehicle is in its jam as soon as it is slower than 5 km/h, as in SUMO's queue output.
    """
    return "".join(
        f'<laneAreaDetector id="{lane}" lane="{lane}" pos="0" endPos="-0.01" period="60" '
        f'timeThreshold="0" speedThreshold="{5 / 3.6!r}" file={quoteattr(str(file))}/>'
        for lane in lanes
    )


def additional_file(elements: str) -> str:
    """A SUMO additional file."""
    return f"<additional>{elements}</additional>\n"


def _written(types: Mapping[str, Mapping[str, Any]]) -> str:
    return "".join(
        f"<vType {' '.join(f'{name}={quoteattr(str(value))}' for name, value in type_.items())}/>"
        for type_ in ({"id": name, **attributes} for name, attributes in types.items())
    )
