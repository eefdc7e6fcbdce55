"""Trips of vehicles and people from SUMO's ``tripinfo`` file."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import EngineError


@dataclass(frozen=True, slots=True)
class Trip:
    """One trip; times in s.

    Attributes:
        name: SUMO's id.
        type_id: the vType.
        person: whether a person travels.
        due_s: scheduled begin of the trip.
        departed: whether it began.
        arrived: whether it ended before the simulation did.
        duration_s: from the time due until the arrival, or until the simulation's end.
        time_loss_s: time lost against the desired speed, with the wait for departure.  For a walk
            that has not ended, it is only the time standing.
    """

    name: str
    type_id: str
    person: bool
    due_s: float
    departed: bool
    arrived: bool
    duration_s: float
    time_loss_s: float


def read_trips(file: Path, end_s: float) -> list[Trip]:
    """Every trip of a simulation, in the file's order.

    A trip that has not ended counts with the time until the end.

    Args:
        file: SUMO's ``tripinfo`` output, with unfinished and undeparted trips.
        end_s: the time at which the simulation ended.

    Raises:
        EngineError: the file is cut off.
    """
    try:
        return [*_trips(file, end_s)]
    except (ET.ParseError, OSError, ValueError) as error:
        raise EngineError(f"SUMO's tripinfo cannot be read: {error}") from None


def _trips(file: Path, end_s: float) -> Iterator[Trip]:
    for _, element in ET.iterparse(file):
        if element.tag == "tripinfo":
            yield _vehicle(element, end_s)
        elif element.tag == "personinfo":
            # SUMO also writes people who were to come after the end, if it has read them.
            if float(element.attrib["depart"]) >= 0:
                yield _person(element, end_s)
        else:
            continue
        element.clear()


def _vehicle(element: ET.Element, end_s: float) -> Trip:
    depart_s, delay_s = float(element.attrib["depart"]), float(element.attrib["departDelay"])
    departed, arrived = depart_s >= 0, float(element.attrib["arrival"]) >= 0
    due_s = depart_s - delay_s if departed else end_s - delay_s
    return Trip(
        name=element.attrib["id"],
        type_id=element.get("vType", ""),
        person=False,
        due_s=due_s,
        departed=departed,
        arrived=arrived,
        duration_s=delay_s + float(element.attrib["duration"]),
        time_loss_s=delay_s + float(element.attrib["timeLoss"]),
    )


def _person(element: ET.Element, end_s: float) -> Trip:
    depart_s, duration_s = float(element.attrib["depart"]), float(element.attrib["duration"])
    arrived = duration_s >= 0
    return Trip(
        name=element.attrib["id"],
        type_id=element.get("type", ""),
        person=True,
        due_s=depart_s,
        departed=True,
        arrived=arrived,
        duration_s=duration_s if arrived else max(0.0, end_s - depart_s),
        time_loss_s=sum(_loss_s(stage) for stage in element),
    )


def _loss_s(stage: ET.Element) -> float:
    """The time lost in a stage; for an unfinished walk, where SUMO writes 0, the time waiting."""
    if stage.tag == "walk" and float(stage.get("arrival", "0")) < 0:
        return _number(stage, "waitingTime")
    return _number(stage, "timeLoss")


def _number(element: ET.Element, name: str) -> float:
    return max(0.0, float(element.get(name, "0")))
