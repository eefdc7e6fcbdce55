"""The crosswalks of a configuration, who passes them, and a scenario file for some of them."""

import json
import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from harness.core.errors import EngineError, InputError, nearest_name
from harness.engine import configuration
from harness.engine.session import Session
from harness.scenario.sections import EgoSection
from harness.simulation.files import Kept, write_config
from harness.site.town import Connection, Crosswalk, Town
from harness.site.zone import zone_of

_COMFORTABLE_MPS2 = 2.0
"""R0 of a written scenario lets a vehicle stop from the speed limit with this deceleration."""
_CAR_M = (5.0, 1.8)
"""Length and width of SUMO's car."""
_PROGRESS_S = 10.0
_TEMPLATE = Path(__file__).with_name("scenario.template.toml")
_MANOEUVRES = ("straight", "left", "right", "turn")

Row = dict[str, str | float | None]
Progress = Callable[[float, float | None], None]
"""Is told the simulated time and the end, in s."""


Passed = tuple[Counter[tuple[str, str]], Mapping[str, set[str]], float]
"""Vehicles by edges before and beyond, people by crosswalk, and the simulated hours."""


def crossings_of(
    file: Path, folder: Path, progress: Progress = lambda _time_s, _end_s: None
) -> list[Row]:
    """Every crosswalk and who passes it per hour: usable ones first, then by vehicles × people.

    A vehicle that passes twice counts twice; each person counts once.  A configuration is simulated
    once, untouched and with its own step.  Of a network, connections are counted.

    Args:
        file: a SUMO configuration (.sumocfg), or a network.
        folder: a temporary folder.
        progress: called with the simulated time and the end, in s.

    Raises:
        InputError: the file is refused.
        EngineError: SUMO lost the simulation.
    """
    if not is_configuration(file):
        town = Town.read(file)
        return [_row(town, crosswalk, None) for crosswalk in town.crosswalks.values()]
    config = configuration.read_config(file, configuration.SHORTER_STEP_S)
    town = Town.read(config.net)
    passed = _passed(config, town, folder, progress)
    rows = [_row(town, crosswalk, passed) for crosswalk in town.crosswalks.values()]
    return sorted(rows, key=_rank)


def is_configuration(file: Path) -> bool:
    """Whether a file is a SUMO configuration by its name."""
    return file.suffix in (".sumocfg", ".cfg")


def _rank(row: Row) -> tuple[bool, float, float]:
    vehicles, people = float(row["vehicles/h"] or 0), float(row["people/h"] or 0)
    return row["not usable"] is not None, -vehicles * people, -vehicles - people


def _row(town: Town, crosswalk: Crosswalk, passed: Passed | None) -> Row:
    over = town.connections(crosswalk.id, 0.0)
    # Vehicles are known by edges only, and several lanes may join two edges.
    ways, many = Counter[str](each.manoeuvre for each in over), Row()
    if passed is not None:
        moves, people, hours = passed
        numbers = Counter[str]()
        for edges, manoeuvre in {_edges(each): each.manoeuvre for each in over}.items():
            numbers[manoeuvre] += moves[edges]
        ways = Counter({way: round(number / hours) for way, number in numbers.items()})
        walked = round(len(people[crosswalk.id]) / hours)
        many = {"vehicles/h": ways.total(), "people/h": walked}
    limits = [town.lane(each.from_lane).limit_mps for each in over]
    return {
        "crosswalk": crosswalk.id,
        "roads": " / ".join(crosswalk.roads),
        **many,
        **{name: ways[name] for name in _MANOEUVRES},
        "priority": "people" if crosswalk.prioritized else "vehicles",
        "length, m": round(crosswalk.length_m, 1),
        "limit, m/s": round(max(limits), 1) if limits else None,
        "not usable": crosswalk.refused,
    }


def _edges(connection: Connection) -> tuple[str, str]:
    """The edges before and beyond a junction, from the ids of their lanes."""
    return connection.from_lane.rpartition("_")[0], connection.to_lane.rpartition("_")[0]


def _passed(
    config: configuration.SumoConfig, town: Town, folder: Path, progress: Progress
) -> Passed:
    routes = folder.absolute() / "vehroutes.xml"
    options = {
        "vehroute-output": str(routes),
        "vehroute-output.exit-times": "true",
        "vehroute-output.write-unfinished": "true",
        # The user's options of this output must not leave out a route or a part of it.
        "vehroute-output.last-route": "false",
        "vehroute-output.skip-ptlines": "false",
    }
    written = write_config(config, Kept(folder, frozenset()), config.seed, None, options)
    try:
        session = Session(written)
    except EngineError as error:
        raise InputError(str(config.path), str(error)) from None
    people: dict[str, set[str]] = {name: set() for name in town.crosswalks}
    begin_s = told_s = session.time_s
    try:
        while session.goes_on(config.end_s):
            time_s = session.step()
            for name, seen in people.items():
                seen.update(session.people_on(name))
            if time_s >= told_s + _PROGRESS_S:
                told_s = time_s
                progress(time_s, config.end_s)
    finally:
        session.close()
    hours = max(session.time_s - begin_s, 1e-9) / 3600.0
    return Counter(_moves(routes)), people, hours


def _moves(file: Path) -> Iterator[tuple[str, str]]:
    """Every change of a vehicle from one edge to the next, in SUMO's file of routes."""
    try:
        for _, element in ET.iterparse(file):
            if element.tag == "vehicle":
                route = element.findall(".//route")[-1]
                edges, times = route.get("edges", "").split(), route.get("exitTimes", "").split()
                # An edge that was not left has -1; if no edge was left, SUMO writes no times.
                for number, time_s in enumerate(times[: len(edges) - 1]):
                    if float(time_s) >= 0.0:
                        yield edges[number], edges[number + 1]
                element.clear()
    except (ET.ParseError, OSError) as error:
        raise EngineError(f"SUMO's routes cannot be read: {error}") from None


def scenario_text(file: Path, crossings: Sequence[str], written: Path) -> str:
    """A commented scenario file for some crosswalks of a configuration.

    Args:
        file: the configuration's file.
        crossings: ids of the crosswalks.
        written: path of the configuration as it is to stand in the scenario file.

    Raises:
        InputError: the configuration is refused, or a crosswalk is not there or not usable.
    """
    config = configuration.read_config(file, configuration.SHORTER_STEP_S)
    town = Town.read(config.net)
    crosswalks = [chosen(town, name) for name in dict.fromkeys(crossings)]
    ways = [town.lane(way.from_lane) for each in crosswalks for way in town.connections(each.id)]
    walked = configuration.people_come(config)
    return _TEMPLATE.read_text(encoding="utf-8").format(
        crosswalks="\n".join(f"# {line}" for each in crosswalks for line in _described(town, each)),
        file=_quoted(written.as_posix()),
        crossings=", ".join(_quoted(each.id) for each in crosswalks),
        step=min(config.step_s, configuration.SHORTER_STEP_S),
        range_m=_range_m(max(each.limit_mps for each in ways)),
        people="# " if walked else "",
        human="sumo_driver" if walked else "human_yield",
    )


def chosen(town: Town, name: str, where: str = "--edge") -> Crosswalk:
    """The crosswalk that an option or a key names.

    Raises:
        InputError: it is not there, or not usable.
    """
    crosswalk = town.crosswalks.get(name)
    if crosswalk is None:
        some = ", ".join([*town.crosswalks][:5]) + ", …" * (len(town.crosswalks) > 5)
        near = nearest_name(name, town.crosswalks)
        raise InputError(where, f"no crossing {name!r}", some or "there are none", near)
    if crosswalk.refused is not None:
        allowed = "a crosswalk that `harness crossings` lists as usable"
        raise InputError(where, f"{name}: {crosswalk.refused}", allowed)
    return crosswalk


def _range_m(limit_mps: float) -> float:
    """R0: enough to stop comfortably from the limit, and no less than an encounter's."""
    wanted_m = 5.0 * math.ceil(limit_mps**2 / (2 * _COMFORTABLE_MPS2) / 5.0)
    return max(wanted_m, EgoSection().trigger_range_m)


def _described(town: Town, crosswalk: Crosswalk) -> Iterator[str]:
    """What a crosswalk is like, and what cannot be measured there."""
    gives_way = "vehicles give way" if crosswalk.prioritized else "no zebra: people give way"
    yield f"{crosswalk.id} over {' / '.join(crosswalk.roads)}: {gives_way}"
    for each in town.connections(crosswalk.id):
        zone = zone_of(town.path(each, 0.0), crosswalk, *_CAR_M)
        if zone is not None and zone.split:
            yield f"  a car from {each.from_lane} to {each.to_lane} grazes it only, or twice"


def _quoted(text: str) -> str:
    """A string of TOML; JSON's escapes are TOML's, too."""
    return json.dumps(text, ensure_ascii=False)
