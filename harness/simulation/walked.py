"""A person's way over a crosswalk, whoever moved them.

Every place is a distance along the crosswalk's axis: 0 at its beginning, ``length_m`` at its end.
Times are SUMO's.
"""

import math
from array import array
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import Arrival, Crossing, FloatArray, Leg, Side, Walk
from harness.measures.motion.walking import states_at
from harness.site.town import Crosswalk

WAITING_M = 1.0
"""A person who stands within this distance of the kerb waits there."""
STANDING_MPS = 0.1
"""SUMO's threshold for waiting."""
KERB_M = 0.02
"""A person nearer to a kerb than this is at it: SUMO may hold people 1 cm away from a kerb."""


class Axis:
    """A crosswalk's centre line in plain numbers, which are faster than shapely's points."""

    def __init__(self, crosswalk: Crosswalk) -> None:
        self.length_m, at_m = crosswalk.length_m, 0.0
        self._pieces: list[tuple[complex, complex, float, float]] = []
        for a, b in pairwise(complex(*point[:2]) for point in crosswalk.axis.coords):
            if a != b:
                self._pieces.append((a, (b - a) / abs(b - a), abs(b - a), at_m))
                at_m += abs(b - a)

    def along_m(self, x: float, y: float) -> float:
        """The place of a point: of its foot on the nearest piece, beyond the ends too."""
        return self.foot(x, y)[0]

    def foot(self, x: float, y: float) -> tuple[float, float]:
        """The place of a point, and how far it is to the left of the axis."""
        at, last = complex(x, y), len(self._pieces) - 1
        best_m, place = math.inf, (0.0, 0.0)
        for number, (start, ahead, length_m, from_m) in enumerate(self._pieces):
            off = (at - start) * ahead.conjugate()
            low = off.real if number == 0 else max(off.real, 0.0)
            inside_m = low if number == last else min(low, length_m)
            away_m = math.hypot(off.real - inside_m, off.imag)
            if away_m < best_m:
                best_m, place = away_m, (from_m + inside_m, off.imag)
        return place

    def point(self, along_m: float, left_m: float = 0.0) -> tuple[float, float]:
        """x and y of a place on the axis, or to its left."""
        pieces = (piece for piece in self._pieces if along_m <= piece[2] + piece[3])
        start, ahead, _, from_m = next(pieces, self._pieces[-1])
        at = start + (along_m - from_m + left_m * 1j) * ahead
        return at.real, at.imag


@dataclass(frozen=True, slots=True)
class Walked:
    """One person's way over the crosswalk.

    Attributes:
        id: SUMO's id, or the one that a person of the harness has there.
        own: whether the harness moved them.
        walk: in the axis's frame, where y = 0 is the axis's beginning, ``near`` the kerb there, and
            x the way to the axis's left; its times are SUMO's.
        cleared_s: when they reached the other kerb; None if they did not.
        until_s: when they reached it, or were last seen; infinite if they are there at the end.
        let_go: whether they went before the first vehicle that kept them waiting; None if none did,
            or if SUMO decided.
    """

    id: str
    own: bool
    walk: Walk
    cleared_s: float | None
    until_s: float
    let_go: bool | None = None

    def places(self, time_s: FloatArray, axis: Axis) -> FloatArray:
        """Where they are between the kerbs at some times, shape (n, 2); NaN at other times."""
        assert self.walk.start_s is not None
        found = np.full((len(time_s), 2), np.nan)
        on = (time_s >= self.walk.start_s) & (time_s <= self.until_s)
        if on.any():
            road = Crossing(axis.length_m, 1.0, 0.0, 1.0)
            left_m, along_m, *_ = states_at(self.walk, road, time_s[on])
            found[on] = [*map(axis.point, along_m.tolist(), left_m.tolist())]
        return found


@dataclass(slots=True, eq=False)
class Seen:
    """Somebody whom SUMO moves, from the walking area before the crosswalk to the one beyond.

    Attributes:
        id: SUMO's id.
        index: their number in observations.
        first_m: their first place.
        time_s, x, y: where they were when.
        on: whether SUMO had them on the crosswalk.
    """

    id: str
    index: int
    first_m: float
    time_s: "array[float]" = field(default_factory=lambda: array("d"))
    x: "array[float]" = field(default_factory=lambda: array("d"))
    y: "array[float]" = field(default_factory=lambda: array("d"))
    on: list[bool] = field(default_factory=list)


def walked_of(person: Seen, axis: Axis) -> Walked | None:
    """The way of one of SUMO's people; None for those who only passed beside the kerb.

    Args:
        person: where they were at each step.
        axis: the crosswalk's.
    """
    time_s, places = np.array(person.time_s), np.column_stack((person.x, person.y))
    along_m, left_m = np.array([axis.foot(*at) for at in places.tolist()]).T
    length_m = axis.length_m
    on, near = np.flatnonzero(person.on), person.first_m < length_m / 2
    side, ahead_m = (Side.NEAR, along_m) if near else (Side.FAR, length_m - along_m)
    points = _from_kerb_to_kerb(time_s, ahead_m, on, length_m)
    waits_s = _waits_from(time_s, ahead_m, places, int(on[0]) if len(on) else len(time_s))
    if len(points) < 2:
        if len(on) or waits_s is None:
            return None
        # There is no quantile; NaN distinguishes them from timed pedestrians.
        waiting = Walk(Arrival(person.index, waits_s, side, math.nan))
        return Walked(person.id, False, waiting, None, float(time_s[-1]))
    (start_s, from_m), (end_s, to_m) = points[0].tolist(), points[-1].tolist()
    came_s = start_s if waits_s is None else min(waits_s, start_s)
    walk = Walk(
        Arrival(person.index, came_s, side, math.nan),
        start_s,
        max((to_m - from_m) / (end_s - start_s), 1e-3),
        legs=_legs(points, np.interp(points[:, 0], time_s, left_m), near, length_m),
    )
    cleared_s = end_s if to_m >= length_m - KERB_M else None
    until_s = float(time_s[-1]) if cleared_s is None else cleared_s
    return Walked(person.id, False, walk, cleared_s, until_s)


def _waits_from(
    time_s: FloatArray, ahead_m: FloatArray, places: FloatArray, first: int
) -> float | None:
    """When they began to stand within 1 m of the kerb, before record ``first``; None if never."""
    away = np.flatnonzero(ahead_m[:first] < -WAITING_M)
    since = int(away[-1]) if len(away) else 0
    moved_m = np.hypot(*np.diff(places[since:first], axis=0).T)
    stands = np.flatnonzero(moved_m < STANDING_MPS * np.diff(time_s[since:first]))
    return float(time_s[since + stands[0]]) if len(stands) else None


def _from_kerb_to_kerb(
    time_s: FloatArray, ahead_m: FloatArray, on: NDArray[np.int_], length_m: float
) -> FloatArray:
    """(time, way ahead) of a walk over the crosswalk, from one kerb to the other, shape (n, 2).

    A person crosses a kerb at the speed of the nearest step between the kerbs, because they may
    have waited in the step before, and SUMO's curves on walking areas cut corners; but within the
    step in which SUMO has them on the other side of the kerb.
    """
    last, points = len(time_s) - 1, np.column_stack((time_s, ahead_m))
    rows = on[(ahead_m[on] >= KERB_M) & (ahead_m[on] <= length_m - KERB_M)]
    if len(on) and len(rows) < 2:
        # The step is long, or they have only begun.
        rows = np.unique([max(int(on[0]) - 1, 0), *rows, min(int(on[-1]) + 1, last)])
    if len(rows) < 2 or ahead_m[rows[-1]] <= ahead_m[rows[0]]:
        return points[:0]
    walk = points[rows]
    before_s, after_s = time_s[max(rows[0] - 1, 0)], time_s[min(rows[-1] + 1, last)]
    start_s = _kerb(walk[:2], 0.0, before_s, walk[1, 0])
    end_s = _kerb(walk[-2:], length_m, walk[-2, 0], after_s)
    # Who is on the crosswalk at the first or the last record has no such kerb.
    begins = [(start_s, 0.0)] if rows[0] > on[0] or on[0] > 0 else []
    ends = [(end_s, length_m)] if rows[-1] < on[-1] or on[-1] < last else []
    between = walk[(walk[:, 0] > start_s) & (walk[:, 0] < end_s)].tolist()
    return np.array([*begins, *between, *ends]).reshape(-1, 2)


def _kerb(line: FloatArray, kerb_m: float, low_s: float, high_s: float) -> float:
    """When the straight line through two points (time, way) reaches a kerb, within bounds."""
    (a_s, a_m), (b_s, b_m) = line.tolist()
    at_s: float = min(max(a_s + (kerb_m - a_m) * (b_s - a_s) / max(b_m - a_m, 1e-9), low_s), high_s)
    return at_s


def _legs(points: FloatArray, left_m: FloatArray, near: bool, length_m: float) -> tuple[Leg, ...]:
    """The legs of a walk, x to the left of the axis; the last one stands at the other kerb."""
    legs: list[Leg] = []
    y_m = points[:, 1] if near else length_m - points[:, 1]
    rows = np.column_stack((points[:, 0], left_m, y_m)).tolist()
    for (time_s, x, y), (until_s, to_x, to_y) in pairwise(rows):
        x_mps, y_mps = (to_x - x) / (until_s - time_s), (to_y - y) / (until_s - time_s)
        last = legs[-1] if legs else None
        if last is None or abs(last.y_mps - y_mps) + abs(last.x_mps - x_mps) > 1e-9:
            legs.append(Leg(time_s, x, y, x_mps, y_mps, 0.0))
    legs.append(Leg(points[-1, 0], left_m[-1], y_m[-1], 0.0, 0.0, 0.0))
    return tuple(legs)


def moved(
    walk: Walk, since_s: float, length_m: float | None = None, *, leads_left: bool = False
) -> Walk:
    """A walk with other times, as a vehicle sees it that drives over the crosswalk.

    Args:
        walk: the walk.
        since_s: its times are counted from this time.
        length_m: the crosswalk's length, if the axis begins at the far kerb; None if at the near.
        leads_left: whether the axis leads to the vehicle's left; x is the way ahead.
    """
    arrival, legs, ahead = walk.arrival, walk.legs, -1.0 if leads_left else 1.0
    arrival = arrival._replace(arrival_s=arrival.arrival_s - since_s)
    if length_m is not None:
        arrival = arrival._replace(side=arrival.side.other)
    if legs is not None:
        up, from_m = (1.0, 0.0) if length_m is None else (-1.0, length_m)
        legs = tuple(
            Leg(
                leg.time_s - since_s,
                ahead * leg.x_m,
                from_m + up * leg.y_m,
                ahead * leg.x_mps,
                up * leg.y_mps,
                up * leg.y_mps2,
            )
            for leg in legs
        )
    start_s = None if walk.start_s is None else walk.start_s - since_s
    return replace(walk, arrival=arrival, start_s=start_s, legs=legs)
