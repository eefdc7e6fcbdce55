"""Command line and additional file of SUMO, from a place, a vehicle and a car-following model.

docs/sumo.md explains the choices and has the measurements behind them.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from harness.core.encounter import Crossing, Vehicle
from harness.site import Place, Site, read_site

_WALKER = {"vClass": "pedestrian", "speedDev": 0, "sigma": 0}

AV_COLOUR = {"color": "0,114,178"}
"""Colour of AVs in sumo-gui (blue of Okabe and Ito); other vehicles are yellow."""

_STANDS_NEARER_M = {"IDM": 0.4}
"""SUMO's IDM stops this much nearer than its minGap (at 1.61 m for a minGap of 2 m)."""


@dataclass(frozen=True, slots=True)
class Following:
    """SUMO's car-following model with its headway τ and its standstill gap.

    ``types`` has the name and the vehicle of each type of a vehicle mix.
    """

    model: str
    tau_s: float
    min_gap_m: float
    types: tuple[tuple[str, Vehicle], ...] = ()

    @property
    def endings(self) -> tuple[str, ...]:
        """The ending of each type's name, after ``vehicle`` or ``av``."""
        return tuple(f"_{name}" for name, _ in self.types) or ("",)


def scratch_prefix(process: int) -> str:
    """The prefix of the names of a process's temporary folders."""
    return f"crosswalk-harness-{process}-"


def start_command(
    net: Path, types: Path, step_s: float, sumo_seed: int, outputs: Mapping[str, str] | None = None
) -> list[str]:
    """SUMO's command line; ``outputs`` are further options."""
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


def site_and_types(
    place: Place, vehicle: Vehicle, crossing: Crossing, following: Following | None = None
) -> tuple[Site, float, str]:
    """A crosswalk's site, the road's speed limit in m/s, and the vehicle types as XML."""
    site = read_site(place)
    limit_mps = crossing.speed_limit_mps or vehicle.initial_speed_mps
    return site, limit_mps, vehicle_types(vehicle, limit_mps, following)


def vehicle_types(
    vehicle: Vehicle, speed_limit_mps: float, following: Following | None = None
) -> str:
    """SUMO's types of vehicles and pedestrians, as XML; no attribute is random.

    The type of an AV differs only in name and colour.  Each type of a vehicle mix becomes two SUMO
    types, ``vehicle_NAME`` and ``av_NAME``.

    Args:
        vehicle: the ego, or each vehicle of an hour.
        speed_limit_mps: the speed limit of the road.
        following: the car following of an hour of traffic; None for an encounter.
    """
    types: dict[str, Mapping[str, Any]] = {"walker": _WALKER}
    if following is None:
        ego = _attributes(vehicle, speed_limit_mps)
        ego |= {"accel": vehicle.max_acceleration_mps2, "minGap": 0, "maxSpeed": 100}
        types |= {"ego": ego, "av": ego | AV_COLOUR}
    else:
        min_gap_m = following.min_gap_m + _STANDS_NEARER_M.get(following.model, 0.0)
        vehicles = [each for _, each in following.types] or [vehicle]
        for ending, each in zip(following.endings, vehicles, strict=True):
            car = _attributes(each, speed_limit_mps) | {
                "accel": each.resume_acceleration_mps2,
                "maxSpeed": each.initial_speed_mps,
                "carFollowModel": following.model,
                "tau": following.tau_s,
                "minGap": min_gap_m,
            }
            types |= {f"vehicle{ending}": car, f"av{ending}": car | AV_COLOUR}
    return "".join(
        f"<vType {' '.join(f'{name}={quoteattr(str(value))}' for name, value in type_.items())}/>"
        for type_ in ({"id": name, **attributes} for name, attributes in types.items())
    )


def _attributes(vehicle: Vehicle, speed_limit_mps: float) -> dict[str, Any]:
    """The attributes that a vehicle's type has in encounters and hours."""
    return {
        "vClass": "passenger",
        "length": vehicle.length_m,
        "width": vehicle.width_m,
        "decel": vehicle.max_deceleration_mps2,
        "emergencyDecel": vehicle.max_deceleration_mps2,
        # Nothing is random: no spread of speed factors and no dawdling.
        "speedFactor": _speed_factor(vehicle, speed_limit_mps),
        "speedDev": 0,
        "sigma": 0,
    }


def _speed_factor(vehicle: Vehicle, speed_limit_mps: float) -> float:
    """The speedFactor with which SUMO accepts a vehicle that is faster than the road's limit."""
    if vehicle.initial_speed_mps <= speed_limit_mps:
        return 1.0
    return vehicle.initial_speed_mps / speed_limit_mps * (1 + 1e-9)


def e2_detectors(lanes: Iterable[str], file: Path) -> str:
    """A lane area detector (E2) over each lane, with the lane's id and one row per minute.

    A vehicle is in a jam while it is slower than 5 km/h, as in SUMO's queue output.
    """
    return "".join(
        f'<laneAreaDetector id="{lane}" lane="{lane}" pos="0" endPos="-0.01" period="60" '
        f'timeThreshold="0" speedThreshold="{5 / 3.6!r}" file={quoteattr(str(file))}/>'
        for lane in lanes
    )


def write_additional(folder: str, elements: str) -> Path:
    """Write a SUMO additional file into a folder."""
    path = Path(folder) / "types.add.xml"
    path.write_text(f"<additional>{elements}</additional>\n", encoding="utf-8")
    return path
