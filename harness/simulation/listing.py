"""The crosswalks of a configuration, who passes them, and a scenario file for some of them."""

import json
import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from harness.core.errors import EngineError, InputError, nearest_name
from harness.engine.session import Session
from harness.scenario.sections import EgoSection
from harness.simulation.files import Kept, write_config
from harness.site import configuration
from harness.site.town import Connection, Crosswalk, Manoeuvre, Town
from harness.site.zone import zone_of

ROUTES_FILE = "vehroutes.xml"

_COMFORTABLE_MPS2 = 2.0
"""R0 of a written scenario lets a vehicle stop from the speed limit with this deceleration."""
_CAR_M = (5.0, 1.8)
"""Length and width of SUMO's car."""

Progress = Callable[[float, float | None], None]
"""Is told the simulated time and the end, in s."""


@dataclass(frozen=True)
class CrosswalkRow:
    """A crosswalk and who passes it.

    Attributes:
        crosswalk: id of the crossing's edge.
        junction: id of its junction.
        roads: ids of the edges that it crosses.
        prioritized: whether vehicles have to give way to people.
        length_m: distance from kerb to kerb.
        limit_mps: highest speed limit before it; None if no vehicle's connection leads over it.
        connections: number of connections that lead over it, by manoeuvre.
        refused: why no strategy can drive over it; None if it is usable.
        vehicles_per_hour: vehicles that passed it, by manoeuvre; one that passes twice counts
            twice.  None for a network.
        people_per_hour: people who walked over it; each counts once.  None for a network.
    """

    crosswalk: str
    junction: str
    roads: tuple[str, ...]
    prioritized: bool
    length_m: float
    limit_mps: float | None
    connections: Mapping[Manoeuvre, int]
    refused: str | None
    vehicles_per_hour: Mapping[Manoeuvre, float] | None = None
    people_per_hour: float | None = None

    @property
    def usable(self) -> bool:
        """Whether a strategy can drive over it."""
        return self.refused is None


def is_configuration(file: Path) -> bool:
    """Whether a file is a SUMO configuration by its name."""
    return file.suffix in (".sumocfg", ".cfg")


def crossings_of(
    file: Path,
    folder: Path,
    progress: Progress = lambda _time_s, _end_s: None,
) -> list[CrosswalkRow]:
    """Every crosswalk: usable ones first, then by vehicles times people per hour.

    A configuration is simulated once, untouched and with its own step, to count who passes.

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
        return [_row(town, crosswalk) for crosswalk in town.crosswalks.values()]
    config = configuration.read_config(file, configuration.SHORTER_STEP_S)
    town = Town.read(config.net)
    moves, people, hours = _counted(config, town, folder, progress)
    rows = []
    for name, crosswalk in town.crosswalks.items():
        passed: Counter[Manoeuvre] = Counter()
        for ends, manoeuvre in {
            _edges(each): each.manoeuvre for each in town.connections(name, 0.0)
        }.items():
            passed[manoeuvre] += moves[ends]
        per_hour = {manoeuvre: number / hours for manoeuvre, number in passed.items()}
        row, walked = _row(town, crosswalk), len(people[name]) / hours
        rows.append(replace(row, vehicles_per_hour=per_hour, people_per_hour=walked))
    return sorted(rows, key=_rank)


def _rank(row: CrosswalkRow) -> tuple[bool, float, float, str]:
    vehicles, people = sum((row.vehicles_per_hour or {}).values()), row.people_per_hour or 0.0
    return not row.usable, -vehicles * people, -vehicles - people, row.crosswalk


def _row(town: Town, crosswalk: Crosswalk) -> CrosswalkRow:
    over = town.connections(crosswalk.id, 0.0)
    return CrosswalkRow(
        crosswalk=crosswalk.id,
        junction=crosswalk.junction,
        roads=crosswalk.roads,
        prioritized=crosswalk.prioritized,
        length_m=crosswalk.length_m,
        limit_mps=max((town.lane(each.from_lane).limit_mps for each in over), default=None),
        connections=Counter(each.manoeuvre for each in over),
        refused=crosswalk.refused,
    )


def _edges(connection: Connection) -> tuple[str, str]:
    """The edges before and beyond a junction, from the ids of their lanes."""
    return connection.from_lane.rpartition("_")[0], connection.to_lane.rpartition("_")[0]


def _counted(
    config: configuration.SumoConfig, town: Town, folder: Path, progress: Progress
) -> tuple[Counter[tuple[str, str]], Mapping[str, set[str]], float]:
    """Vehicles from edge to edge, who walked over each crosswalk, and the simulated hours."""
    options = {
        "vehroute-output": str(folder.absolute() / ROUTES_FILE),
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
            if time_s >= told_s + 1.0:
                told_s = time_s
                progress(time_s, config.end_s)
    finally:
        session.close()
    hours = max(session.time_s - begin_s, 1e-9) / 3600.0
    return Counter(_moves(folder / ROUTES_FILE)), people, hours


def _moves(file: Path) -> Iterator[tuple[str, str]]:
    """Every change of a vehicle from one edge to the next, in SUMO's file of routes."""
    try:
        for _, element in ET.iterparse(file):
            if element.tag != "vehicle":
                continue
            routes = element.findall(".//route")
            if routes:
                edges = routes[-1].get("edges", "").split()
                times = routes[-1].get("exitTimes", "").split()
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
    rows = [_row(town, _chosen(town, name)) for name in dict.fromkeys(crossings)]
    short = config.step_s <= configuration.LONGEST_STEP_S + 1e-9
    step = "" if short else _STEP.format(configuration.SHORTER_STEP_S, config.step_s)
    walked = configuration.people_come(config)
    return _SCENARIO.format(
        crosswalks="\n".join(f"# {line}" for row in rows for line in _described(town, row)),
        file=_quoted(written.as_posix()),
        crossings=", ".join(_quoted(row.crosswalk) for row in rows),
        step=step,
        range=f"{_range_m(max(row.limit_mps or 0.0 for row in rows)):.1f}",
        people=_THEIRS if walked else _PEOPLE,
        human=_SUMO if walked else _HUMAN,
    )


def _chosen(town: Town, name: str) -> Crosswalk:
    crosswalk = town.crosswalks.get(name)
    if crosswalk is None:
        some = ", ".join([*town.crosswalks][:5]) + ", …" * (len(town.crosswalks) > 5)
        near = nearest_name(name, town.crosswalks)
        raise InputError("--edge", f"no crossing {name!r}", some or "there are none", near)
    if crosswalk.refused is not None:
        allowed = "a crosswalk that `harness crossings` lists as usable"
        raise InputError(f"--edge {name}", crosswalk.refused, allowed)
    return crosswalk


def _range_m(limit_mps: float) -> float:
    """R0: enough to stop comfortably from the limit, and no less than an encounter's."""
    wanted_m = 5.0 * math.ceil(limit_mps**2 / (2 * _COMFORTABLE_MPS2) / 5.0)
    return max(wanted_m, EgoSection().trigger_range_m)


def _described(town: Town, row: CrosswalkRow) -> Iterator[str]:
    """What a crosswalk is like, and what cannot be measured there."""
    ways = ", ".join(f"{number} {name}" for name, number in row.connections.items())
    yield (
        f"{row.crosswalk}: over {' / '.join(row.roads)}, {row.length_m:.1f} m from kerb to kerb, "
        f"limit {3.6 * (row.limit_mps or 0.0):.4g} km/h, "
        f"{'vehicles give' if row.prioritized else 'no zebra: people give'} way; "
        f"connections over it: {ways}"
    )
    crosswalk = town.crosswalks[row.crosswalk]
    for each in town.connections(row.crosswalk):
        zone = zone_of(town.path(each, 0.0), crosswalk, *_CAR_M)
        if zone is not None and zone.split:
            yield f"  a car from {each.from_lane} to {each.to_lane} grazes it only, or twice"


def _quoted(text: str) -> str:
    """A string of TOML; JSON's escapes are TOML's, too."""
    return json.dumps(text, ensure_ascii=False)


_STEP = """
step_s = {:g}               # of both arms; {:g} s are too long for a strategy"""
_PEOPLE = """
[pedestrians]
flow_per_hour = 100.0      # nobody comes on foot in the scenario's files: these people are added
"""
_THEIRS = """
# The people are SUMO's.  Where vehicles do not have to give way, they start only when the vehicle
# stands; where vehicles do, they do not look.  With these lines people of the harness come, too:
# [pedestrians]
# flow_per_hour = 100.0
"""
_SUMO = (
    'human = "sumo_driver"      # SUMO drives, untouched; human_yield drives at these crosswalks'
)
_HUMAN = 'human = "human_yield"'
_SCENARIO = """# Strategies at crosswalks of a SUMO scenario, which each pair simulates twice.
# Written by `harness crossings`.  The scenario's files stay where they are, and as they are.
{crosswalks}

[simulation]
file = {file}
crossings = [{crossings}]
av_share = 1.0             # share of the vehicles of av_types that arms.av drives
av_types = ["passenger"]   # vehicle types, or vehicle classes, that may be AVs{step}
# begin = 300.0            # count trips and passages from this time on, in s; end = … likewise
# outputs = ["tripinfo"]   # outputs of the scenario to keep for each pair and arm

[ego]
trigger_range_m = {range:<9}# R0: from here on the strategy drives
{people}
[arms]
av = "gap_yield"           # `harness strategies` lists all
{human}

[experiment]
pairs = 5                  # pair i has the configuration's seed + i, in both arms
# seed = 2                 # other traffic: other SUMO seeds for all pairs
"""
