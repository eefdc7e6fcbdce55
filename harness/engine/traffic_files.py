"""The vehicles of ``[traffic]`` in; SUMO's network, routes and configuration, in a folder, out.

``sumo -c`` simulates the configuration, sumo-gui opens it, and it can be the ``file`` of a scenario
with ``[simulation]``.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from harness.core.vocabulary import Vehicle
from harness.engine.configuration import SumoConfig, write_options, write_xml
from harness.engine.network import network_with_limit
from harness.engine.sources import EXIT_M
from harness.engine.starting import OWN_ROADS, vehicle_type
from harness.scenario import Scenario

NET_FILE, ROUTES_FILE, TRAFFIC_FILE = "road.net.xml", "vehicles.rou.xml", "traffic.sumocfg"

CAR_TYPE, ONCOMING_TYPE = "car", "oncoming_car"
"""The types of vehicles.  Oncoming ones have their own on a road with a grade, whose sign is the
other one for them."""

_DIRECTIONS = ("", "oncoming_")
"""How the names of the edges of a direction begin, by its number."""
_LEAVES_M = 120.0
"""Vehicles leave the road this far behind the crosswalk, or farther if they accelerate slowly."""
_STANDS_NEARER_M = {"IDM": 0.4}
"""SUMO's IDM stops this much nearer than its minGap (at 1.61 m for a minGap of 2 m)."""

_STAYS_IN_LANE = {"lcStrategic": -1, "lcCooperative": -1, "lcSpeedGain": 0, "lcKeepRight": 0}


class Due(NamedTuple):
    """A vehicle, and when it is due at the road's upstream end.

    ``direction`` is 0, or 1 for oncoming vehicles.
    """

    name: str
    direction: int
    lane: int
    depart_s: float


def write_traffic(
    scenario: Scenario, due: Iterable[Due], seed: int, end_s: float, folder: Path
) -> SumoConfig:
    """Write the network, the vehicles and the configuration of a pair of ``[traffic]``.

    The same arguments give the same bytes.

    Args:
        scenario: a scenario with ``[traffic]``.
        due: the pair's vehicles.
        seed: SUMO's seed.
        end_s: the end of the simulation.
        folder: the folder; made if missing.

    Raises:
        EngineError: netconvert failed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    # With the real speed limit SUMO's time losses are right.
    (folder / NET_FILE).write_text(network_with_limit(scenario), encoding="utf-8")
    write_xml(folder / ROUTES_FILE, _routes(scenario, due))
    options = {
        "net-file": NET_FILE,
        "route-files": ROUTES_FILE,
        "begin": "0",
        "end": f"{end_s:.3f}",
        "step-length": f"{scenario.experiment.step_s:.3f}",
        "seed": str(seed),
        **OWN_ROADS,
    }
    path = write_options(folder / TRAFFIC_FILE, options)
    files = {key: str(folder.absolute() / options[key]) for key in ("net-file", "route-files")}
    return SumoConfig(path, {**options, **files})


def _routes(scenario: Scenario, vehicles: Iterable[Due]) -> ET.Element:
    """SUMO's file of the vehicles, by the time at which they are due."""
    root, strip = ET.Element("routes"), int(scenario.crossing.kerb_strip_m > 0)
    kinds = types_of(scenario)
    slowest_mps2 = min(vehicle.resume_acceleration_mps2 for vehicle in kinds.values())
    # Twice the way from a stop to v0 at the whole acceleration: IDM approaches v0 slowly.  The
    # last tenth of the road stays free.
    recovers_m = scenario.ego.initial_speed_mps**2 / slowest_mps2
    leaves_m = min(max(_LEAVES_M, recovers_m), 0.9 * EXIT_M)
    for name, vehicle in kinds.items():
        kind = {"id": name, **_type(scenario, vehicle)}.items()
        ET.SubElement(root, "vType", {key: str(value) for key, value in kind})
    for way in _DIRECTIONS[: 1 + (scenario.crossing.oncoming_lanes > 0)]:
        ET.SubElement(root, "route", id=f"{way}way", edges=f"{way}approach {way}exit")
    for due in sorted(vehicles, key=lambda due: (due.depart_s, due.name)):
        way, lane = f"{_DIRECTIONS[due.direction]}way", str(due.lane + strip)
        own = [*kinds][due.direction % len(kinds)]
        values = {"id": due.name, "type": own, "route": way, "depart": f"{due.depart_s:.3f}"}
        values |= {"departLane": lane, "departSpeed": "max"}
        values |= {"arrivalLane": lane, "arrivalPos": f"{leaves_m:.3f}"}
        ET.SubElement(root, "vehicle", values)
    return root


def types_of(scenario: Scenario) -> dict[str, Vehicle]:
    """The limits of each type of vehicle: one, or on a road with a grade one for each direction."""
    kinds = {CAR_TYPE: scenario.vehicle()}
    if scenario.crossing.grade and scenario.crossing.oncoming_lanes:
        kinds[ONCOMING_TYPE] = scenario.vehicle(oncoming=True)
    return kinds


def _type(scenario: Scenario, vehicle: Vehicle) -> Mapping[str, object]:
    """The attributes in SUMO of vehicles with these limits."""
    traffic = scenario.known_traffic
    return {
        **vehicle_type(vehicle, scenario.speed_limit_mps),
        # SUMO lowers commands to it too, so it is the strategies' limit as well.
        "accel": vehicle.resume_acceleration_mps2,
        "maxSpeed": vehicle.initial_speed_mps,
        "carFollowModel": traffic.following,
        "tau": traffic.tau_s,
        "minGap": traffic.min_gap_m + _STANDS_NEARER_M.get(traffic.following, 0.0),
        **_STAYS_IN_LANE,
    }
