"""SUMO's records of vehicles and people in; passages and walks over crosswalks out."""

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

from harness.core.errors import InputError
from harness.engine.fcd import FORMATS, Record, records
from harness.simulation.cars import PASSED, Car, Passage
from harness.simulation.walked import Axis, Seen
from harness.simulation.zones import Zones
from harness.site.town import Connection

RANGE_M = 50.0
"""A passage begins this far before the crosswalk's centre."""
_KEPT_M = RANGE_M + 50.0
"""Length of a vehicle's way whose records are kept, longer than a step at most speeds."""
CUT_OFF = "its records end"
_BACK_M = 0.1
"""A vehicle does not drive back further than this."""


@dataclass(slots=True, eq=False)
class _Track:
    """A vehicle whose records go on.

    Attributes:
        car: the vehicle.
        lane: its last lane outside junctions.
        start_m: the odometer at that lane's beginning.
        link: the connection that it is on, or None.
        seen: (time, odometer, speed) of its last ``_KEPT_M``.
        passages: those that go on.
    """

    car: Car
    lane: str
    start_m: float = 0.0
    link: Connection | None = None
    seen: deque[tuple[float, float, float]] = field(default_factory=deque)
    passages: list[Passage] = field(default_factory=list)


class Reader:
    """Follows vehicles and people over some crosswalks.

    Args:
        zones: the zones of the network.
        crosswalks: ids of the crosswalks.
        cars: a vehicle of each type; ``""`` is one of a type that is not defined.
        step_s: time between two records.

    Attributes:
        passages: those that have ended.
        people: everybody who went over each crosswalk.
        undefined: the types without a definition.
        digits: the most decimals of a person's place.
        counts: number of records of vehicles and of people, and of places where a vehicle's
            records jump.
    """

    def __init__(
        self, zones: Zones, crosswalks: Sequence[str], cars: Mapping[str, Car], step_s: float
    ) -> None:
        self._zones, self._town, self._cars = zones, zones.town, cars
        self._gap_s, self._chosen = 1.5 * step_s, frozenset(crosswalks)
        self._axes = {name: Axis(self._town.crosswalks[name]) for name in crosswalks}
        self._areas = {area for name in crosswalks for area in self._town.areas(name)}
        self._tracks: dict[str, _Track] = {}
        self._walkers: dict[str, tuple[str, Seen]] = {}
        self.passages: list[Passage] = []
        self.people: dict[str, list[Seen]] = {name: [] for name in crosswalks}
        self.undefined: set[str] = set()
        self.digits, self.counts = 0, Counter[str]()

    def read(self, path: Path) -> None:
        """Follow everybody in a file.

        Raises:
            InputError: the file is no FCD, or of another network.
        """
        for time_s, row in records(path):
            try:
                if row.get("lane"):
                    self._vehicle(time_s, row)
                elif row.get("edge"):
                    self._person(time_s, row)
            except KeyError as error:
                allowed = "FCD of this network, with all attributes"
                raise InputError(
                    str(path), f"{error} is not in a record, or in the network", allowed
                ) from None
            except (ValueError, TypeError) as error:
                raise InputError(str(path), f"is damaged ({error})", FORMATS) from None
        for track in self._tracks.values():
            self._end(track)
        self._tracks.clear()

    def _vehicle(self, time_s: float, row: Record) -> None:
        self.counts["vehicles"] += 1
        name, lane, speed_mps = str(row["id"]), row["lane"], float(row["speed"])
        track = self._tracks.get(name)
        at_m = None
        if track is not None and time_s - track.seen[-1][0] <= self._gap_s:
            at_m = self._on(track, lane, float(row["pos"]))
            self.counts["jumps"] += at_m is None and not track.lane.startswith(":")
        if track is None or at_m is None:
            if track is not None:
                self._end(track)
            track, at_m = _Track(self._car(name, row), lane), float(row["pos"])
            self._tracks[name] = track
        track.seen.append((time_s, at_m, speed_mps))
        while at_m - track.seen[0][1] > _KEPT_M:
            track.seen.popleft()
        track.car.odometer_m, track.car.speed_mps = at_m, speed_mps
        for passage in [*track.passages]:
            passage.note(time_s)
            if at_m >= passage.last_m:
                passage.ended = PASSED
                track.passages.remove(passage)
                self.passages.append(passage)

    def _car(self, name: str, row: Record) -> Car:
        kind = str(row["type"])
        # SUMO names the copy of a type for a single vehicle type@vehicle.
        known = self._cars.get(kind) or self._cars.get(kind.partition("@")[0])
        if known is None:
            self.undefined.add(kind)
        return replace(known or self._cars[""], name=name, type_id=kind)

    def _on(self, track: _Track, lane: str, position_m: float) -> float | None:
        """The odometer at a vehicle's next place; None if no way leads there."""
        at_m = track.start_m
        if _edge(lane) != _edge(track.lane):
            for link in self._chain(track.lane, lane, track.link):
                at_m += self._town.lane(link.from_lane).length_m
                if link is not track.link:
                    self._begin(track, link, at_m)
                for via in link.via:
                    if _edge(via) == _edge(lane):
                        track.link = link
                        return at_m + position_m
                    at_m += self._town.lane(via).length_m
            if at_m == track.start_m:
                return None
        track.lane, track.start_m, track.link = lane, at_m, None
        return at_m + position_m if at_m + position_m > track.seen[-1][1] - _BACK_M else None

    @cache  # noqa: B019 - as long as the reader
    def _chain(self, lane: str, goal: str, on: Connection | None) -> tuple[Connection, ...]:
        """The connections from a lane to another one, of which a long step may pass one."""
        ahead = self._town.ahead
        chains = [(link,) for each in self._town.lanes(_edge(lane)) for link in ahead(each)]
        for found in (chains, [(a, b) for (a,) in chains for b in ahead(a.to_lane)]):
            ends = {each: (*each[-1].via, each[-1].to_lane) for each in found}
            fit = [each for each in found if _edge(goal) in map(_edge, ends[each])]
            if fit:
                return max(
                    fit, key=lambda of: (of[0] is on, goal in ends[of], of[0].from_lane == lane)
                )
        return ()

    def _begin(self, track: _Track, link: Connection, stop_m: float) -> None:
        """Begin the passages over the chosen crosswalks of a connection."""
        car, body = track.car, track.car.vehicle
        for crosswalk in self._zones.crosswalks(link):
            found = self._zones.at(link, crosswalk, body.length_m, body.width_m)
            if found is None:
                continue
            passage = Passage(car, crosswalk, link, *found, stop_m, body)
            begin_m, range_m = passage.centre_m - RANGE_M, RANGE_M
            states = [state for state in track.seen if state[1] >= begin_m]
            if len(states) < len(track.seen):
                then_s, then_m, _ = track.seen[-len(states) - 1]
                share = (states[0][1] - begin_m) / (states[0][1] - then_m)
                passage.trace_offset_s = (states[0][0] - then_s) * share
            else:
                range_m = max(passage.centre_m - states[0][1], 0.1)
            limit_mps = self._town.lane(link.from_lane).limit_mps
            passage.vehicle = replace(
                body,
                initial_speed_mps=car.limit_mps(limit_mps),
                width_m=passage.zone.to_m - passage.zone.from_m,
                trigger_range_m=range_m,
                detection_range_m=range_m,
            )
            for time_s, car.odometer_m, car.speed_mps in states:
                passage.note(time_s)
            track.passages.append(passage)

    def _end(self, track: _Track) -> None:
        for passage in track.passages:
            passage.ended = CUT_OFF
        self.passages += track.passages

    def _person(self, time_s: float, row: Record) -> None:
        self.counts["people"] += 1
        name, edge, place = str(row["id"]), row["edge"], (float(row["x"]), float(row["y"]))
        last, seen = self._walkers.pop(name, ("", None))
        if seen is not None and time_s - seen.time_s[-1] > self._gap_s:
            seen = None
        if seen is not None and last != edge and (last in self._chosen or edge in self._areas):
            if last in self._chosen:
                # The first place beyond the crosswalk shows when they reached the kerb.
                _note(seen, time_s, place, on=False)
            seen = None
        if edge in self._chosen or edge in self._areas:
            seen = seen or Seen(name, 0, 0.0)
            _note(seen, time_s, place, on=edge in self._chosen)
            if edge in self._chosen and (last != edge or len(seen.on) == 1):
                seen.index = len(self.people[edge])
                seen.first_m = self._axes[edge].along_m(seen.x[0], seen.y[0])
                self.people[edge].append(seen)
                self.digits = max(self.digits, len(str(row["x"]).partition(".")[2]))
            self._walkers[name] = edge, seen


def _edge(lane: str) -> str:
    return lane.rpartition("_")[0]


def _note(seen: Seen, time_s: float, place: tuple[float, float], *, on: bool) -> None:
    seen.time_s.append(time_s)
    seen.x.append(place[0])
    seen.y.append(place[1])
    seen.on.append(on)
