"""Vehicles that change lane before a crosswalk: their passage is measured on the new lane."""

from collections import defaultdict
from collections.abc import Callable
from typing import Any

from harness.encounter.simulation.driving import PassageLog
from harness.encounter.simulation.visits import BENDS, TURNS
from harness.site.simulation import Setting


class LaneChanges:
    """Moves the passage of a vehicle that has changed lane to the way of its new lane.

    Args:
        setting: the user's simulation with its crosswalks.
        function: gives a function of SUMO by the names of its domain and itself.
    """

    def __init__(self, setting: Setting, function: Callable[[str, str], Any]) -> None:
        self._lane_of = function("vehicle", "getLaneID")
        self._place_of = function("vehicle", "getLanePosition")
        self._ways_on = setting.lanes()
        self._several_lanes = _with_several_lanes(setting)

    def follow(self, passage: PassageLog, driven_m: float) -> None:
        """Measure a passage on the lane on which its vehicle is.

        Args:
            passage: a passage whose front has not reached the crosswalk's centre line.
            driven_m: SUMO's odometer.
        """
        way = passage.driven_way.way
        if (way.crosswalk, way.from_edge) not in self._several_lanes:
            return
        lane = self._lane_of(passage.name)
        passage.astray = None
        if lane in {part.lane for part in way.lanes}:
            return
        for each in self._ways_on.get(lane, ()):
            other = each.way
            if (other.crosswalk, other.from_edge) != (way.crosswalk, way.from_edge):
                continue
            if other.to_edge != way.to_edge:
                continue
            if not other.is_straight(passage.vehicle.length_m):
                passage.astray = BENDS
                return
            start_m = next(part.start_m for part in other.lanes if part.lane == lane)
            x_m = start_m + self._place_of(passage.name)
            passage.move_to(each, x_m - passage.offset_m - driven_m)
            return
        passage.astray = TURNS


def _with_several_lanes(setting: Setting) -> frozenset[tuple[str, str]]:
    """Crosswalk and edge before it, where more than one lane of the edge leads over it."""
    lanes: dict[tuple[str, str], set[str]] = defaultdict(set)
    for way in (way for crosswalk in setting.crosswalks for way in crosswalk.ways):
        lanes[way.crosswalk, way.from_edge].add(way.approach)
    return frozenset(each for each, approaches in lanes.items() if len(approaches) > 1)
