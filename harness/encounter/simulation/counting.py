"""A user's scenario in; vehicles and people per hour at each crosswalk out, from one run."""

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import EngineError
from harness.engine.simulation.outputs import Kept
from harness.engine.simulation.running import OwnSimulation, write_config
from harness.site.configuration import SumoConfig
from harness.site.crosswalks import Crosswalk

ROUTES_FILE = "vehroutes.xml"


@dataclass(frozen=True, slots=True)
class CrosswalkCount:
    """The number of vehicles and people that pass a crosswalk.

    ``vehicles`` and ``people`` are per hour; ``straight`` is the number of vehicles per hour that
    went straight on.  A vehicle that passes twice counts twice; a person counts once.
    ``straight_m`` is the straight length of the approach, of those from which a vehicle went
    straight on, that has the shortest; None if no vehicle did.
    """

    vehicles: float
    straight: float
    people: float
    straight_m: float | None


def count(
    config: SumoConfig,
    crosswalks: Sequence[Crosswalk],
    folder: Path,
    progress: Callable[[float, float | None], None] = lambda _time_s, _end_s: None,
) -> tuple[dict[str, CrosswalkCount], float]:
    """Simulate a scenario once, untouched; return every crosswalk's count and the simulated s.

    Args:
        config: the scenario; it is simulated with its own step.
        crosswalks: the crosswalks of its network.
        folder: a temporary folder for SUMO's files.
        progress: called with the simulated time and the end, in s, after every simulated second.

    Raises:
        EngineError: SUMO refused or lost the simulation.
    """
    options = {
        "vehroute-output": str(folder / ROUTES_FILE),
        "vehroute-output.exit-times": "true",
        "vehroute-output.write-unfinished": "true",
        # The user's options of this output must not leave out a route or a part of it.
        "vehroute-output.last-route": "false",
        "vehroute-output.skip-ptlines": "false",
    }
    path = write_config(config, Kept(folder, frozenset()), config.seed, None, more=options)
    simulation = OwnSimulation(path, config.end_s)
    people: dict[str, set[str]] = {crosswalk.id: set() for crosswalk in crosswalks}
    persons_on = simulation.api.edge.getLastStepPersonIDs
    begin_s = told_s = simulation.time_s
    try:
        while simulation.goes_on:
            time_s = simulation.step()
            for crossing, names in people.items():
                names.update(persons_on(crossing))
            if time_s >= told_s + 1.0:
                told_s = time_s
                progress(time_s, config.end_s)
    finally:
        simulation.close()
    simulated_s = simulation.time_s - begin_s
    hours = max(simulated_s, 1e-9) / 3600.0
    moves = Counter(_moves(folder / ROUTES_FILE))
    counts = {}
    for crosswalk in crosswalks:
        ways = {(way.from_edge, way.to_edge) for way in crosswalk.ways}
        straight = {(way.from_edge, way.to_edge) for way in crosswalk.straight_ways}
        used = [way for way in crosswalk.straight_ways if moves[way.from_edge, way.to_edge]]
        counts[crosswalk.id] = CrosswalkCount(
            sum(moves[way] for way in ways) / hours,
            sum(moves[way] for way in straight) / hours,
            len(people[crosswalk.id]) / hours,
            min((way.straight_before_m for way in used), default=None),
        )
    return counts, simulated_s


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
