"""The passages over crosswalks in a recording, and the walks of people over them."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.core.encounter import FloatArray, StepMotion
from harness.encounter.simulation.passages import PersonTrack, VehicleTrack
from harness.site import Crosswalk, RoadNetwork, WayOver

if TYPE_CHECKING:
    import pandas as pd

RANGE_M = 50.0
"""A passage begins this far before the crosswalk, or where the way begins to be straight."""
LONGEST_M = 60.0
"""Vehicles are kept this far beyond a crosswalk, where the rear of a long vehicle has left it."""

Pair = tuple[str, str]


@dataclass(frozen=True)
class Cut:
    """One vehicle's records on a way over a crosswalk."""

    way: WayOver
    vehicle: str
    track: VehicleTrack


def wanted_lanes(network: RoadNetwork, crosswalks: Sequence[Crosswalk]) -> frozenset[str]:
    """Ids of the lanes whose vehicles are near a crosswalk: all lanes of an edge on a way."""
    edges = {
        each.edge
        for crosswalk in crosswalks
        for way in crosswalk.ways
        for each in way.lanes
        if each.start_m < LONGEST_M and each.end_m > -RANGE_M
    }
    return frozenset(
        lane.getID() for edge in edges for lane in network.net.getEdge(edge).getLanes()
    )


def wanted_edges(crosswalks: Sequence[Crosswalk]) -> frozenset[str]:
    """Ids of the crossings and of the walking areas at their ends."""
    return frozenset({each.id for each in crosswalks}.union(*(each.areas for each in crosswalks)))


def ways_by_edges(
    network: RoadNetwork, crosswalks: Sequence[Crosswalk]
) -> Mapping[Pair, tuple[WayOver, ...]]:
    """The ways over crosswalks by pairs of successive edges on which a vehicle may be recorded.

    In a long step a vehicle may pass a short edge without a record there.  So two edges with one
    such edge between them belong to the way too, unless they are connected.
    """
    ways: dict[Pair, list[WayOver]] = defaultdict(list)
    skipping: dict[Pair, list[WayOver]] = defaultdict(list)
    for way in (way for crosswalk in crosswalks for way in crosswalk.ways):
        ways[way.from_edge, way.to_edge].append(way)
        roads = [each.edge for each in way.lanes if not each.edge.startswith(":")]
        place = roads.index(way.from_edge)
        before, after = roads[max(place - 1, 0) : place + 1], roads[place + 1 : place + 3]
        for pair in {(first, second) for first in before for second in after}:
            if pair != (way.from_edge, way.to_edge) and not _connected(network, *pair):
                skipping[pair].append(way)
    return {pair: tuple(each) for pair, each in (skipping | ways).items()}


def _connected(network: RoadNetwork, first: str, second: str) -> bool:
    outgoing = network.net.getEdge(first).getOutgoing()
    return any(edge.getID() == second for edge in outgoing)


def step_of(vehicles: "pd.DataFrame") -> float:
    """The time between two records of a vehicle, in s: the most frequent one; 0 without any."""
    taken = vehicles.groupby("id", sort=False)["time_s"].diff().round(6)
    taken = taken[taken > 0]
    return float(taken.mode().iloc[0]) if len(taken) else 0.0


def cuts_of(
    vehicles: "pd.DataFrame", ways: Mapping[Pair, tuple[WayOver, ...]], step_s: float
) -> Iterator[Cut]:
    """Every vehicle's records on every way that it takes over a crosswalk.

    Args:
        vehicles: the records of ``read_recorded``.
        ways: the result of ``ways_by_edges``.
        step_s: time between two records; after a longer gap a vehicle counts as another one.
    """
    rows = vehicles.sort_values("time_s", kind="stable")
    for name, own in rows.groupby("id", sort=True):
        own = own.drop_duplicates("time_s")
        time_s = own["time_s"].to_numpy(float)
        breaks = np.flatnonzero(np.diff(time_s) > 1.5 * step_s) + 1
        bounds = [0, *breaks.tolist(), len(own)]
        lanes = own["lane"].to_numpy()
        columns = (time_s, own["pos"].to_numpy(float), own["speed"].to_numpy(float))
        for first, end in pairwise(bounds):
            part = slice(first, end)
            yield from _cuts(str(name), lanes[part].tolist(), [c[part] for c in columns], ways)


def _cuts(
    name: str,
    lanes: list[str],
    columns: list[FloatArray],
    ways: Mapping[Pair, tuple[WayOver, ...]],
) -> Iterator[Cut]:
    """The cuts of records without a gap."""
    edges = [lane.rpartition("_")[0] for lane in lanes]
    positions_m = columns[1].tolist()
    last: int | None = None
    for number, edge in enumerate(edges):
        if edge.startswith(":"):
            continue
        if last is not None and edge != edges[last]:
            by_crosswalk: dict[str, list[WayOver]] = defaultdict(list)
            for way in ways.get((edges[last], edge), ()):
                by_crosswalk[way.crosswalk].append(way)
            fit = partial(_fit, lanes[last : number + 1], positions_m[last : number + 1])
            for candidates in by_crosswalk.values():
                way = max(candidates, key=fit)
                track = _track(way, number, edges, columns)
                if track is not None:
                    yield Cut(way, name, track)
        last = number


def _fit(lanes: Sequence[str], positions_m: Sequence[float], way: WayOver) -> tuple[bool, int]:
    """How well a way fits a vehicle that may change lane at a junction.

    Args:
        lanes: the lane of each record, from the last one before the junction to the first beyond.
        positions_m: the position on that lane of each record.
        way: a way over a crosswalk of the junction.

    Returns:
        Whether the vehicle is on the way when its front comes to the crosswalk's centre line, and
        the number of its lanes that belong to the way.
    """
    names = {each.lane for each in way.lanes}
    at = lanes[0]
    for lane, position_m in zip(lanes[:-1], positions_m[:-1], strict=True):
        place_m = way.place_m(lane.rpartition("_")[0], position_m)
        if place_m is not None and place_m < 0.0:
            at = lane
    return at in names, len(names.intersection(lanes))


def _track(
    way: WayOver, middle: int, edges: list[str], columns: list[FloatArray]
) -> VehicleTrack | None:
    """The records on a way around one of them; None if they do not begin before the crosswalk."""
    time_s, position_m, speed_mps = columns
    range_m = min(RANGE_M, way.straight_before_m)
    places: dict[int, float] = {}
    for steps in (range(middle, -1, -1), range(middle + 1, len(edges))):
        for number in steps:
            place_m = way.place_m(edges[number], float(position_m[number]))
            if place_m is None:
                break
            places[number] = place_m
            if not -range_m <= place_m <= LONGEST_M:
                break
    numbers = sorted(places)
    x_m = np.array([places[number] for number in numbers])
    if len(numbers) < 2 or x_m[0] >= -way.crossing.width_m / 2 or np.any(np.diff(x_m) < -0.1):
        return None
    return VehicleTrack(time_s[numbers], np.maximum.accumulate(x_m), speed_mps[numbers])


def motion_of(cuts: Sequence[Cut], step_s: float) -> tuple[StepMotion, bool]:
    """How the vehicles of a recording moved between two records, and whether the records show it.

    Either Euler's rule (the new speed) or the ballistic rule (the mean of both speeds) gives the
    distance of a step.  If neither does, the records are further apart than the steps of the
    simulation, and only the positions show how the vehicle moved.
    """
    moved, before, after = (np.concatenate(each) for each in _steps(cuts))
    changing = np.abs(after - before) > 0.05
    if not changing.any():
        return "euler", True
    euler = np.abs(moved - after * step_s)[changing]
    ballistic = np.abs(moved - (after + before) / 2 * step_s)[changing]
    motion: StepMotion = "euler" if np.median(euler) <= np.median(ballistic) else "ballistic"
    off = euler if motion == "euler" else ballistic
    return motion, bool(np.median(off) < 0.011 + 0.01 * step_s)


def _steps(cuts: Sequence[Cut]) -> tuple[list[FloatArray], list[FloatArray], list[FloatArray]]:
    tracks = [cut.track for cut in cuts]
    return (
        [np.empty(0), *(np.diff(track.x_m) for track in tracks)],
        [np.empty(0), *(track.speed_mps[:-1] for track in tracks)],
        [np.empty(0), *(track.speed_mps[1:] for track in tracks)],
    )


def by_places(track: VehicleTrack) -> VehicleTrack:
    """A track with the mean speeds between its positions."""
    driven = np.diff(track.x_m) / np.diff(track.time_s)
    return VehicleTrack(track.time_s, track.x_m, np.concatenate((track.speed_mps[:1], driven)))


def people_over(
    people: "pd.DataFrame", crosswalks: Sequence[Crosswalk], step_s: float
) -> dict[str, list[PersonTrack]]:
    """The walks over each crosswalk, in the order in which they begin.

    A walk has successive records on the crossing, the records on the walking area before them, and
    the first record after them.
    """
    ids = {each.id for each in crosswalks}
    walks: dict[str, list[PersonTrack]] = {each.id: [] for each in crosswalks}
    for name, own in people.sort_values("time_s", kind="stable").groupby("id", sort=True):
        own = own.drop_duplicates("time_s")
        time_s = own["time_s"].to_numpy(float)
        x_m, y_m = own["x"].to_numpy(float), own["y"].to_numpy(float)
        edges: list[Any] = own["edge"].tolist()
        begin = 0
        number = 0
        while number < len(edges):
            if number and time_s[number] - time_s[number - 1] > 1.5 * step_s:
                begin = number
            edge, end = edges[number], number + 1
            if edge not in ids:
                number += 1
                continue
            near = 1.5 * step_s
            while end < len(edges) and edges[end] == edge and time_s[end] - time_s[end - 1] <= near:
                end += 1
            on = np.zeros(len(edges), dtype=bool)
            on[number:end] = True
            beyond = end < len(edges) and time_s[end] - time_s[end - 1] <= near
            part = slice(begin, end + beyond)
            walks[edge].append(PersonTrack(str(name), time_s[part], x_m[part], y_m[part], on[part]))
            begin = number = end
    for each in walks.values():
        each.sort(key=lambda walk: (float(walk.time_s[walk.on_crossing][0]), walk.id))
    return walks
