"""People whom a scenario adds at its chosen crosswalks; SUMO moves them."""

import hashlib
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path

from harness.core.seeding import stream
from harness.scenario import Scenario
from harness.site.simulation import Setting
from harness.site.site import Footpath

PEOPLE_FILE = "added_people.rou.xml"


def number_of(name: str) -> int:
    """A number ≥ 0 for the streams of a vehicle or crosswalk, from its id alone."""
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=6).digest(), "big")


def write_people(folder: Path, scenario: Scenario, setting: Setting, pair: int) -> str | None:
    """Write SUMO's file of the people whom ``pedestrians.flow_per_hour`` adds.

    Both arms of a pair get the same people.  A Poisson process of the flow λ comes to each named
    crosswalk; its unit exponentials are stretched by 3600/λ, so runs with several λ share them.

    Returns:
        The file's name in the folder; None if nobody is added.
    """
    if not scenario.pedestrians.flow_per_hour:
        return None
    people = sorted(_people(scenario, setting, pair), key=itemgetter(0, 1))
    root = ET.Element("routes")
    for depart_s, name, start, goal in people:
        person = ET.SubElement(root, "person", id=name, depart=f"{depart_s:.3f}")
        person.set("departPos", f"{start.inside_m:.3f}")
        ET.SubElement(
            person, "walk", edges=f"{start.edge} {goal.edge}", arrivalPos=f"{goal.inside_m:.3f}"
        )
    ET.ElementTree(root).write(folder / PEOPLE_FILE, encoding="utf-8", xml_declaration=True)
    return PEOPLE_FILE


def _people(
    scenario: Scenario, setting: Setting, pair: int
) -> Iterator[tuple[float, str, Footpath, Footpath]]:
    config, flow = setting.config, scenario.pedestrians.flows_per_hour[0]
    end_s = config.end_s
    simulation = scenario.known_simulation
    last_s = end_s if end_s is not None else simulation.end
    assert last_s is not None
    for crosswalk in simulation.crossings:
        key = number_of(crosswalk)
        waits = stream(scenario.experiment.seed, "arrival", pair, key)
        sides = stream(scenario.experiment.seed, "side", pair, key)
        ends = setting.footpaths[crosswalk]
        time_s, number = config.begin_s, 0
        while True:
            time_s += float(waits.exponential()) * 3600.0 / flow
            if time_s >= last_s:
                break
            first = sides.random() < scenario.pedestrians.near_side_share
            start, goal = ends if first else ends[::-1]
            yield math.floor(time_s * 1000) / 1000, f"added{crosswalk}-{number}", start, goal
            number += 1
