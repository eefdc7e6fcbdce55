"""The files of an arm: the configuration that it runs is written, SUMO's outputs are read.

The configuration is the user's, with its outputs in the arm's folder.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from harness.core.errors import EngineError, InputError
from harness.core.vocabulary import ROUNDING, SECONDS_PER_HOUR
from harness.engine.configuration import (
    SumoConfig,
    elements_of,
    option_kinds,
    seconds,
    write_options,
    write_xml,
)
from harness.engine.installation import run_program, scratch_folder

CONFIG_FILE, TRIPS_FILE, STATES_FILE = "simulation.sumocfg", "tripinfo.xml", "fcd.xml.gz"

_ALWAYS = {
    "random": "false",
    "no-step-log": "true",
    "no-warnings": "true",
    "duration-log.disable": "true",
    "tripinfo-output": TRIPS_FILE,
    "tripinfo-output.write-unfinished": "true",
    "tripinfo-output.write-undeparted": "true",
}
"""Options of every arm: a fixed seed, few messages, and output of unfinished trips too."""

_DROPPED = ("save-", "output-prefix", "output-suffix", "num-clients", "remote-port",
            "device.tripinfo.", "device.fcd.", "person-device.fcd.", "fcd-output.")  # fmt: skip
"""How options begin that save states, name outputs, wait for a client, or leave out trips and
vehicles."""

_TO_THE_ROOT = "../" * 40
"""SUMO puts its prefix between an output's folder and its name, in detectors' and devices' too."""

_SEEN = ("vehicle", "person")
"""The elements of a step in SUMO's FCD output; a person with a vehicle rides in it."""
_COUNTED = {"vehicles": "none", "people": "walk"}
"""Who is counted, by the value of ``detectPersons`` of SUMO's ``laneData``."""

Counts = Mapping[str, Mapping[str, float]]
"""For vehicles and people: how many per hour enter a lane, by its id."""


def _is_kept(option: str, keeps: bool) -> bool:
    """Whether an option of the user's configuration stays."""
    section, kind = option_kinds().get(option, ("", ""))
    writes = option.endswith("-output") or (kind == "FILE" and section in ("output", "report"))
    return not option.startswith(_DROPPED) and section != "gui_only" and (keeps or not writes)


def write_config(
    config: SumoConfig,
    arm: Path,
    seed: int,
    more: Mapping[str, str] = MappingProxyType({}),
    *,
    keeps: bool = False,
) -> Path:
    """Write the configuration of one arm into its folder.

    ``sumo -c`` with this file simulates the arm with nobody driven by the harness.

    Args:
        config: the configuration that is run.
        arm: the arm's folder.
        seed: seed of SUMO's random numbers.
        more: further options; an additional file comes after those of the configuration.
        keeps: whether the outputs that the configuration's own options name are written, and
            everybody's states; all outputs come into the folder, by their names without a folder.

    Returns:
        The path of the file.
    """
    arm.mkdir(parents=True, exist_ok=True)
    options = {name: value for name, value in config.options.items() if _is_kept(name, keeps)}
    prefix = f"{_TO_THE_ROOT}{arm.absolute().as_posix()}/"
    ours = {**_ALWAYS, "seed": str(seed), "output-prefix": prefix}
    files = filter(None, [each.get("additional-files") for each in (options, more)])
    if together := ",".join(files):
        ours["additional-files"] = together
    if keeps:
        ours["fcd-output"] = STATES_FILE
    return write_options(arm.absolute() / CONFIG_FILE, {**options, **more, **ours})


def run_untouched(config: SumoConfig, folder: Path, more: Mapping[str, str]) -> None:
    """Simulate a configuration with nobody driven, with further options, in another process.

    Raises:
        InputError: SUMO fails.
    """
    path = write_config(config, folder, config.seed, more)
    try:
        run_program("sumo", ["-c", str(path)])
    except EngineError as error:
        raise InputError(str(config.path), str(error)) from None


def check_routes(config: SumoConfig) -> None:
    """Refuse a configuration with a route that SUMO cannot build.

    Raises:
        InputError: SUMO does not begin with all routes loaded.
    """
    with scratch_folder() as scratch:
        now = {"route-steps": "0", "end": f"{config.begin_s + config.step_s:.3f}"}
        run_untouched(config, Path(scratch), now)


class Trip(NamedTuple):
    """A vehicle's trip.

    Attributes:
        vehicle, type: the vehicle, and its vType.
        depart_s, arrival_s: when it began and ended; None if it did not.
        depart_delay_s: the time for which it waited to depart.
        time_loss_s: the time that it lost on its way.
    """

    vehicle: str
    type: str
    depart_s: float | None
    arrival_s: float | None
    depart_delay_s: float
    time_loss_s: float


class Seen(NamedTuple):
    """A vehicle, or a person on foot, at the end of a step.

    Attributes:
        name: SUMO's id; a vehicle and a person may have the same.
        vehicle_type: the vehicle's vType; None: a person.
        time_s: the time at the step's end.
        x_m, y_m: the place in the network.
        heading_rad: counter-clockwise from the network's x axis.
        speed_mps: the speed.
    """

    name: str
    vehicle_type: str | None
    time_s: float
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float


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
            yield Seen(of["id"], kind, time_s, x, y, math.radians(90.0 - angle_deg), speed_mps)


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
