"""Recorded tracks in; passages out: one vehicle and the people who cross, on a straight road.

The road is the vehicle's own path, straightened.  x = 0 is the median of the places at which the
people cross it; the kerbs are 4.5 m beside it, as on the paper's crosswalk of 9 m.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import attrgetter
from typing import NamedTuple

import numpy as np
import shapely
from shapely.ops import substring

from harness.core.vocabulary import ROUNDING, Arrival, Crossing, FloatArray, Leg, Side, Vehicle
from harness.model.trajectories.encounters import (
    VEHICLE_CHORD_M,
    Mover,
    car_of,
    crossing_of,
    spans_gap,
    walker_of,
)
from harness.model.trajectories.rules import ExtractionRules
from harness.model.trajectories.tracks import Clip, TravelPath, fingerprint, thinned

START_RANGE_M, LEAST_RANGE_M = 30.0, 6.0
"""A passage begins at the first record within the first distance of x = 0; it is left out if the
record begins within the second."""

GROUP_GAP_M = 5.0
"""A longer way (a car's length) between neighbouring crossing places parts two groups."""

LEAST_WIDTH_M, PATH_TO_KERB_M = 4.0, 4.5
"""The smallest width of the crosswalk, and the distance of each kerb from the path."""

BEYOND_S = 30.0
"""A simulated vehicle times out this long after the recorded vehicle has passed."""

_FOOTPATH_M = 1.5
"""People are there from this far before the kerb on, as in SUMO's own model."""

_LEG_S = 0.1 - 1e-6
"""Records at shorter intervals are thinned."""

_KEPT_S, _FREE_S = 0.5, 1.0
"""Before and after a record the mean speed over the first time is kept; see ``_free_speed``."""

_ROUNDING_M = 0.05
"""Recorded positions are rounded to about this."""

_REACH_M, _STRAIGHT_M = START_RANGE_M + 10.0, 60.0


class Person(NamedTuple):
    """Somebody who is there during a passage.

    Attributes:
        arrival: their recorded walk, from the footpath or from their place at the start.
        passing_s: when they cross the vehicle's path; −inf if before the start, inf if never.
        conflict_x_m: where along the road; None if never.
        gap: whether their record has a gap while they are there.
    """

    arrival: Arrival
    passing_s: float
    conflict_x_m: float | None
    gap: bool


class RecordedPassage(NamedTuple):
    """One recorded passage.

    Attributes:
        vehicle_id: source, clip and key of the vehicle.
        track: fingerprint of the vehicle's track, the same in every copy of the recording.  The
            passages with one track are not independent.
        vehicle: the ego's constants.  ``initial_speed_mps`` is the free speed v0: the highest of
            the start speed and of the mean speeds over one second.
        start_speed_mps: the speed at the start, from a parabola through the first 0.5 s.
        crossing: the crosswalk, as wide as the crossing places lie apart.
        x_m: (n,) recorded position of the front bumper at every step, until the rear has left.
        people: who is there during the passage, by arrival.
    """

    vehicle_id: tuple[str, str, str]
    track: str
    vehicle: Vehicle
    start_speed_mps: float
    crossing: Crossing
    x_m: FloatArray
    people: tuple[Person, ...]

    @property
    def to_come(self) -> list[Person]:
        """Those who have not crossed the path at the start: the encounters."""
        return [person for person in self.people if person.passing_s > 0]


def find_passages(
    clips: Iterable[Clip], limits: Vehicle, step_s: float, rules: ExtractionRules
) -> tuple[list[RecordedPassage], Counter[str]]:
    """Every passage of a vehicle through a group of people whose paths cross its path.

    A crossing place is ahead of the vehicle's first record, where both paths first cross at an
    angle that extraction allows.

    Args:
        clips: clips with tracks.
        limits: gives each vehicle's width, accelerations and smallest detection range; all other
            values come from the record.
        step_s: time step of the simulations.
        rules: rules of the extraction.

    Returns:
        Passages in the order of the clips; and the number of vehicles and groups without one, by
        the first reason that applies.
    """
    found: list[RecordedPassage | str] = []
    for clip in clips:
        movers = [walker_of(track, rules) for track in clip.pedestrians.values()]
        walkers = [mover for mover in movers if mover is not None]
        for key, track in clip.vehicles.items():
            car = car_of(track, rules)
            if car is None:
                found.append("parked vehicle")
                continue
            found += _Record(clip, key, car, limits, step_s, rules).passages(walkers)
    left_out = Counter(each for each in found if isinstance(each, str))
    return [each for each in found if not isinstance(each, str)], left_out


class _Crosser(NamedTuple):
    """Somebody whose path crosses the vehicle's: where, and from which kerb they come."""

    walker: Mover
    arc_m: float
    side: Side


@dataclass(frozen=True, eq=False)
class _Record:
    """The record of one vehicle, which makes its passages."""

    clip: Clip
    key: str
    car: Mover
    limits: Vehicle
    step_s: float
    rules: ExtractionRules

    def passages(self, walkers: Sequence[Mover]) -> Iterator[RecordedPassage | str]:
        """Yield the passage through each group, or the reason why there is none."""
        crossers = [crosser for each in walkers if (crosser := self._crosser(each))]
        begin_m = self.car.arc_m[0] + self.clip.vehicles[self.key].front_offset_m
        ahead = [crosser for crosser in crossers if crosser.arc_m > begin_m]
        if not ahead:
            yield "record begins too near" if crossers else "nobody crosses"
            return
        ahead.sort(key=attrgetter("arc_m"))
        begins = np.flatnonzero(np.diff([each.arc_m for each in ahead]) > GROUP_GAP_M) + 1
        for first, last in pairwise([0, *begins, len(ahead)]):
            yield self._passage(ahead[first:last])

    def _crosser(self, walker: Mover) -> _Crosser | None:
        own, others = self.car.track.time_s, walker.track.time_s
        crossing = crossing_of(self.car, walker, self.rules)
        if others[0] > own[-1] or others[-1] < own[0] or isinstance(crossing, str):
            return None
        on_car_m, driving, walking, _ = crossing
        leftward = bool(driving[0] * walking[1] - driving[1] * walking[0] > 0)
        return _Crosser(walker, on_car_m, Side.NEAR if leftward != self.clip.y_down else Side.FAR)

    def _passage(self, group: Sequence[_Crosser]) -> RecordedPassage | str:
        """A passage with those who cross its path together, or why it is left out."""
        track, arcs = self.clip.vehicles[self.key], np.array([each.arc_m for each in group])
        origin_m = float(np.median(arcs))
        width_m = max(LEAST_WIDTH_M, round(float(np.ptp(arcs)), 9))
        crossing = Crossing(2 * PATH_TO_KERB_M, width_m, PATH_TO_KERB_M, 2 * PATH_TO_KERB_M)
        # Rounded, so that results do not depend on the last bits.
        x_m = np.round(self.car.arc_m + track.front_offset_m - origin_m, 9)
        first = int(np.argmax(x_m >= -START_RANGE_M - _ROUNDING_M))
        start_s, range_m = float(track.time_s[first]), -float(x_m[first])
        time_s = np.round(track.time_s - start_s, 9)
        if range_m < LEAST_RANGE_M:
            return "record begins too near"
        states = self._states(time_s[first:], x_m[first:], width_m / 2 + track.length_m)
        if isinstance(states, str):
            return states
        until_s = (len(states) - 1) * self.step_s + BEYOND_S + self.step_s
        found = [self._person(crosser, origin_m, start_s, until_s) for crosser in group]
        people = sorted(filter(None, found), key=lambda person: person.arrival.arrival_s)
        if any(person.gap for person in people):
            return "gap in a record"
        if not any(person.passing_s > 0 for person in people):
            return "nobody left at the start"
        near = max(2, int(np.count_nonzero(time_s[first:] <= _KEPT_S + ROUNDING)))
        begun = slice(first, first + near)
        speed = np.polyfit(time_s[begun], x_m[begun], min(2, near - 1))[-2]
        start_mps = round(max(0.0, float(speed)), 9)
        states.setflags(write=False)
        vehicle = replace(
            self.limits,
            initial_speed_mps=max(start_mps, round(_free_speed(time_s, x_m), 9)),
            trigger_range_m=range_m,
            detection_range_m=max(self.limits.detection_range_m, range_m),
            length_m=track.length_m,
        )
        which = self.clip.source, self.clip.name, self.key
        seen = fingerprint(track), vehicle, start_mps, crossing, states, tuple(people)
        return RecordedPassage(which, *seen)

    def _states(self, time_s: FloatArray, x_m: FloatArray, passed_m: float) -> FloatArray | str:
        """The recorded position at every step until the front is at ``passed_m``, or why not.

        A record that ends before goes on at its last speed.
        """
        x_m = np.maximum.accumulate(x_m)
        last_s = time_s[[min(int(np.searchsorted(x_m, passed_m)), len(x_m) - 1)]]
        if spans_gap(time_s, time_s[:1], last_s, self.rules.max_gap_s)[0]:
            return "gap in a record"
        missing_m = passed_m - x_m[-1]
        if missing_m > 0:
            speed = _velocity(time_s, x_m, -1)
            too_slow = speed < self.rules.min_vehicle_speed_mps
            if x_m[-1] < 0 or too_slow or missing_m > self.rules.vehicle_extension_m:
                return "pass not recorded"
            time_s = np.append(time_s, time_s[-1] + missing_m / speed + self.step_s)
            x_m = np.append(x_m, passed_m + speed * self.step_s)
        steps = int(np.ceil(float(np.interp(passed_m, x_m, time_s)) / self.step_s - ROUNDING))
        return np.asarray(np.interp(np.arange(steps + 1) * self.step_s, time_s, x_m))

    def _person(
        self, crosser: _Crosser, origin_m: float, start_s: float, until_s: float
    ) -> Person | None:
        """Who crosses; None if they have crossed at the start, or come after the end.

        Args:
            crosser: the person.
            origin_m: path length of x = 0.
            start_s: start of the passage on the clip's clock.
            until_s: its end, from its start.
        """
        track = crosser.walker.track
        kept = thinned(np.column_stack([track.time_s, 0 * track.time_s]), _LEG_S)
        kept = np.append(kept[: max(1, len(kept) - 1)], len(track.time_s) - 1)
        along, left = _straightened(self.car.path, origin_m, track.position_m[kept])
        flip = -1 if self.clip.y_down else 1
        places = np.column_stack([along - origin_m, PATH_TO_KERB_M + flip * left]).round(9)
        times = np.round(track.time_s[kept] - start_s, 9)
        times, places = _extended(times, places, until_s)
        at_s = np.concatenate([[0.0], times[(times > 0) & (times < until_s)], [until_s]])
        x, y = (np.interp(at_s, times, column) for column in places.T)
        progress = y if crosser.side is Side.NEAR else 2 * PATH_TO_KERB_M - y
        levels = (-_FOOTPATH_M, PATH_TO_KERB_M, 2 * PATH_TO_KERB_M)
        begin_s, passed_s, gone_s = (_reached_s(at_s, progress, level) for level in levels)
        end_s = min(gone_s, until_s)
        if begin_s >= end_s:
            return None
        inner = at_s[(at_s > begin_s + ROUNDING) & (at_s < end_s - ROUNDING)]
        at = np.concatenate([[begin_s], inner, [end_s]])
        xs, ys, step = np.interp(at, at_s, x), np.interp(at, at_s, y), np.diff(at)
        # A leg has no end, so the last leg also leads over the kerb.
        columns = (at[:-1], xs[:-1], ys[:-1], np.diff(xs) / step, np.diff(ys) / step, 0.0 * step)
        path = tuple(Leg(*row) for row in np.column_stack(columns).tolist())
        seen = np.array([begin_s + start_s, min(gone_s + start_s, track.time_s[-1])])
        return Person(
            Arrival(0, begin_s, crosser.side, None, path=path),
            -np.inf if passed_s <= 0 else passed_s,
            float(np.interp(passed_s, at_s, x)) if np.isfinite(passed_s) else None,
            bool(spans_gap(track.time_s, seen[:1], seen[1:], self.rules.max_gap_s)[0]),
        )


def _velocity(time_s: FloatArray, values: FloatArray, end: int) -> FloatArray:
    """The mean velocity over the first (``end`` 0) or last (−1) ``_KEPT_S`` of a record."""
    near = np.flatnonzero(np.abs(time_s - time_s[end]) <= _KEPT_S + ROUNDING)
    other = max(near[-1], 1) if end == 0 else min(near[0], len(time_s) - 2)
    return np.asarray((values[other] - values[end]) / (time_s[other] - time_s[end]))


def _extended(
    time_s: FloatArray, places_m: FloatArray, until_s: float
) -> tuple[FloatArray, FloatArray]:
    """A walk from before 0 until after ``until_s``, with its first and last mean velocity."""
    before_s, after_s = min(0.0, time_s[0]) - 1.0, max(until_s, time_s[-1]) + 1.0
    first = places_m[0] + _velocity(time_s, places_m, 0) * (before_s - time_s[0])
    last = places_m[-1] + _velocity(time_s, places_m, -1) * (after_s - time_s[-1])
    return np.concatenate([[before_s], time_s, [after_s]]), np.vstack([first, places_m, last])


def _straightened(
    path: TravelPath, origin_m: float, position_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distances along a path and to its left, (n,) each, of positions (n, 2).

    Only the part near x = 0 counts, extended straight, because the path may return to the place.
    """
    half_m = VEHICLE_CHORD_M / 2
    first, last = max(0.0, origin_m - _REACH_M), min(float(path.arc_m[-1]), origin_m + _REACH_M)
    points = np.array(substring(shapely.LineString(path.points), first, last).coords)
    before = points[0] - _STRAIGHT_M * path.direction(first + half_m, half_m)
    beyond = points[-1] + _STRAIGHT_M * path.direction(last - half_m, half_m)
    points = np.vstack([before, points, beyond])
    line, at = shapely.LineString(points), shapely.points(position_m)
    along_m = shapely.line_locate_point(line, at)
    pieces = np.diff(points, axis=0)
    ends_m = np.cumsum(np.hypot(*pieces.T))
    piece = np.searchsorted(ends_m[:-1], along_m)
    ahead, aside = pieces[piece], position_m - points[piece]
    left = ahead[:, 0] * aside[:, 1] - ahead[:, 1] * aside[:, 0]
    return first - _STRAIGHT_M + along_m, np.copysign(shapely.distance(line, at), left)


def _reached_s(time_s: FloatArray, progress_m: FloatArray, level_m: float) -> float:
    """The first time with this progress; infinite if never."""
    past = np.flatnonzero(progress_m >= level_m)
    if len(past) == 0:
        return float("inf")
    about = slice(max(0, int(past[0]) - 1), int(past[0]) + 1)
    return float(np.interp(level_m, progress_m[about], time_s[about]))


def _free_speed(time_s: FloatArray, x_m: FloatArray) -> float:
    """The highest mean speed over one second, or over the whole record if it is shorter."""
    window = min(_FREE_S, float(time_s[-1] - time_s[0]))
    begin = time_s[time_s <= time_s[-1] - window + ROUNDING]
    there = np.interp(np.minimum(begin + window, time_s[-1]), time_s, x_m)
    return float(((there - np.interp(begin, time_s, x_m)) / window).max())
