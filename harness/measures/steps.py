"""Traces in; the states of ego and pedestrians at every step out.

A walk is straight legs with constant velocity along the road and constant acceleration across it;
``avoidable`` and ``motion/walking`` rely on this form too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.freezing import Frozen
from harness.core.vocabulary import (
    ROUNDING,
    BoolArray,
    FloatArray,
    IntArray,
    Leg,
    Side,
    Trace,
    Walk,
)
from harness.measures.ego import EgoStates
from harness.measures.motion import walking


@dataclass(frozen=True, slots=True)
class Legs(Frozen):
    """Straight parts of walks, in order of traces, walks and time.

    ``walk`` numbers the pedestrians who stepped off, over all traces.  A leg begins at
    (``x_m``, ``y_m``) with ``x_mps`` along the road and ``y_mps`` across it, which
    changes by ``y_mps2``.
    """

    trace: IntArray
    walk: IntArray
    begin_s: FloatArray
    end_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    x_mps: FloatArray
    y_mps: FloatArray
    y_mps2: FloatArray
    walks: tuple[Walk, ...]
    """The walks by number; ``walk_trace`` and ``from_far`` have an entry for each walk."""
    walk_trace: IntArray
    """Number of the walk's trace."""
    from_far: BoolArray


@dataclass(frozen=True, slots=True)
class Rows(Frozen):
    """One row for each step of each pedestrian on the crossing, in order of traces and walks.

    The pedestrian is on the crossing from ``start_s`` to ``stop_s`` of the step.  The other columns
    are values at ``start_s``: ``x_m`` of the ego's bumper (``x_stop_m``: at the step's end), the
    ego's speed and acceleration, and the pedestrian's position (``walker_x_m``, ``walker_y_m``)
    and velocity.
    """

    trace: IntArray
    walk: IntArray
    start_s: FloatArray
    stop_s: FloatArray
    x_m: FloatArray
    x_stop_m: FloatArray
    speed_mps: FloatArray
    acceleration_mps2: FloatArray
    walker_x_m: FloatArray
    walker_y_m: FloatArray
    walker_x_mps: FloatArray
    walker_y_mps: FloatArray
    walker_y_mps2: FloatArray

    @property
    def ahead_m(self) -> FloatArray:
        """The pedestrian's distance ahead of the bumper; negative beside the body."""
        return self.walker_x_m - self.x_m

    @property
    def closing_mps(self) -> FloatArray:
        """The rate at which ``ahead_m`` falls."""
        return self.speed_mps - self.walker_x_mps

    def where(self, keep: BoolArray) -> "Rows":
        """The rows that a mask keeps."""
        return Rows(*(getattr(self, name)[keep] for name in Rows.__slots__))


def legs_in(traces: Sequence[Trace]) -> Legs:
    """The legs of everyone who stepped off."""
    crossing = traces[0].crossing
    walks: list[Walk] = []
    owners: list[int] = []
    numbers: list[int] = []
    ends: list[float] = []
    legs: list[Leg] = []
    for owner, trace in enumerate(traces):
        for walk in trace.walks:
            if walk.start_s is None:
                continue
            stretches = walking.legs_of(walk, crossing)
            # A pedestrian who stops for good stays until the end of the trace.
            trace_end_s = max(stretches[-1].time_s, (len(trace.x_m) - 1) * trace.step_s)
            cleared = walking.cleared_s(walk, crossing)
            numbers += [len(walks)] * len(stretches)
            ends += [leg.time_s for leg in stretches[1:]]
            ends.append(trace_end_s if cleared is None else cleared)
            legs += stretches
            walks.append(walk)
            owners.append(owner)
    walk_trace, walk_numbers = (np.array(each, dtype=np.int64) for each in (owners, numbers))
    begin_s, x, y, x_mps, y_mps, y_mps2 = np.array(legs, dtype=float).reshape(-1, 6).T
    return Legs(
        trace=walk_trace[walk_numbers],
        walk=walk_numbers,
        begin_s=begin_s,
        end_s=np.array(ends, dtype=float),
        x_m=x,
        y_m=y,
        x_mps=x_mps,
        y_mps=y_mps,
        y_mps2=y_mps2,
        walks=tuple(walks),
        walk_trace=walk_trace,
        from_far=np.array([walk.arrival.side is Side.FAR for walk in walks], dtype=bool),
    )


def time_at_s(legs: Legs, across_m: FloatArray, length_m: float) -> FloatArray:
    """The time at which each walk first reaches a distance across the road, in s; NaN if never.

    Args:
        legs: the legs of all walks.
        across_m: distance from the walker's kerb, one for each walk, shape (walks,).
        length_m: length of the crosswalk, kerb to kerb.
    """
    far = legs.from_far[legs.walk]
    forward = np.where(far, -1.0, 1.0)
    ahead_m = across_m[legs.walk] - np.where(far, length_m - legs.y_m, legs.y_m)
    speed, gain = forward * legs.y_mps, forward * legs.y_mps2
    with np.errstate(divide="ignore", invalid="ignore"):
        # 2d/(v + sqrt(v² + 2ad)) is d/v without acceleration, to the last bit.
        time = legs.begin_s + 2 * ahead_m / (speed + np.sqrt(speed**2 + 2 * gain * ahead_m))
    # The far kerb may lie beyond the end by a rounding error.
    on_leg = (time >= legs.begin_s) & (time <= legs.end_s + ROUNDING)
    first = np.full(len(legs.walks), np.inf)
    np.minimum.at(first, legs.walk[on_leg], time[on_leg])
    return np.where(np.isinf(first), np.nan, first)


def x_range(legs: Legs, since_s: FloatArray, until_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Smallest and largest x of each walk between two times, in m; NaN if it has no state then.

    Args:
        legs: the legs of all walks.
        since_s: beginning for each walk, shape (walks,); NaN if there is none.
        until_s: end for each walk, shape (walks,); NaN for the walk's end.
    """
    until_s = np.where(np.isnan(until_s), np.inf, until_s)
    begin_s = np.maximum(legs.begin_s, since_s[legs.walk])
    end_s = np.minimum(legs.end_s, until_s[legs.walk])
    within = begin_s <= end_s
    walk = legs.walk[within]
    low, high = np.full(len(legs.walks), np.inf), np.full(len(legs.walks), -np.inf)
    for time in (begin_s, end_s):
        x = (legs.x_m + legs.x_mps * (time - legs.begin_s))[within]
        np.minimum.at(low, walk, x)
        np.maximum.at(high, walk, x)
    missing = np.isinf(low)
    return np.where(missing, np.nan, low), np.where(missing, np.nan, high)


def rows_of(legs: Legs, ego: EgoStates, step_s: float) -> Rows:
    """Every step of every leg until the end of the ego's trace."""
    first = np.floor(legs.begin_s / step_s).astype(np.int64)
    # Because of rounding, a leg that begins with a step may be assigned to the step before.
    first += (first + 1) * step_s <= legs.begin_s
    # A pedestrian who stepped off before the trace began is present from its first step on.
    first = np.maximum(first, 0)
    last = np.ceil(legs.end_s / step_s).astype(np.int64)
    # A leg that ends with a step may be assigned to the step after it.
    last -= (last - 1) * step_s >= legs.end_s
    last = np.minimum(last, ego.steps[legs.trace])
    counts = np.maximum(last - first, 0)
    leg = np.repeat(np.arange(len(counts)), counts)
    within = np.arange(len(leg)) - np.repeat(np.cumsum(counts) - counts, counts)
    number = first[leg] + within
    trace = legs.trace[leg]
    state = ego.first[trace] + number
    begin_s = number * step_s
    start_s = np.maximum(begin_s, legs.begin_s[leg])
    elapsed_s = start_s - begin_s
    after = ego.speed_mps[state + 1]
    speed = np.where(ego.euler[trace], after, ego.speed_mps[state])
    acceleration = (after - speed) / step_s
    walked_s = start_s - legs.begin_s[leg]
    return Rows(
        trace=trace,
        walk=legs.walk[leg],
        start_s=start_s,
        stop_s=np.minimum(begin_s + step_s, legs.end_s[leg]),
        x_m=ego.x_m[state] + speed * elapsed_s + acceleration * elapsed_s**2 / 2,
        x_stop_m=ego.x_m[state + 1],
        speed_mps=speed + acceleration * elapsed_s,
        acceleration_mps2=acceleration,
        walker_x_m=legs.x_m[leg] + legs.x_mps[leg] * walked_s,
        walker_y_m=legs.y_m[leg] + legs.y_mps[leg] * walked_s + legs.y_mps2[leg] * walked_s**2 / 2,
        walker_x_mps=legs.x_mps[leg],
        walker_y_mps=legs.y_mps[leg] + legs.y_mps2[leg] * walked_s,
        walker_y_mps2=legs.y_mps2[leg],
    )
