"""The zones of the chosen crosswalks, and the lanes from which vehicles come to them."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache

from harness.core.encounter import Crossing
from harness.site.path import Path
from harness.site.town import Connection, Crosswalk, Town
from harness.site.zone import Zone, zone_of

_PATH_M = 40.0
"""Length of a path before the stop line, longer than a body."""


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

    def crosswalks(self, connection: Connection) -> Sequence[Crosswalk]:
        """The chosen crosswalks that a body on this connection may touch."""
        return self._crosswalks.get(connection.id, ())

    def yields(self, connection: Connection) -> bool:
        """Whether SUMO keeps the right of way on a connection.

        It does so except where it would slow down for a chosen crosswalk on which people have
        priority, and no vehicles or people have it elsewhere.
        """
        zebra = any(each.prioritized for each in self.crosswalks(connection))
        return connection.gives_way or connection.id in self._minds or not zebra

    @cache  # noqa: B019 - as long as the simulation
    def path(self, connection: Connection) -> Path:
        """The path of a connection."""
        return self.town.path(connection, _PATH_M)

    @cache  # noqa: B019
    def at(
        self, connection: Connection, crosswalk: Crosswalk, length_m: float, width_m: float
    ) -> tuple[Zone, Crossing] | None:
        """The zone of a vehicle of this size, and its crossing in the straight frame.

        The lane is as much wider than the body's zone as the approach lane is wider than the
        vehicle, as on a straight road.
        """
        zone = zone_of(self.path(connection), crosswalk, length_m, width_m, self._step_s)
        if zone is None:
            return None
        more_m = self.town.lane_width_m(connection.from_lane) - width_m
        wide_m = zone.to_m - zone.from_m + max(more_m, 0.0)
        return zone, replace(zone.crossing, lane_width_m=wide_m)

    def upstream(self, edges: Iterable[str], reach_m: float) -> Sequence[str]:
        """The edges from which a vehicle comes to the end of one of these within a distance."""
        town = self.town
        away_m = dict.fromkeys(edges, 0.0)
        todo = [*away_m]
        while todo:
            edge = todo.pop()
            lengths_m = (town.lane(each).length_m for each in town.lanes(edge))
            through_m = away_m[edge] + min(lengths_m, default=0.0)
            for before in town.before(edge) if through_m <= reach_m else ():
                if through_m < away_m.get(before, math.inf):
                    away_m[before] = through_m
                    todo.append(before)
        return sorted(away_m)
