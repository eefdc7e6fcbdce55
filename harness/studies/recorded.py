"""SUMO's records of vehicles and people in; passages and walks over crosswalks out."""

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

from harness.core.encounter import FloatArray, Vehicle
from harness.core.errors import InputError, reading
from harness.engine.fcd import records
from harness.simulation.cars import PASSED, Car, Passage
from harness.simulation.walked import Axis, Seen, Walked, walked_of
from harness.simulation.zones import Zones
from harness.site.town import Connection, Town

RANGE_M = 50.0
"""A passage begins this far before the crosswalk's centre."""
CUT_OFF = "its records end"
_MOST_DIGITS = 7
_BESIDE_M = 3.0
"""Whoever is first further from a crosswalk is not on it: the file is of another network."""


class Way(NamedTuple):
    """A vehicle or a person from one record to the next, without a gap.

    Attributes:
        id, type: SUMO's.
        runs: its lanes, or a person's edges, in order.  Each has (time, position, speed), or (time,
            x, y), of every record on it, one after another.
    """

    id: str
    type: str
    runs: "list[tuple[str, array[float]]]"


def read_ways(
    files: Sequence[Path], edges: Iterable[str], step_s: float
) -> tuple[list[Way], list[Way]]:
    """The ways of all vehicles, and those of people on some edges.

    Args:
        files: FCD outputs of one simulation.
        edges: crosswalks and walking areas.
        step_s: time between two records.

    Raises:
        InputError: a file is no FCD.
    """
    walked, vehicles, people = frozenset(edges), list[Way](), list[Way]()
    last: dict[tuple[bool, str], Way] = {}
    for file in files:
        for time_s, row in records(file):
            driven = bool(row.get("lane"))
            if not driven and row.get("edge") not in walked:
                continue
            on, a, b = ("lane", "pos", "speed") if driven else ("edge", "x", "y")
            with reading(file):
                name, values = (driven, row["id"]), (time_s, float(row[a]), float(row[b]))
                way = last.get(name)
                if way is None or time_s - way.runs[-1][1][-3] > 1.5 * step_s:
                    way = last[name] = Way(row["id"], row["type"], [])
                    (vehicles if driven else people).append(way)
            if not way.runs or way.runs[-1][0] != row[on]:
                way.runs.append((row[on], array("d")))
            way.runs[-1][1].extend(values)
    return vehicles, people


class Drives:
    """The passages of recorded vehicles over some crosswalks.

    Args:
        zones: the zones of the crosswalks.
        sizes: length, width, acceleration, deceleration and top speed of each type, in m and s.

    Attributes:
        town: the network.
        undefined: the types without a size, which get that of SUMO's car.
        jumps: number of places to which no way leads.
    """

    def __init__(self, zones: Zones, sizes: Mapping[str, Sequence[float]]) -> None:
        self.town, self._zones, self._sizes = zones.town, zones, sizes
        self.undefined, self.jumps = set[str](), 0

    def passages(self, way: Way) -> Iterator[Passage]:
        """The passages of a vehicle, whose places are put on one axis.

        Raises:
            InputError: a lane is not in the network.
        """
        # SUMO names the copy of a type for a single vehicle type@vehicle.
        size = self._sizes.get(way.type) or self._sizes.get(way.type.partition("@")[0])
        self.undefined |= set() if size else {way.type}
        length_m, width_m, gain, loss, most_mps = size or self._sizes["DEFAULT_VEHTYPE"]
        body = Vehicle(1.0, RANGE_M, RANGE_M, length_m, width_m, gain, loss, gain)
        car = Car(way.id, way.type, False, body, 1.0, most_mps)
        last, start_m, links, states = "", 0.0, dict[float, Connection](), list[FloatArray]()
        for lane, of in way.runs:
            at_m, chain = start_m, self._chain(last, lane)
            if last and not chain and _edge(lane) != _edge(last):
                self.jumps += not last.startswith(":")
                yield from self._over(car, np.concatenate(states), links)
                at_m, links, states = 0.0, {}, []
            for each, link in chain:
                if _edge(each) == _edge(lane):
                    # It is inside the junction, and goes on from the lane of this connection.
                    last = link.from_lane
                    break
                if each == link.from_lane:
                    start_m = at_m
                    links[at_m + self.town.lane(each).length_m] = link
                at_m += self.town.lane(each).length_m
            else:
                last, start_m = lane, at_m
            states.append(np.add(np.reshape(of, (-1, 3)), [0.0, at_m, 0.0]))
        yield from self._over(car, np.concatenate(states), links)

    @cache  # noqa: B019 - as long as the recording is measured
    def _chain(self, lane: str, goal: str) -> Sequence[tuple[str, Connection]]:
        """The lanes from one to another edge, with their connections; a long step may pass two."""
        town = self.town
        try:
            town.lane(goal)
        except KeyError:
            allowed = "FCD of this network"
            raise InputError(f"lane {goal}", "is not in the network", allowed) from None
        if not lane or _edge(lane) == _edge(goal):
            return ()
        chains = [[link] for each in town.lanes(_edge(lane)) for link in town.ahead(each)]
        chains += [[link, other] for (link,) in chains for other in town.ahead(link.to_lane)]

        def rank(chain: list[Connection]) -> tuple[bool, ...]:
            inside, right = goal in chain[-1].via, chain[0].from_lane == lane
            return len(chain) == 1, inside, right, goal == chain[-1].to_lane

        ways = [of for of in chains if _edge(goal) in map(_edge, (*of[-1].via, of[-1].to_lane))]
        best = max(ways, key=rank, default=[])
        return [(each, link) for link in best for each in (link.from_lane, *link.via)]

    def _over(
        self, car: Car, states: FloatArray, links: Mapping[float, Connection]
    ) -> Iterator[Passage]:
        """The passages over the crosswalks of connections, by the place of the stop line."""
        body, at_m = car.vehicle, states[:, 1]
        for stop_m, link in links.items():
            for crosswalk in self._zones.crosswalks(link):
                found = self._zones.at(link, crosswalk, body.length_m, body.width_m)
                if found is None:
                    continue
                passage = Passage(car, crosswalk, link, *found, stop_m, body)
                begin_m, last = passage.centre_m - RANGE_M, len(at_m) - 1
                first, end = np.searchsorted(at_m, (begin_m, passage.last_m)).tolist()
                passage.ended = PASSED if end <= last else CUT_OFF
                begin_s = np.interp(begin_m, at_m, states[:, 0])
                passage.trace_offset_s = float(states[min(first, last), 0] - begin_s)
                range_m = min(max(passage.centre_m - float(at_m[0]), 0.1), RANGE_M)
                limit_mps = self.town.lane(link.from_lane).limit_mps
                passage.vehicle = replace(
                    body,
                    initial_speed_mps=car.limit_mps(limit_mps),
                    width_m=passage.zone.to_m - passage.zone.from_m,
                    trigger_range_m=range_m,
                    detection_range_m=range_m,
                )
                for time_s, car.odometer_m, car.speed_mps in states[first : end + 1].tolist():
                    passage.note(time_s)
                yield passage


def walks(ways: Sequence[Way], town: Town, crosswalks: Iterable[str]) -> dict[str, list[Walked]]:
    """Everybody who went over each crosswalk.

    They are seen from the walking area before it until their first place beyond it, which shows
    when they reached the kerb.
    """
    people: dict[str, list[Walked]] = {name: [] for name in crosswalks}
    x = np.array([each for way in ways for _, of in way.runs for each in of[1::3]])
    digits = next((n for n in range(_MOST_DIGITS) if np.allclose(x, x.round(n), 0.0, 1e-9)), 99)
    # A place is off by half of its last digit in both directions.
    rounding_m = 10.0**-digits / 2**0.5
    none = ("", np.empty((0, 3)))
    for way in ways:
        runs = [none, *((edge, np.reshape(of, (-1, 3))) for edge, of in way.runs), none]
        for (_, before), (edge, there), (_, after) in zip(runs, runs[1:], runs[2:], strict=False):
            at = town.crosswalks.get(edge)
            if edge in people and at and at.area.dwithin(shapely.Point(there[0, 1:]), _BESIDE_M):
                places = np.concatenate([before, there, after[:1]])
                on = [len(before) <= i < len(before) + len(there) for i in range(len(places))]
                axis, columns = Axis(at), (array("d", of.tolist()) for of in places.T)
                first_m = axis.along_m(*places[0, 1:].tolist())
                seen = Seen(way.id, len(people[edge]), first_m, *columns, on)
                walked = walked_of(seen, axis, rounding_m)
                people[edge] += [walked] if walked else []
    return people


def _edge(lane: str) -> str:
    return lane.rpartition("_")[0]
