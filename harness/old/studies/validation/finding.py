"""Takes recorded clips and returns the passages of vehicles, on a straightened road."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from harness.core.encounter import Arrival, Crossing, FloatArray, Side, Vehicle
from harness.model.trajectories import Clip, ExtractionRules, Track, VehicleTrack
from harness.model.trajectories.encounters import (
    VEHICLE_CHORD_M,
    Mover,
    angle_deg,
    car_of,
    directions,
    spans_gap,
    walker_of,
)
from harness.model.trajectories.paths import first_crossing
from harness.old.studies.validation.passages import BEYOND_S, LEFT_OUT, Passage, Passages
from harness.old.studies.validation.road import KERB_M, Course, Road, course_of, road_about, rounded

START_RANGE_M = 30.0
"""A passage begins at the first record within this distance of x = 0."""

LEAST_RANGE_M = 6.0
"""A passage is left out if its record begins closer than this."""

GROUP_GAP_M = 5.0
"""Maximum distance in m (a car's length) between neighbouring conflict points of a group."""

LEAST_WIDTH_M = 4.0
"""Smallest width of the crosswalk.  Its width is the spread of the conflict points."""

_ROUNDING_M = 0.05
"""Tolerance of the start range, because recorded positions are rounded."""

_START_S, _FREE_S = 0.5, 1.0


def crossing_about(width_m: float) -> Crossing:
    """Return a crosswalk of this width whose kerbs are 4.5 m from the vehicle's path."""
    return Crossing(2 * KERB_M, width_m, KERB_M, 2 * KERB_M)


def find_passages(
    clips: Iterable[Clip], limits: Vehicle, step_s: float, rules: ExtractionRules | None = None
) -> Passages:
    """Find every passage of a vehicle through a group of crossing pedestrians.

    A pedestrian's conflict point is ahead of the vehicle's first record, where both paths first
    cross at an angle that extraction allows.  A gap of more than ``GROUP_GAP_M`` between
    neighbouring conflict points along the vehicle's path separates two groups.  The road is the
    vehicle's own path, straightened.

    Args:
        clips: clips with tracks.
        limits: gives each vehicle's width, accelerations and smallest detection range; all other
            values come from the record.
        step_s: time step of the simulations.
        rules: rules of the extraction.

    Returns:
        Passages in the order of the clips, and counts of excluded passages.
    """
    rules = rules or ExtractionRules()
    used: list[Passage] = []
    left_out = dict.fromkeys(LEFT_OUT, 0)
    for clip in clips:
        walkers = {name: walker_of(track, rules) for name, track in clip.pedestrians.items()}
        for key, track in clip.vehicles.items():
            for passage in _of_vehicle(clip, key, track, walkers, limits, step_s, rules):
                if isinstance(passage, str):
                    left_out[passage] += 1
                else:
                    used.append(passage)
    return Passages(tuple(used), left_out)


@dataclass(frozen=True, eq=False)
class _Crosser:
    """A pedestrian whose path crosses the vehicle's path, with place and walking direction."""

    track: Track
    arc_m: float
    leftward: bool


def _of_vehicle(
    clip: Clip,
    key: str,
    track: VehicleTrack,
    walkers: Mapping[str, Mover | None],
    limits: Vehicle,
    step_s: float,
    rules: ExtractionRules,
) -> list[Passage | str]:
    """Return a vehicle's passages, or the reasons why there are none."""
    car = car_of(track, rules)
    if car is None:
        return ["parked_vehicle"]
    together = [
        walkers[name]
        for name, walker in clip.pedestrians.items()
        if walker.time_s[0] <= track.time_s[-1] and walker.time_s[-1] >= track.time_s[0]
    ]
    if not together:
        return ["no_pedestrian"]
    moving = [walker for walker in together if walker is not None]
    if not moving:
        return ["only_standing_pedestrians"]
    crossers = [crosser for walker in moving if (crosser := _crosser(car, walker, rules))]
    if not crossers:
        return ["nobody_crosses"]
    front_m = car.arc_m + track.front_offset_m
    ahead = [crosser for crosser in crossers if crosser.arc_m > front_m[0]]
    if not ahead:
        return ["begins_too_near"]
    builder = _Builder(clip, key, track, car, limits, step_s, rules)
    return [builder.passage(number, group, front_m) for number, group in enumerate(_groups(ahead))]


def _crosser(car: Mover, walker: Mover, rules: ExtractionRules) -> _Crosser | None:
    crossing = first_crossing(car.path, walker.path)
    if crossing is None:
        return None
    driving, walking = directions(car, walker, crossing)
    if not rules.min_angle_deg <= angle_deg(driving, walking) <= rules.max_angle_deg:
        return None
    leftward = bool(driving[0] * walking[1] - driving[1] * walking[0] > 0)
    return _Crosser(walker.track, crossing[0], leftward)


def _groups(crossers: list[_Crosser]) -> list[list[_Crosser]]:
    """Sort crossers along the path and split them into groups between distant neighbours."""
    arcs = np.array([crosser.arc_m for crosser in crossers])
    order = np.argsort(arcs, kind="stable")
    number = np.empty(len(arcs), dtype=int)
    number[order] = np.cumsum(np.diff(arcs[order], prepend=arcs[order[0]]) > GROUP_GAP_M)
    return [
        [crosser for crosser, its in zip(crossers, number.tolist(), strict=True) if its == group]
        for group in range(int(number.max()) + 1)
    ]


@dataclass(frozen=True, eq=False)
class _Builder:
    """Builds passages from one vehicle's record."""

    clip: Clip
    key: str
    track: VehicleTrack
    car: Mover
    limits: Vehicle
    step_s: float
    rules: ExtractionRules

    def passage(self, number: int, group: list[_Crosser], front_m: FloatArray) -> Passage | str:
        """Return the passage through one group, or the reason why there is none."""
        arcs = np.array([crosser.arc_m for crosser in group])
        origin_m = float(np.median(arcs))
        crossing = crossing_about(max(LEAST_WIDTH_M, round(float(np.ptp(arcs)), 9)))
        x_m, time_s = rounded(front_m - origin_m), self.track.time_s
        first = int(np.flatnonzero(x_m >= -START_RANGE_M - _ROUNDING_M)[0])
        start_s, range_m = float(time_s[first]), -float(x_m[first])
        if range_m < LEAST_RANGE_M:
            return "begins_too_near"
        states = self._states(x_m, first, crossing)
        if isinstance(states, str):
            return states
        until_s = (len(states) - 1) * self.step_s + BEYOND_S + self.step_s
        road = road_about(self.car.path, origin_m, START_RANGE_M + 10.0, VEHICLE_CHORD_M)
        courses = [self._course(crosser, road, origin_m, start_s, until_s) for crosser in group]
        people = _people(group, courses, until_s, self.rules.max_gap_s, start_s)
        if isinstance(people, str):
            return people
        arrivals, passing_s, conflict_x_m, extended = people
        since_s = rounded(time_s - start_s)
        start_speed = round(_start_speed(since_s[first:], x_m[first:]), 9)
        return Passage(
            self.clip.source,
            self.clip.name,
            self.key,
            number,
            self._vehicle(range_m, max(start_speed, round(_free_speed(since_s, x_m), 9))),
            start_speed,
            crossing,
            self.step_s,
            states,
            float(time_s[-1]) - start_s,
            arrivals,
            passing_s,
            conflict_x_m,
            extended,
        )

    def _states(self, x_m: FloatArray, first: int, crossing: Crossing) -> FloatArray | str:
        """Return the front bumper's recorded position at every step until the rear has left.

        If that is impossible, return the reason.
        """
        time_s = rounded(self.track.time_s[first:] - self.track.time_s[first])
        passed_at = crossing.width_m / 2 + self.track.length_m
        x_m = np.maximum.accumulate(x_m[first:])
        end = int(np.searchsorted(x_m, passed_at))
        last = np.arange(min(end, len(x_m) - 1) + 1)
        if spans_gap(time_s, time_s[:1], time_s[last[-1:]], self.rules.max_gap_s)[0]:
            return "gap"
        if x_m[-1] < 0:
            return "pass_not_recorded"
        if end == len(x_m):
            missing = passed_at - x_m[-1]
            since = int(np.searchsorted(time_s, time_s[-1] - _START_S - 1e-9))
            speed = (x_m[-1] - x_m[since]) / (time_s[-1] - time_s[since])
            too_slow = speed < self.rules.min_vehicle_speed_mps
            if too_slow or missing > self.rules.vehicle_extension_m:
                return "pass_not_recorded"
            time_s = np.append(time_s, time_s[-1] + missing / speed + self.step_s)
            x_m = np.append(x_m, x_m[-1] + missing + speed * self.step_s)
        reached_s = float(np.interp(passed_at, x_m, time_s))
        steps = int(np.ceil(reached_s / self.step_s - 1e-9))
        states: FloatArray = np.interp(np.arange(steps + 1) * self.step_s, time_s, x_m)
        return states

    def _course(
        self, crosser: _Crosser, road: Road, origin_m: float, start_s: float, until_s: float
    ) -> Course:
        flip = -1 if self.clip.y_down else 1
        from_right = crosser.leftward != self.clip.y_down
        side = Side.NEAR if from_right else Side.FAR
        return course_of(crosser.track, road, origin_m, start_s, until_s, side, flip)

    def _vehicle(self, range_m: float, free_speed_mps: float) -> Vehicle:
        limits = self.limits
        return Vehicle(
            initial_speed_mps=free_speed_mps,
            trigger_range_m=range_m,
            detection_range_m=max(limits.detection_range_m, range_m),
            length_m=self.track.length_m,
            width_m=limits.width_m,
            max_acceleration_mps2=limits.max_acceleration_mps2,
            max_deceleration_mps2=limits.max_deceleration_mps2,
            resume_acceleration_mps2=limits.resume_acceleration_mps2,
        )


def _people(
    group: list[_Crosser],
    courses: list[Course],
    until_s: float,
    max_gap_s: float,
    start_s: float,
) -> tuple[tuple[Arrival, ...], FloatArray, FloatArray, tuple[bool, ...]] | str:
    """Return the pedestrians present during the passage, or the reason why it is left out."""
    people = []
    for crosser, course in zip(group, courses, strict=True):
        legs = course.legs(until_s)
        if not legs:
            continue
        begin, end = legs[0].time_s, course.reaches_s(2 * KERB_M, since_s=0.0)
        recorded_s = np.array([begin, min(end, course.recorded_s[1])]) + start_s
        if spans_gap(crosser.track.time_s, recorded_s[:1], recorded_s[1:], max_gap_s)[0]:
            return "gap"
        passed_s = course.reaches_s(KERB_M)
        passing = -np.inf if passed_s <= 0 else passed_s
        place = course.x_at(passed_s) if np.isfinite(passed_s) else 0.0
        whole = course.recorded_s[0] <= begin and end <= course.recorded_s[1]
        people.append((legs, course.side, passing, place, not whole))
    if not any(passing > 0 for _, _, passing, _, _ in people):
        return "nobody_left"
    people.sort(key=lambda person: person[0][0].time_s)
    arrivals = tuple(
        Arrival(index, legs[0].time_s, side, None, path=legs)
        for index, (legs, side, _, _, _) in enumerate(people)
    )
    passing_s = np.array([passing for _, _, passing, _, _ in people])
    places = np.array([place for _, _, _, place, _ in people])
    return arrivals, passing_s, places, tuple(extended for *_, extended in people)


def _start_speed(time_s: FloatArray, x_m: FloatArray) -> float:
    """Return the speed ≥ 0 at the first record, from a parabola through the first 0.5 s."""
    near = time_s <= time_s[0] + _START_S + 1e-9
    if near.sum() < 3:
        return max(0.0, float((x_m[1] - x_m[0]) / (time_s[1] - time_s[0])))
    _, speed, _ = np.polyfit(time_s[near] - time_s[0], x_m[near], 2)
    return max(0.0, float(speed))


def _free_speed(time_s: FloatArray, x_m: FloatArray) -> float:
    """Return the highest mean speed over one second, or over the whole record if it is shorter."""
    window = min(_FREE_S, float(time_s[-1] - time_s[0]))
    begin = time_s[time_s <= time_s[-1] - window + 1e-9]
    there = np.interp(np.minimum(begin + window, time_s[-1]), time_s, x_m)
    here = np.interp(begin, time_s, x_m)
    return float(((there - here) / window).max())
