"""SUMO's outputs in; trips, everybody's states, and who enters each lane, as records, out."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from harness.core.errors import EngineError, InputError
from harness.core.vocabulary import ROUNDING, SECONDS_PER_HOUR
from harness.engine.arm_configuration import STATES_FILE, TRIPS_FILE, run_untouched
from harness.engine.configuration import SumoConfig, elements_of, seconds, write_xml

_SEEN = ("vehicle", "person")
"""The elements of a step in SUMO's FCD output; a person with a vehicle rides in it."""
_COUNTED = {"vehicles": "none", "people": "walk"}
"""Who is counted, by the value of ``detectPersons`` of SUMO's ``laneData``."""

Counts = Mapping[str, Mapping[str, float]]
"""For vehicles and people: how many per hour enter a lane, by its id."""


class Trip(NamedTuple):
    """A vehicle's trip.

    Attributes:
        vehicle, type_id: the vehicle, and its vType.
        depart_s, arrival_s: when it began and ended; None if it did not.
        depart_delay_s: the time for which it waited to depart.
        time_loss_s: the time that it lost on its way.
    """

    vehicle: str
    type_id: str
    depart_s: float | None
    arrival_s: float | None
    depart_delay_s: float
    time_loss_s: float


class Seen(NamedTuple):
    """A vehicle, or a person on foot, at the end of a step.

    Attributes:
        name: SUMO's id; a vehicle and a person may have the same.
        vehicle_type: the vehicle's vType; None: a person.
        state: time in s, x, y, heading in rad (counter-clockwise from the network's x axis) and
            speed in m/s.
    """

    name: str
    vehicle_type: str | None
    state: tuple[float, ...]


def trips_in(arm: Path) -> Iterator[Trip]:
    """The trips of an arm in a folder, also those that have not ended or never began.

    Raises:
        EngineError: the file cannot be read, or is cut off.
    """
    try:
        for trip in elements_of(arm / TRIPS_FILE):
            if trip.tag == "tripinfo":
                of, kind = trip.attrib, trip.get("vType", "")
                # A time below 0 stands for what did not happen.
                times_s = (float(of[key]) for key in ("depart", "arrival"))
                depart_s, arrival_s = (None if time_s < 0 else time_s for time_s in times_s)
                lost_s = float(of["departDelay"]), float(of["timeLoss"])
                yield Trip(of["id"], kind, depart_s, arrival_s, *lost_s)
    except (InputError, ValueError) as error:
        raise EngineError(f"SUMO's tripinfo: {error}") from None


def seen_in(arm: Path, step_s: float, begin_s: float, end_s: float) -> Iterator[Seen]:
    """Everybody who drives or is on foot from one time until before another, step by step.

    Args:
        arm: the folder of an arm that kept its states.
        step_s: the length of a step.
        begin_s, end_s: the times.

    Raises:
        InputError: the file cannot be read, or is cut off before ``end_s``.
    """
    time_s = begin_s
    for each in elements_of(arm / STATES_FILE):
        of = each.attrib
        if each.tag == "timestep":
            # SUMO writes a state under the time at which its step began.
            time_s = seconds(of["time"]) + step_s
            if time_s >= end_s - ROUNDING:
                return
        elif each.tag in _SEEN and time_s > begin_s - ROUNDING and not of.get("vehicle"):
            x, y, angle_deg, speed_mps = (float(of[key]) for key in ("x", "y", "angle", "speed"))
            # The copy of a type for a single vehicle is named type@vehicle.
            kind = of["type"].partition("@")[0] if each.tag == "vehicle" else None
            yield Seen(of["id"], kind, (time_s, x, y, math.radians(90.0 - angle_deg), speed_mps))


def entering(config: SumoConfig, folder: Path) -> Counts:
    """Simulate a configuration to its end, untouched, and count who enters each lane.

    Raises:
        InputError: SUMO fails.
    """
    asked = ET.Element("additional")
    for who, people in _COUNTED.items():
        values = {"id": who, "file": f"{who}.xml", "detectPersons": people}
        ET.SubElement(asked, "laneData", values, withInternal="true", excludeEmpty="true")
    file, counts = folder / "counted.add.xml", {who: dict[str, float]() for who in _COUNTED}
    write_xml(file, asked)
    run_untouched(config, folder, {"additional-files": str(file)})
    for who, entered in counts.items():
        for each in elements_of(folder / f"{who}.xml"):
            if each.tag == "interval":
                begin_s, end_s = (float(each.attrib[name]) for name in ("begin", "end"))
            elif each.tag == "lane":
                hours = (end_s - begin_s) / SECONDS_PER_HOUR
                entered[each.attrib["id"]] = float(each.get("entered", 0)) / hours
    return counts
