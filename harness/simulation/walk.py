"""People's ways over a crosswalk: from the places where SUMO had them to a walk between the kerbs.

Every place is a distance along the crosswalk's axis: 0 at its beginning, ``length_m`` at its end.
"""

from dataclasses import dataclass, field, replace
from itertools import starmap
from typing import NamedTuple

import numpy as np

from harness.core.vocabulary import (
    ROUNDING,
    STANDING_MPS,
    Arrival,
    Crossing,
    FloatArray,
    IntArray,
    Leg,
    Side,
    Walk,
)
from harness.measures.motion.walking import states_at
from harness.site.path import Places
from harness.site.town import Crosswalk

WAITING_M = 1.0
"""A person who stands within this distance of the kerb waits there."""
KERB_M = 0.02
"""A person nearer to a kerb than this is at it: SUMO may hold people 1 cm away from a kerb."""
_ROUNDING_S = 1e-7
"""A leg that begins no farther from a step begins with it."""


class Walked(NamedTuple):
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

    def places(self, time_s: FloatArray, crosswalk: Crosswalk) -> Places:
        """x + iy between the kerbs at some times, shape of time_s; NaN at other times."""
        assert self.walk.start_s is not None
        found = np.full(len(time_s), np.nan, complex)
        on = (time_s >= self.walk.start_s) & (time_s <= self.until_s)
        if on.any():
            road = Crossing(crosswalk.length_m, 1.0, 0.0, 1.0)
            left_m, along_m, *_ = states_at(self.walk, road, time_s[on])
            line = crosswalk.line
            found[on] = line.position(along_m) + 1j * left_m * line.heading(along_m)
        return found


@dataclass(slots=True, eq=False)
class SumoPerson:
    """Somebody whom SUMO moves, from the walking area before the crosswalk to the one beyond.

    Attributes:
        id: SUMO's id.
        index: their number in observations.
        near: whether they came from the beginning of the axis.
        states: (time in s, x + iy in m, whether SUMO had them on the crosswalk) at steps' ends.
    """

    id: str
    index: int
    near: bool
    states: list[tuple[float, complex, bool]] = field(default_factory=list)

    @property
    def on(self) -> bool:
        """Whether SUMO has them on the crosswalk."""
        return self.states[-1][2]

    def walked(self, crosswalk: Crosswalk) -> Walked | None:
        """Their way over it; None for those who only passed beside the kerb.

        It is also None for those who stepped off and were seen too briefly for a way.
        """
        time_s, places, on_it = map(np.array, zip(*self.states, strict=True))
        on, length_m = np.flatnonzero(on_it), crosswalk.length_m
        along_m, left_m = np.array([*map(crosswalk.line.foot, places.tolist())]).T
        near, last_s = self.near, float(time_s[-1])
        side, ahead_m = (Side.NEAR, along_m) if near else (Side.FAR, length_m - along_m)
        points = _from_kerb_to_kerb(time_s, ahead_m, on, length_m)
        waits_s = _waits_from(time_s, ahead_m, places, int(on[0]) if len(on) else len(time_s))
        if len(points) < 2:
            if len(on) or waits_s is None:
                return None
            walk = Walk(Arrival(self.index, waits_s, side, None))
            return Walked(self.id, False, walk, None, last_s)
        (start_s, from_m), (end_s, to_m) = points[0].tolist(), points[-1].tolist()
        came_s = start_s if waits_s is None else min(waits_s, start_s)
        y_m = points[:, 1] if near else length_m - points[:, 1]
        walk = Walk(
            Arrival(self.index, came_s, side, None),
            start_s,
            None if to_m <= from_m else (to_m - from_m) / (end_s - start_s),
            legs=_legs(points[:, 0], np.interp(points[:, 0], time_s, left_m), y_m),
        )
        cleared_s = end_s if to_m >= length_m - KERB_M else None
        return Walked(self.id, False, walk, cleared_s, last_s if cleared_s is None else cleared_s)


def moved(
    walk: Walk,
    since_s: float,
    step_s: float,
    length_m: float | None = None,
    *,
    leads_left: bool = False,
) -> Walk:
    """A walk with other times, as a vehicle sees it that drives over the crosswalk.

    Args:
        walk: the walk.
        since_s: its times are counted from this time.
        step_s: a leg that begins a rounding error beside a step of this length begins with it.
        length_m: the crosswalk's length, if the axis begins at the far kerb; None if at the near.
        leads_left: whether the axis leads to the vehicle's left; x is the way ahead.
    """
    arrival, legs, ahead = walk.arrival, walk.legs, -1.0 if leads_left else 1.0
    arrival = arrival._replace(arrival_s=arrival.arrival_s - since_s)
    up, from_m = (1.0, 0.0) if length_m is None else (-1.0, length_m)
    if length_m is not None:
        arrival = arrival._replace(side=arrival.side.other)
    if legs is not None:
        rows = np.array(legs) * [1.0, ahead, up, ahead, up, up] + [-since_s, 0, from_m, 0, 0, 0]
        whole_s = np.round(rows[:, 0] / step_s) * step_s
        rows[:, 0] = np.where(np.abs(rows[:, 0] - whole_s) < _ROUNDING_S, whole_s, rows[:, 0])
        legs = tuple(starmap(Leg, rows.tolist()))
    start_s = None if walk.start_s is None else walk.start_s - since_s
    return replace(walk, arrival=arrival, start_s=start_s, legs=legs)


def _waits_from(
    time_s: FloatArray, ahead_m: FloatArray, places: Places, first: int
) -> float | None:
    """When they began to stand within 1 m of the kerb, before record ``first``; None if never."""
    away = np.flatnonzero(ahead_m[:first] < -WAITING_M)
    since = int(away[-1]) if len(away) else 0
    moved_m = np.abs(np.diff(places[since:first]))
    stands = np.flatnonzero(moved_m < STANDING_MPS * np.diff(time_s[since:first]))
    return float(time_s[since + stands[0]]) if len(stands) else None


def _from_kerb_to_kerb(
    time_s: FloatArray, ahead_m: FloatArray, on: IntArray, length_m: float
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
    if rows[0] > on[0] or on[0] > 0:
        walk = np.vstack(((start_s, 0.0), walk[walk[:, 0] > start_s]))
    if rows[-1] < on[-1] or on[-1] < last:
        walk = np.vstack((walk[walk[:, 0] < end_s], (end_s, length_m)))
    return walk


def _kerb(line: FloatArray, kerb_m: float, low_s: float, high_s: float) -> float:
    """When the straight line through two points (time, way) reaches a kerb, within bounds."""
    (a_s, a_m), (b_s, b_m) = line.tolist()
    at_s: float = a_s + (kerb_m - a_m) * (b_s - a_s) / max(b_m - a_m, ROUNDING)
    return min(max(at_s, low_s), high_s)


def _legs(time_s: FloatArray, x_m: FloatArray, y_m: FloatArray) -> tuple[Leg, ...]:
    """The legs of a walk, one for each change of velocity; the last one stands at the end."""
    lasts_s = np.diff(time_s)
    x_mps, y_mps = (np.append(np.diff(each) / lasts_s, 0.0) for each in (x_m, y_m))
    change = np.abs(np.diff(x_mps)) + np.abs(np.diff(y_mps))
    begins = np.concatenate([[True], change[:-1] > ROUNDING, [True]])
    columns = np.column_stack((time_s, x_m, y_m, x_mps, y_mps, np.zeros(len(time_s))))
    return tuple(starmap(Leg, columns[begins].tolist()))
