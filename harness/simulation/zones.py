"""The zones of a town's crosswalks, and what lies ahead of a vehicle on its lanes."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

from harness.core.encounter import Crossing
from harness.site.path import Path
from harness.site.town import Connection, Crosswalk, Town
from harness.site.zone import Zone, zone_of

_PATH_M = 40.0
"""Length of a path before the stop line, longer than a body."""


class Link(NamedTuple):
    """A connection ahead, from ``begin_m`` to ``end_m``.

    ``yields``: SUMO keeps the right of way.  It does so except where it would slow down for a
    chosen crosswalk on which people have priority, and no vehicles or people have it elsewhere.
    """

    begin_m: float
    end_m: float
    connection: Connection
    yields: bool

    def moved(self, by_m: float) -> "Link":
        """The same link, ``by_m`` further."""
        return self._replace(begin_m=self.begin_m + by_m, end_m=self.end_m + by_m)


class Zones:
    """The zones of the chosen crosswalks, each computed when a vehicle of that size first comes.

    Args:
        town: the network.
        step_s: length of a step.
        chosen: ids of the crosswalks; None: all.
    """

    def __init__(self, town: Town, step_s: float, chosen: Iterable[str] | None = None) -> None:
        self.town, self._step_s = town, step_s
        self._crosswalks: dict[str, list[Crosswalk]] = {}
        chosen = set(town.crosswalks if chosen is None else chosen)
        for name in chosen:
            for connection in town.connections(name):
                self._crosswalks.setdefault(connection.id, []).append(town.crosswalks[name])
        others = [each for name, each in town.crosswalks.items() if name not in chosen]
        zebras = [each.id for each in others if each.prioritized]
        self._minds = {each.id for name in zebras for each in town.connections(name, 0.0)}
        self._paths: dict[str, Path] = {}
        self._zones: dict[tuple[str, str, float, float], tuple[Zone, Crossing] | None] = {}

    def crosswalks(self, connection: Connection) -> Sequence[Crosswalk]:
        """The chosen crosswalks that a body on this connection may touch."""
        return self._crosswalks.get(connection.id, ())

    def path(self, connection: Connection) -> Path:
        """The path of a connection."""
        path = self._paths.get(connection.id)
        if path is None:
            path = self._paths[connection.id] = self.town.path(connection, _PATH_M)
        return path

    def at(
        self, connection: Connection, crosswalk: Crosswalk, length_m: float, width_m: float
    ) -> tuple[Zone, Crossing] | None:
        """The zone of a vehicle of this size, and its crossing in the straight frame.

        The lane is as much wider than the body's zone as the approach lane is wider than the
        vehicle, as on a straight road.
        """
        key = connection.id, crosswalk.id, length_m, width_m
        if key not in self._zones:
            zone = zone_of(self.path(connection), crosswalk, length_m, width_m, self._step_s)
            found = None
            if zone is not None:
                more_m = self.town.lane_width_m(connection.from_lane) - width_m
                wide_m = zone.to_m - zone.from_m + max(more_m, 0.0)
                found = zone, replace(zone.crossing, lane_width_m=wide_m)
            self._zones[key] = found
        return self._zones[key]

    def ahead(
        self, lanes: Iterable[str], reach_m: float
    ) -> tuple[list[tuple[float, float]], list[Link]]:
        """What lies ahead of a vehicle, by the distance from the beginning of its lane.

        Args:
            lanes: the lanes that it will follow, its own first; without those inside junctions.
            reach_m: distance beyond the end of the first lane up to which it matters.

        Returns:
            Where each lane begins, with its limit; the connections.
        """
        limits: list[tuple[float, float]] = []
        links: list[Link] = []
        town, at_m, last, until_m = self.town, 0.0, "", math.inf
        for name in lanes:
            if last:
                way = next((each for each in town.ahead(last) if each.to_lane == name), None)
                if way is None or at_m > until_m:
                    break
                begin_m = at_m
                for via in way.via:
                    limits.append((at_m, town.lane(via).limit_mps))
                    at_m += town.lane(via).length_m
                zebra = any(each.prioritized for each in self.crosswalks(way))
                yields = way.gives_way or way.id in self._minds or not zebra
                links.append(Link(begin_m, at_m, way, yields))
            limits.append((at_m, town.lane(name).limit_mps))
            at_m += town.lane(name).length_m
            until_m = min(until_m, at_m + reach_m)
            last = name
        return limits, links
