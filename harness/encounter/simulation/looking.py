"""The lanes before the chosen crosswalks, with the choice of lanes and vehicles read in a step."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from harness.encounter.deciding import ROUNDING_M
from harness.site.simulation import DrivenWay, Setting

MOST_MPS = 100.0
"""Upper limit of all speeds: it limits where a vehicle can be after some steps."""


@dataclass(slots=True, eq=False)
class WatchedLane:
    """A lane on which vehicles are between R0 and a chosen crosswalk.

    Attributes:
        name: SUMO's id of the lane.
        ways: by crosswalk, the ways on this lane, each with x at which the lane begins.
        before_m: a vehicle before this position on the lane has not passed R0 of any crosswalk.
        until: last step in which the lane is read; infinite if vehicles may come onto it from
            lanes that are not watched.
        fed: lanes that vehicles reach only from this lane or from other lanes that feed them.  So a
            fed lane is empty if all of its feeding lanes were empty a step ago.
        due: the next step in which each vehicle is read, by vehicle.
        decided: by vehicle, the crosswalks at which nothing remains to be decided on this lane.
    """

    name: str
    ways: dict[str, list[tuple[DrivenWay, float]]]
    before_m: float
    until: float = math.inf
    fed: "list[WatchedLane]" = field(default_factory=list)
    due: dict[str, float] = field(default_factory=dict)
    decided: dict[str, set[str]] = field(default_factory=dict)


Judge = Callable[[str, float, "WatchedLane", float], bool]
"""From vehicle, position, lane and time to whether the vehicle is done with on this lane."""


class Lookout:
    """Finds the vehicles whose front has passed R0 in the last step.

    A lane inside a junction is read only if a vehicle was there, or on a lane that leads there, a
    step ago.  A vehicle is read again as soon as it can have reached R0.

    Args:
        setting: the crosswalks.
        step_s: length of a step.
        on_lane: the vehicles on a lane.
        place: a vehicle's position on its lane.
        lanes_of_edge: the number of lanes of an edge.
        judge: called with each vehicle that has passed R0 of a crosswalk.
    """

    def __init__(
        self,
        setting: Setting,
        step_s: float,
        on_lane: Callable[[str], Sequence[str]],
        place: Callable[[str], float],
        lanes_of_edge: Callable[[str], int],
        judge: Judge,
    ) -> None:
        self._on_lane, self._place, self._judge = on_lane, place, judge
        self._per_step_m = MOST_MPS * step_s
        self._steps = 0
        self.lanes = _watched(setting, self._per_step_m, lanes_of_edge)
        self._always = [lane for lane in self.lanes if lane.until == math.inf]
        self._always_names = [lane.name for lane in self._always]
        self._at_times = [lane for lane in self.lanes if lane.until < math.inf]

    def look(self, time_s: float) -> None:
        """Read lanes and vehicles at the end of a step, and judge vehicles beyond R0."""
        self._steps += 1
        steps = self._steps
        at_times = [lane for lane in self._at_times if lane.until >= steps]
        for lane, names in zip(
            self._always + at_times,
            map(self._on_lane, self._always_names + [lane.name for lane in at_times]),
            strict=True,
        ):
            if names:
                self._read(lane, names, time_s)
            elif lane.due:
                lane.due.clear()
                lane.decided.clear()

    def _read(self, lane: WatchedLane, names: Sequence[str], time_s: float) -> None:
        """Read the vehicles on a lane that are due, and judge those beyond R0."""
        due, steps = lane.due, self._steps
        for fed in lane.fed:
            fed.until = steps + 1
        for name in names:
            if due.get(name, 0) > steps:
                continue
            position_m = self._place(name)
            left_m = lane.before_m - position_m
            if left_m > 0.0:
                due[name] = steps + 1 + int(left_m / self._per_step_m)
            else:
                done = self._judge(name, position_m, lane, time_s)
                due[name] = math.inf if done else steps + 1
        if len(due) > len(names):
            for name in due.keys() - {*names}:
                del due[name]
                lane.decided.pop(name, None)


def _watched(
    setting: Setting, per_step_m: float, lanes_of_edge: Callable[[str], int]
) -> list[WatchedLane]:
    lanes = {}
    for name, ways in setting.lanes().items():
        by_crosswalk: dict[str, list[tuple[DrivenWay, float]]] = {}
        for each in ways:
            start_m = next(part.start_m for part in each.way.lanes if part.lane == name)
            by_crosswalk.setdefault(each.way.crosswalk, []).append((each, start_m))
        farthest = max(start_m for each in by_crosswalk.values() for _, start_m in each)
        before_m = -setting.range_m - farthest - 2 * ROUNDING_M
        lanes[name] = WatchedLane(name, by_crosswalk, before_m)
    for lane in lanes.values():
        # Vehicles neither depart nor change lanes on the only lane of an edge in a junction.
        if lane.name.startswith(":") and lanes_of_edge(lane.name.rpartition("_")[0]) == 1:
            feeders = _feeders(lane, lanes, per_step_m)
            if feeders is not None:
                lane.until = 1
                for feeder in (lane, *feeders):
                    feeder.fed.append(lane)
    return [*lanes.values()]


def _feeders(
    lane: WatchedLane, lanes: dict[str, WatchedLane], per_step_m: float
) -> tuple[WatchedLane, ...] | None:
    """The lanes on which a vehicle may be in the step before it is on this one."""
    feeders: dict[str, WatchedLane] = {}
    for ways in lane.ways.values():
        for each, start_m in ways:
            reach_m = start_m - per_step_m
            parts = [p for p in each.way.lanes if reach_m < p.end_m and p.start_m < start_m]
            if not parts or parts[0].start_m > reach_m or any(p.lane not in lanes for p in parts):
                return None
            feeders |= {part.lane: lanes[part.lane] for part in parts}
    return tuple(feeders.values())
