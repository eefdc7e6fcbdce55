"""Reads lengths, widths and accelerations of vehicle types, which FCD output lacks."""

import gzip
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import InputError


@dataclass(frozen=True, slots=True)
class VehicleType:
    """A vehicle type's dimensions in m, its accelerations in m/s² and its top speed in m/s."""

    length_m: float
    width_m: float
    acceleration_mps2: float
    deceleration_mps2: float
    max_speed_mps: float


_CAR = VehicleType(5.0, 1.8, 2.6, 4.5, 55.5556)
_VAN = VehicleType(6.5, 2.16, 2.6, 4.5, 55.5556)

CLASSES: Mapping[str, VehicleType] = {
    **dict.fromkeys(
        (
            "private", "authority", "army", "vip", "passenger", "hov", "taxi", "evehicle",
            "custom1", "custom2", "ignoring", "cable_car",
        ),
        _CAR,
    ),
    "emergency": _VAN,
    "delivery": _VAN,
    "bus": VehicleType(12.0, 2.5, 1.2, 4.0, 27.7778),
    "coach": VehicleType(14.0, 2.6, 2.0, 4.0, 27.7778),
    "truck": VehicleType(7.1, 2.4, 1.3, 4.0, 36.1111),
    "trailer": VehicleType(16.5, 2.55, 1.1, 4.0, 36.1111),
    "tram": VehicleType(22.0, 2.4, 1.0, 3.0, 22.2222),
    "rail_urban": VehicleType(109.5, 3.0, 1.0, 3.0, 27.7778),
    "subway": VehicleType(109.5, 3.0, 2.6, 4.5, 27.7778),
    "rail": VehicleType(135.0, 2.84, 0.25, 1.3, 44.4444),
    "rail_electric": VehicleType(200.0, 2.95, 0.5, 1.3, 61.1111),
    "rail_fast": VehicleType(200.0, 2.95, 0.5, 1.3, 91.6667),
    "motorcycle": VehicleType(2.2, 0.9, 6.0, 10.0, 55.5556),
    "moped": VehicleType(2.1, 0.78, 1.1, 7.0, 16.6667),
    "bicycle": VehicleType(1.6, 0.65, 1.2, 3.0, 13.8889),
    "scooter": VehicleType(1.2, 0.5, 1.2, 3.0, 6.9444),
}  # fmt: skip
"""SUMO 1.28's default values of each vehicle class."""

_DEFAULT_TYPES = {
    "DEFAULT_VEHTYPE": "passenger",
    "DEFAULT_TAXITYPE": "taxi",
    "DEFAULT_BIKETYPE": "bicycle",
    "DEFAULT_RAILTYPE": "rail",
}
_ATTRIBUTES = ("length", "width", "accel", "decel", "maxSpeed")


def read_types(files: Sequence[Path]) -> dict[str, VehicleType]:
    """Return the vehicle types that additional or route files define, by id.

    A missing attribute has the default of the type's vehicle class.  SUMO's predefined types
    (DEFAULT_VEHTYPE and the like) have the defaults of their classes.

    Raises:
        InputError: a file is missing, is no XML, defines no type, or a type is damaged.
    """
    types = {name: CLASSES[vehicle_class] for name, vehicle_class in _DEFAULT_TYPES.items()}
    for path in files:
        found = 0
        try:
            with path.open("rb") as raw:
                packed = raw.read(2) == b"\x1f\x8b"
            with gzip.open(path) if packed else path.open("rb") as file:
                for _, element in ET.iterparse(file):
                    if element.tag == "vType":
                        found += 1
                        types[element.get("id", "")] = _type(path, element.attrib)
                    # Nothing in the children of a vType is needed here.
                    element.clear()
        except (ET.ParseError, EOFError, zlib.error) as error:
            raise InputError(f"--types {path}", f"cut off, or no XML ({error})") from None
        except OSError as error:
            problem = f"cannot be read ({error.strerror or error})"
            raise InputError(f"--types {path}", problem) from None
        if not found:
            allowed = "an additional or route file with vType elements, or no --types"
            raise InputError(f"--types {path}", "defines no vehicle type", allowed)
    return types


def _type(path: Path, attributes: Mapping[str, str]) -> VehicleType:
    name, vehicle_class = attributes.get("id", ""), attributes.get("vClass", "passenger")
    default = CLASSES.get(vehicle_class, _CAR)
    own = []
    for key, value in zip(_ATTRIBUTES, _values(default), strict=True):
        try:
            number = float(attributes.get(key, value))
        except ValueError:
            number = -1.0
        if not 0 < number < 1e4:
            problem = f"vType {name!r} has {key}={attributes[key]!r}"
            raise InputError(f"--types {path}", problem, "a positive number")
        own.append(number)
    return VehicleType(*own)


def _values(kind: VehicleType) -> tuple[float, ...]:
    return (
        kind.length_m,
        kind.width_m,
        kind.acceleration_mps2,
        kind.deceleration_mps2,
        kind.max_speed_mps,
    )


def type_of(name: str | None, types: Mapping[str, VehicleType]) -> tuple[VehicleType, bool]:
    """Return a vehicle's type and whether it is defined; an undefined type is a passenger car.

    If SUMO copies a type for a single vehicle, it names the copy ``type@vehicle``.
    """
    known = types.get(name or "") or types.get((name or "").partition("@")[0])
    return (known, True) if known is not None else (CLASSES["passenger"], False)
