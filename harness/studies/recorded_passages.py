"""Recorded tracks in; passages out: one vehicle and the people who cross, on a straight road.

The road is the vehicle's own path, straightened.  x = 0 is the median of the places at which the
people cross it; the kerbs are 4.5 m beside it, as on the paper's crosswalk of 9 m.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from harness.core.encounter import Arrival, Crossing, FloatArray, Leg, Side, Vehicle
from harness.model.trajectories import Clip, ExtractionRules
from harness.model.trajectories.encounters import (
    VEHICLE_CHORD_M,
    Mover,
    angle_deg,
    car_of,
    directions,
    spans_gap,
    walker_of,
)
from harness.model.trajectories.paths import TravelPath, first_crossing, thinned

START_RANGE_M, LEAST_RANGE_M = 30.0, 6.0
"""A passage begins at the first record within the first distance of x = 0; it is left out if the
record begins within the second."""

GROUP_GAP_M = 5.0
"""A longer way (a car's length) between neighbouring crossing places parts two groups."""

LEAST_WIDTH_M, KERB_M = 4.0, 4.5
"""The smallest width of the crosswalk, and the distance of each kerb from the path."""

BEYOND_S = 30.0
"""A simulated vehicle times out this long after the recorded vehicle has passed."""

_FOOTPATH_M = 1.5  # people are there from here before the kerb on, as in SUMO's own model
_LEG_S = 0.1 - 1e-6  # records at shorter intervals are thinned
_KEPT_S, _FREE_S = 0.5, 1.0  # before and after a record its speed over the first time is kept
_ROUNDING_M = 0.05  # recorded positions are rounded
_REACH_M, _STRAIGHT_M = START_RANGE_M + 10.0, 60.0


class Person(NamedTuple):
    """Somebody who is there during a passage.

    Attributes:
        arrival: their recorded walk, from the footpath or from their place at the start.
        passing_s: when they cross the vehicle's path; −inf if before the start, inf if never.
        conflict_x_m: where along the road.
        gap: whether their record has a gap while they are there.
    """

    arrival: Arrival
    passing_s: float
    conflict_x_m: float
    gap: bool


class RecordedPassage(NamedTuple):
    """One recorded passage.

    Attributes:
        vehicle_id: source, clip and key of the vehicle, whose passages are not independent.
        vehicle: the ego's constants.  ``initial_speed_mps`` is the free speed v0: the highest of
            the start speed and of the mean speeds over one second.
        start_speed_mps: the speed at the start, from a parabola through the first 0.5 s.
        crossing: the crosswalk, as wide as the crossing places lie apart.
        x_m: (n,) recorded position of the front bumper at every step, until the rear has left.
        people: who is there during the passage, by arrival.
    """

    vehicle_id: tuple[str, str, str]
    vehicle: Vehicle
    start_speed_mps: float
    crossing: Crossing
    x_m: FloatArray
    people: tuple[Person, ...]

    @property
    def to_come(self) -> list[Person]:
        """Those who have not crossed the path at the start: the encounters."""
        return [person for person in self.people if person.passing_s > 0]


def crossing_about(width_m: float) -> Crossing:
    """A crosswalk of this width whose kerbs are 4.5 m from the vehicle's path."""
    return Crossing(2 * KERB_M, width_m, KERB_M, 2 * KERB_M)


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
    used, left_out = [], Counter[str]()
    for clip in clips:
        movers = [walker_of(track, rules) for track in clip.pedestrians.values()]
        walkers = [mover for mover in movers if mover is not None]
        for key, track in clip.vehicles.items():
            if (car := car_of(track, rules)) is None:
                left_out["parked vehicle"] += 1
                continue
            for found in _Record(clip, key, car, limits, step_s, rules).passages(walkers):
                if isinstance(found, str):
                    left_out[found] += 1
                else:
                    used.append(found)
    return used, left_out


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
        arcs = np.array([crosser.arc_m for crosser in ahead])
        ordered = np.sort(arcs)
        begins = ordered[1:][np.diff(ordered) > GROUP_GAP_M]
        groups = np.searchsorted(begins, arcs, side="right")
        for number in range(len(begins) + 1):
            yield self._passage([ahead[place] for place in np.flatnonzero(groups == number)])

    def _crosser(self, walker: Mover) -> _Crosser | None:
        own, others = self.car.track.time_s, walker.track.time_s
        crossing = first_crossing(self.car.path, walker.path)
        if others[0] > own[-1] or others[-1] < own[0] or crossing is None:
            return None
        driving, walking = directions(self.car, walker, crossing)
        if not self.rules.min_angle_deg <= angle_deg(driving, walking) <= self.rules.max_angle_deg:
            return None
        leftward = bool(driving[0] * walking[1] - driving[1] * walking[0] > 0)
        side = Side.NEAR if leftward != self.clip.y_down else Side.FAR
        return _Crosser(walker, crossing[0], side)

    def _passage(self, group: Sequence[_Crosser]) -> RecordedPassage | str:
        track, arcs = self.clip.vehicles[self.key], np.array([each.arc_m for each in group])
        origin_m = float(np.median(arcs))
        crossing = crossing_about(max(LEAST_WIDTH_M, round(float(np.ptp(arcs)), 9)))
        x_m = _rounded(self.car.arc_m + track.front_offset_m - origin_m)
        first = int(np.argmax(x_m >= -START_RANGE_M - _ROUNDING_M))
        start_s, range_m = float(track.time_s[first]), -float(x_m[first])
        time_s, passed_m = _rounded(track.time_s - start_s), crossing.width_m / 2 + track.length_m
        if range_m < LEAST_RANGE_M:
            return "record begins too near"
        if x_m.max() < 0:
            return "pass not recorded"
        states = self._states(time_s[first:], x_m[first:], passed_m)
        if isinstance(states, str):
            return states
        until_s = (len(states) - 1) * self.step_s + BEYOND_S + self.step_s
        found = [self._person(crosser, origin_m, start_s, until_s) for crosser in group]
        people = [person for person in found if person is not None]
        if any(person.gap for person in people):
            return "gap in a record"
        if not any(person.passing_s > 0 for person in people):
            return "nobody left at the start"
        people.sort(key=lambda person: person.arrival.arrival_s)
        near = max(2, int(np.count_nonzero(time_s[first:] <= _KEPT_S + 1e-9)))
        begun = slice(first, first + near)
        speed = np.polyfit(time_s[begun], x_m[begun], min(2, near - 1))[-2]
        start_mps = round(max(0.0, float(speed)), 9)
        return RecordedPassage(
            (self.clip.source, self.clip.name, self.key),
            replace(
                self.limits,
                initial_speed_mps=max(start_mps, round(_free_speed(time_s, x_m), 9)),
                trigger_range_m=range_m,
                detection_range_m=max(self.limits.detection_range_m, range_m),
                length_m=track.length_m,
            ),
            start_mps,
            crossing,
            states,
            tuple(
                person._replace(arrival=person.arrival._replace(index=index))
                for index, person in enumerate(people)
            ),
        )

    def _states(self, time_s: FloatArray, x_m: FloatArray, passed_m: float) -> FloatArray | str:
        """The recorded position at every step until the front is at ``passed_m``, or why not.

        A record that ends before goes on at its last speed.
        """
        x_m = np.maximum.accumulate(x_m)
        end = int(np.searchsorted(x_m, passed_m))
        last_s = time_s[[min(end, len(x_m) - 1)]]
        if spans_gap(time_s, time_s[:1], last_s, self.rules.max_gap_s)[0]:
            return "gap in a record"
        if end == len(x_m):
            missing = passed_m - x_m[-1]
            since = int(np.searchsorted(time_s, time_s[-1] - _KEPT_S - 1e-9))
            speed = (x_m[-1] - x_m[since]) / (time_s[-1] - time_s[since])
            too_slow = speed < self.rules.min_vehicle_speed_mps
            if too_slow or missing > self.rules.vehicle_extension_m:
                return "pass not recorded"
            time_s = np.append(time_s, time_s[-1] + missing / speed + self.step_s)
            x_m = np.append(x_m, x_m[-1] + missing + speed * self.step_s)
        steps = int(np.ceil(float(np.interp(passed_m, x_m, time_s)) / self.step_s - 1e-9))
        states: FloatArray = np.interp(np.arange(steps + 1) * self.step_s, time_s, x_m)
        return states

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
        places = np.column_stack([_rounded(along - origin_m), _rounded(KERB_M + flip * left)])
        times = _rounded(track.time_s[kept] - start_s)
        last_s = float(times[-1])
        times, places = _extended(times, places, until_s)
        x, y = places.T
        progress = y if crosser.side is Side.NEAR else 2 * KERB_M - y
        begin_s = _reached_s(times, progress, -_FOOTPATH_M, 0.0)
        gone_s = _reached_s(times, progress, 2 * KERB_M, 0.0)
        if begin_s >= (end_s := min(gone_s, until_s)):
            return None
        inner = times[(times > begin_s + 1e-9) & (times < end_s - 1e-9)]
        at = np.concatenate([[begin_s], inner, [end_s]])
        xs, ys, step = np.interp(at, times, x), np.interp(at, times, y), np.diff(at)
        # A leg has no end, so the last leg also leads over the kerb.
        columns = (at[:-1], xs[:-1], ys[:-1], np.diff(xs) / step, np.diff(ys) / step, 0.0 * step)
        path = tuple(Leg(*row) for row in np.column_stack(columns).tolist())
        seen = np.array([begin_s, min(gone_s, last_s)]) + start_s
        passed_s = _reached_s(times, progress, KERB_M)
        return Person(
            Arrival(0, begin_s, crosser.side, None, path=path),
            -np.inf if passed_s <= 0 else passed_s,
            float(np.interp(passed_s, times, x)) if np.isfinite(passed_s) else 0.0,
            bool(spans_gap(track.time_s, seen[:1], seen[1:], self.rules.max_gap_s)[0]),
        )


def _extended(
    time_s: FloatArray, places_m: FloatArray, until_s: float
) -> tuple[FloatArray, FloatArray]:
    """A walk from 0 or before until ``until_s``, with its first and last mean velocity."""
    end = max(1, int(np.searchsorted(time_s, time_s[0] + _KEPT_S + 1e-9)) - 1)
    begin = min(int(np.searchsorted(time_s, time_s[-1] - _KEPT_S - 1e-9)), len(time_s) - 2)
    times, places = [time_s], [places_m]
    if time_s[0] > 0:
        velocity = (places_m[end] - places_m[0]) / (time_s[end] - time_s[0])
        times.insert(0, np.zeros(1))
        places.insert(0, places_m[:1] - velocity * time_s[0])
    if time_s[-1] < until_s:
        velocity = (places_m[-1] - places_m[begin]) / (time_s[-1] - time_s[begin])
        times.append(np.array([until_s]))
        places.append(places_m[-1:] + velocity * (until_s - time_s[-1]))
    return np.concatenate(times), np.concatenate(places)


def _straightened(
    path: TravelPath, origin_m: float, position_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distances along a path and to its left, (n,) each, of positions (n, 2).

    Only the part near x = 0 counts, extended straight, because the path may return to the place.
    """
    half_m, arcs = VEHICLE_CHORD_M / 2, path.arc_m
    first, last = max(0.0, origin_m - _REACH_M), min(float(arcs[-1]), origin_m + _REACH_M)
    arcs = np.unique([first, *arcs[np.abs(arcs - origin_m) < _REACH_M], last])
    # A corner very close to an end would give a piece without a direction.
    arcs = arcs[np.append(True, np.diff(arcs) > 1e-6)]
    points = np.array([path.at(arc) for arc in arcs.tolist()])
    before = points[0] - _STRAIGHT_M * path.direction(first + half_m, half_m)
    beyond = points[-1] + _STRAIGHT_M * path.direction(last - half_m, half_m)
    points = np.vstack([before, points, beyond])
    pieces = np.diff(points, axis=0)
    lengths = np.hypot(*pieces.T)
    away = position_m[:, None, :] - points[None, :-1]
    share = np.clip((away * pieces).sum(axis=2) / lengths**2, 0.0, 1.0)
    squared = ((away - share[:, :, None] * pieces) ** 2).sum(axis=2)
    row, nearest = np.arange(len(position_m)), squared.argmin(axis=1)
    ahead, aside = pieces[nearest], away[row, nearest]
    left = ahead[:, 0] * aside[:, 1] - ahead[:, 1] * aside[:, 0]
    arc_m = arcs[0] - _STRAIGHT_M + np.cumsum(lengths) - lengths
    along = arc_m[nearest] + share[row, nearest] * lengths[nearest]
    return along, np.copysign(np.sqrt(squared[row, nearest]), left)


def _reached_s(
    time_s: FloatArray, progress_m: FloatArray, level_m: float, since_s: float = -np.inf
) -> float:
    """The first time from ``since_s`` on with this progress; infinite if never."""
    if since_s > time_s[0]:
        later, here = time_s > since_s, np.interp(since_s, time_s, progress_m)
        time_s, progress_m = np.append(since_s, time_s[later]), np.append(here, progress_m[later])
    past = np.flatnonzero(progress_m >= level_m)
    if len(past) == 0:
        return float("inf")
    about = slice(max(0, int(past[0]) - 1), int(past[0]) + 1)
    return float(np.interp(level_m, progress_m[about], time_s[about]))


def _rounded(values: FloatArray) -> FloatArray:
    """Values rounded to 1e-9, so that results do not depend on the last bits."""
    result: FloatArray = np.round(values, 9)
    return result


def _free_speed(time_s: FloatArray, x_m: FloatArray) -> float:
    """The highest mean speed over one second, or over the whole record if it is shorter."""
    window = min(_FREE_S, float(time_s[-1] - time_s[0]))
    begin = time_s[time_s <= time_s[-1] - window + 1e-9]
    there = np.interp(np.minimum(begin + window, time_s[-1]), time_s, x_m)
    return float(((there - np.interp(begin, time_s, x_m)) / window).max())
