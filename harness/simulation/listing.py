"""The crosswalks of a configuration, who passes them, and a scenario file for some of them."""

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from harness.core.errors import Parameter
from harness.engine.arm_files import Counts, entering
from harness.engine.configuration import people_in, read_config
from harness.engine.ids import lane_of
from harness.engine.protocol import CAR
from harness.scenario.sections import EgoSection
from harness.simulation.opening import chosen, town_of
from harness.site.town import Crosswalk, Town
from harness.site.zone import zone_of

_COMFORTABLE_MPS2 = 2.0
"""R0 of a written scenario lets a vehicle stop from the speed limit with this deceleration."""
_STEP_S = 0.1
"""The greatest step of a written scenario."""
_TEMPLATE = Path(__file__).with_name("scenario.template.toml")
_MANOEUVRES = ("straight", "left", "right", "turn")


class CrosswalkRow(NamedTuple):
    """A crosswalk, who passes it, the road's limit, and why it is refused."""

    crosswalk: str
    roads: str
    vehicles_per_hour: int
    people_per_hour: int
    straight: int
    left: int
    right: int
    turn: int
    priority: str
    length_m: float
    limit_mps: float | None
    refused: str | None


def crossings_of(file: Path, folder: Path) -> tuple[list[CrosswalkRow], list[CrosswalkRow]]:
    """The usable crosswalks and the others, with who passes per hour, by vehicles × people.

    Who passes twice counts twice.  The configuration is simulated once, untouched and with its own
    step.

    Args:
        file: a SUMO configuration (.sumocfg).
        folder: a temporary folder.

    Raises:
        InputError: the file is refused, or SUMO fails.
    """
    config = read_config(file)
    crosswalks, counts = town_of(config).crosswalks, entering(config, folder.absolute())
    rows = sorted((_row(each, counts) for each in crosswalks.values()), key=_rank)
    usable = [row for row in rows if row.refused is None]
    return usable, [row for row in rows if row.refused is not None]


def _rank(row: CrosswalkRow) -> tuple[int, int]:
    vehicles, people = row.vehicles_per_hour, row.people_per_hour
    return -vehicles * people, -vehicles - people


def _row(crosswalk: Crosswalk, counts: Counts) -> CrosswalkRow:
    ways = dict.fromkeys(_MANOEUVRES, 0.0)
    for each in crosswalk.over:
        ways[each.manoeuvre] += counts["vehicles"].get(each.via[0], 0.0)
    limits = crosswalk.limits_mps
    people = round(counts["people"].get(lane_of(crosswalk.id), 0.0))
    numbers = round(sum(ways.values())), people, *(round(ways[name]) for name in _MANOEUVRES)
    priority = "people" if crosswalk.prioritized else "vehicles"
    length_m, limit_mps = round(crosswalk.length_m, 1), round(limits[-1], 1) if limits else None
    roads = " / ".join(crosswalk.roads)
    row = crosswalk.id, roads, *numbers, priority, length_m, limit_mps, crosswalk.refused
    return CrosswalkRow._make(row)


def scenario_text(file: Path, edges: Sequence[str], written: Path) -> str:
    """A commented scenario file for some crosswalks of a configuration.

    Args:
        file: the configuration's file.
        edges: ids of the crosswalks.
        written: path of the configuration as it is to stand in the scenario file.

    Raises:
        InputError: the configuration is refused, or a crosswalk is not there or not usable.
    """
    config = read_config(file)
    town = town_of(config)
    crosswalks = [chosen(town, name, Parameter("edges")) for name in dict.fromkeys(edges)]
    walked = any(people_in(config))
    return _TEMPLATE.read_text(encoding="utf-8").format(
        crosswalks="\n".join(f"# {line}" for each in crosswalks for line in _described(town, each)),
        file=_quoted(written.as_posix()),
        crossings=", ".join(_quoted(each.id) for each in crosswalks),
        step=min(config.step_s, _STEP_S),
        range_m=_range_m(max(each.limits_mps[-1] for each in crosswalks)),
        people="# " if walked else "",
        human="sumo_driver" if walked else "human_yield",
    )


def _range_m(limit_mps: float) -> float:
    """R0, whole 5 m: enough to stop comfortably from the limit, no less than an encounter's."""
    wanted_m = 5.0 * math.ceil(limit_mps**2 / (2 * _COMFORTABLE_MPS2) / 5.0)
    return max(wanted_m, EgoSection().trigger_range_m)


def _described(town: Town, crosswalk: Crosswalk) -> Iterator[str]:
    """What a crosswalk is like, and what cannot be measured there."""
    gives_way = "vehicles give way" if crosswalk.prioritized else "no zebra: people give way"
    yield f"{crosswalk.id} over {' / '.join(crosswalk.roads)}: {gives_way}"
    for each in crosswalk.connections:
        zone = zone_of(town.path(each), crosswalk, CAR.length_m, CAR.width_m)
        if zone is not None and zone.split:
            yield f"  a car from {each.from_lane} to {each.to_lane} grazes it only, or twice"


def _quoted(text: str) -> str:
    """A string of TOML; JSON's escapes are TOML's, too."""
    return json.dumps(text, ensure_ascii=False)
