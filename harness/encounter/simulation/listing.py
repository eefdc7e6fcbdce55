"""The crosswalks of a user's scenario with who passes them; a scenario file for some of them."""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import InputError, nearest_name
from harness.encounter.simulation.counting import CrosswalkCount, count
from harness.engine.simulation.outputs import NOTHING, Kept
from harness.engine.simulation.running import check_starts, write_config
from harness.scenario.sections import EgoSection
from harness.site.configuration import (
    LONGEST_STEP_S,
    SHORTER_STEP_S,
    SumoConfig,
    people_come,
    read_config,
)
from harness.site.crosswalks import Crosswalk, crosswalks_of
from harness.site.road_network import RoadNetwork, read_network
from harness.site.simulation import setting_at

_COMFORTABLE_MPS2 = 2.0
"""R0 of a written scenario lets a vehicle stop from the speed limit with this deceleration."""

_SHOWN = 5
"""Number of crosswalks that a refusal lists."""


@dataclass(frozen=True)
class CrosswalkRow:
    """A crosswalk of a scenario.

    Attributes:
        edge: id of the crossing's edge.
        streets: names of the edges that it crosses, or their ids.
        problem: why it cannot be chosen, or None.
        length_m: distance from kerb to kerb.
        speed_limit_mps: highest limit of the lanes straight over it; None without such a lane.
        straight_m: shortest straight part before the crosswalk of the lanes on which vehicles came
            straight on; None if nobody did.
        vehicles_per_hour: vehicles that passed it; None if nothing was simulated.
        straight_per_hour: vehicles that passed it straight on.
        people_per_hour: people who walked over it.
    """

    edge: str
    streets: tuple[str, ...]
    problem: str | None
    length_m: float
    speed_limit_mps: float | None
    straight_m: float | None
    vehicles_per_hour: float | None = None
    straight_per_hour: float | None = None
    people_per_hour: float | None = None

    @property
    def usable(self) -> bool:
        """Whether it can be chosen."""
        return self.problem is None


@dataclass(frozen=True)
class OwnScenario:
    """A user's scenario and its crosswalks."""

    config: SumoConfig
    network: RoadNetwork
    crosswalks: tuple[Crosswalk, ...]


def is_configuration(file: Path) -> bool:
    """Whether a file is a SUMO configuration by its name."""
    return file.suffix in (".sumocfg", ".cfg")


def own_scenario(path: Path, folder: Path) -> OwnScenario:
    """Read a configuration, and refuse it if SUMO does.

    Args:
        path: the configuration's file; its step may have any length.
        folder: a temporary folder.

    Raises:
        InputError: the configuration cannot be simulated, or its network is damaged.
    """
    config = read_config(path, SHORTER_STEP_S)
    check_starts(write_config(config, Kept(folder, NOTHING), config.seed, None), str(path))
    network = read_network(config.net)
    return OwnScenario(config, network, crosswalks_of(network))


def crosswalk_rows(
    scenario: OwnScenario,
    folder: Path,
    progress: Callable[[float, float | None], None],
) -> tuple[list[CrosswalkRow], float]:
    """Every crosswalk with vehicles and people per hour, in one untouched run, and its length in s.

    Usable crosswalks come first.  They are sorted by the product of vehicles straight on and people
    per hour, largest first.

    Args:
        scenario: the scenario.
        folder: a temporary folder.
        progress: called with the simulated time and the end, in s.

    Raises:
        EngineError: SUMO lost the simulation.
    """
    counts, simulated_s = count(scenario.config, scenario.crosswalks, folder, progress)
    rows = [
        _row(scenario.network, crosswalk, counts[crosswalk.id]) for crosswalk in scenario.crosswalks
    ]
    return sorted(rows, key=_rank), simulated_s


def _rank(row: CrosswalkRow) -> tuple[bool, float, float, str]:
    straight, people = row.straight_per_hour or 0.0, row.people_per_hour or 0.0
    return not row.usable, -straight * people, -straight - people, row.edge


def _row(network: RoadNetwork, crosswalk: Crosswalk, counted: CrosswalkCount) -> CrosswalkRow:
    ways = crosswalk.straight_ways
    return CrosswalkRow(
        edge=crosswalk.id,
        streets=_streets(network, crosswalk),
        problem=crosswalk.problem,
        length_m=crosswalk.length_m,
        speed_limit_mps=max((way.crossing.speed_limit_mps or 0.0 for way in ways), default=None),
        straight_m=counted.straight_m,
        vehicles_per_hour=counted.vehicles,
        straight_per_hour=counted.straight,
        people_per_hour=counted.people,
    )


def _streets(network: RoadNetwork, crosswalk: Crosswalk) -> tuple[str, ...]:
    roads = network.crossings[crosswalk.id].getCrossingEdges()
    return tuple(dict.fromkeys(road.getName() or road.getID() for road in roads))


def simulation_text(
    scenario: OwnScenario, edges: Sequence[str], config: Path
) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
    """A commented scenario file for some crosswalks, what else is chosen, and what is not driven.

    The second value has the crosswalks that are chosen with them.  The third one has a sentence
    for each crosswalk with an approach that bends within the R0 of the file.

    Args:
        scenario: the scenario.
        edges: ids of the crosswalks.
        config: path of the configuration, as it appears in the scenario file.

    Raises:
        InputError: a crosswalk does not exist or cannot be chosen.
    """
    known = {crosswalk.id: crosswalk for crosswalk in scenario.crosswalks}
    for edge in edges:
        _check(edge, known)
    chosen = [known[edge] for edge in dict.fromkeys(edges)]
    step_s = scenario.config.step_s
    shortened = step_s > LONGEST_STEP_S + 1e-9
    range_m = _range_m(chosen)
    ids = tuple(crosswalk.id for crosswalk in chosen)
    path = scenario.config.path
    setting = setting_at(path, SHORTER_STEP_S if shortened else None, ids, range_m, "--edge")
    lines = [f"# {crosswalk.id}: {_described(scenario, crosswalk)}" for crosswalk in chosen]
    lines += [f"# {name} is chosen with them: it lies within R0 of one." for name in setting.added]
    text = _SCENARIO.format(
        crosswalks="\n".join(lines),
        config=_quoted(config.as_posix()),
        crossings=", ".join(map(_quoted, ids)),
        step=_STEP.format(step=f"{SHORTER_STEP_S:g}", given=f"{step_s:g}") if shortened else "",
        range=f"{range_m:.1f}",
        people="" if people_come(scenario.config) else _PEOPLE,
    )
    return text, setting.added, tuple(_bends(setting.crosswalks, range_m))


def _bends(crosswalks: Iterable[Crosswalk], range_m: float) -> Iterator[str]:
    """A sentence for each crosswalk with an approach whose straight part is shorter than R0."""
    for crosswalk in crosswalks:
        ways = [way for way in crosswalk.straight_ways if not way.oblique]
        way = min(ways, key=lambda way: way.straight_before_m, default=None)
        if way is not None and way.straight_before_m < range_m:
            yield (
                f"{crosswalk.id}: {way.approach} is straight for {way.straight_before_m:.1f} m "
                f"only; no strategy drives there, because R0 = {range_m:g} m"
            )


def _check(edge: str, known: dict[str, Crosswalk]) -> None:
    if edge not in known:
        some = ", ".join([*known][:_SHOWN]) + ", …" * (len(known) > _SHOWN)
        near = nearest_name(edge, known)
        raise InputError("--edge", f"no crossing {edge!r}", some or "there are none", near)
    if problem := known[edge].problem:
        raise InputError(f"--edge {edge}", problem)


def _range_m(crosswalks: Sequence[Crosswalk]) -> float:
    """R0: enough to stop comfortably if the straight approach of every crosswalk is that long."""
    ways = [[way for way in each.straight_ways if not way.oblique] for each in crosswalks]
    fastest_mps = max(way.crossing.speed_limit_mps or 0.0 for over in ways for way in over)
    wanted_m = 5.0 * math.ceil(fastest_mps**2 / (2 * _COMFORTABLE_MPS2) / 5.0)
    straight_m = min(max(way.straight_before_m for way in over) for over in ways)
    wanted_m = max(wanted_m, EgoSection().trigger_range_m)
    return min(wanted_m, max(1.0, math.floor(straight_m)))


def _described(scenario: OwnScenario, crosswalk: Crosswalk) -> str:
    ways = crosswalk.straight_ways
    limit_mps = max(way.crossing.speed_limit_mps or 0.0 for way in ways)
    streets = " / ".join(_streets(scenario.network, crosswalk))
    return (
        f"{' '.join(streets.split())}, {crosswalk.length_m:.1f} m from kerb to kerb, "
        f"limit {3.6 * limit_mps:.4g} km/h"
    )


def _quoted(text: str) -> str:
    """A string of TOML; JSON's escapes are TOML's, too."""
    return json.dumps(text, ensure_ascii=False)


_STEP = """
step_s = {step}               # of both arms; {given} s are too long for a strategy"""
_PEOPLE = """
[pedestrians]
flow_per_hour = 100.0      # nobody comes on foot in the scenario's files: these people are added
"""
_SCENARIO = """# Strategies at crosswalks of a SUMO scenario, which each pair simulates twice.
# Written by `harness crossings`.  The scenario's files stay where they are, and as they are.
{crosswalks}

[simulation]
config = {config}
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
human = "sumo_driver"      # SUMO drives, untouched; human_yield drives at the chosen crosswalks

[experiment]
pairs = 5                  # pair i has the configuration's seed + i, in both arms
# seed = 2                 # other traffic: other SUMO seeds for all pairs
"""
