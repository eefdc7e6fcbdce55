"""From traces to measures: contact, surrogate safety measures, time.  Pure functions.

All traces of a chunk are worked through together, because numpy's cost is per call.  Every value
of an episode depends on that episode alone, to the last bit: which others are in the chunk makes
no difference.  Formulas, sources and undefined cases: docs/measures.md.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.contact import first_contact_in_step, gap, time_to_collision
from harness.encounter import (
    PEDESTRIAN_RADIUS_M,
    Arm,
    Contact,
    Ending,
    FloatArray,
    Side,
    Trace,
    Walk,
)

STANDING_MPS = 0.1
"""Slower than this counts as stopped (SUMO's own threshold for waiting time)."""


@dataclass(frozen=True, slots=True)
class EpisodeRecord:
    """What is kept of an episode; the columns of ``episodes.parquet`` (DESIGN: run folder).

    ``end_s`` is where the record ends: at the contact, the pass, the time-out or the failure.
    Undefined values are None.
    """

    ending: Ending
    reason: str | None
    end_s: float
    pass_time_s: float | None
    contact: Contact | None
    contact_index: int | None
    contact_time_s: float | None
    contact_speed_mps: float | None
    sumo_collision: bool | None
    fallback: bool
    steps: int
    pedestrians: int
    min_gap_m: float | None
    min_ttc_s: float | None
    min_time_advantage_s: float | None
    pet_s: float | None
    max_deceleration_mps2: float
    stops: int
    stopped_s: float
    delay_s: float | None


@dataclass(frozen=True, slots=True)
class Outcome:
    """One episode: which one it was, its record and its trace."""

    pair: int
    arm: Arm
    strategy: str
    record: EpisodeRecord
    trace: Trace


@dataclass(frozen=True, slots=True)
class _Strike:
    """A contact: when, with whom, where, at what speed of the ego."""

    time_s: float
    index: int
    contact: Contact
    speed_mps: float


@dataclass(frozen=True, slots=True)
class _Rows:
    """One row for each step of each pedestrian on the crossing, in order of traces and walks.

    ``start_s`` … ``stop_s`` is the part of the step in which he is on it; the ego's state is the
    one at ``start_s``.
    """

    trace: np.ndarray
    walk: np.ndarray
    start_s: FloatArray
    stop_s: FloatArray
    x_m: FloatArray
    x_stop_m: FloatArray
    speed_mps: FloatArray
    acceleration_mps2: FloatArray
    y_m: FloatArray
    walking_mps: FloatArray


def measure(traces: Sequence[Trace]) -> list[EpisodeRecord]:
    """The record of every trace, in order.

    Args:
        traces: of one vehicle, crossing and step (a chunk of one cell).
    """
    if not traces:
        return []
    walks = [
        (number, walk)
        for number, trace in enumerate(traces)
        for walk in trace.walks
        if walk.start_s is not None
    ]
    rows = _rows(traces, walks)
    strikes = _strikes(traces, walks, rows)
    passes = [_pass_time(trace) for trace in traces]
    ends = [
        _end(trace, strike, passed)
        for trace, strike, passed in zip(traces, strikes, passes, strict=True)
    ]
    proximity = _proximity(traces, rows, np.array(ends))
    return [
        _record(trace, strike, passed, end, tuple(near))
        for trace, strike, passed, end, near in zip(
            traces, strikes, passes, ends, proximity.tolist(), strict=True
        )
    ]


def crossing_time(trace: Trace, x_m: float) -> float | None:
    """When the front bumper reaches ``x_m``, exact within the step; None if it never does."""
    step = int(np.searchsorted(trace.x_m, x_m, side="left"))
    if step >= len(trace.x_m):
        return None
    if step == 0:
        return 0.0
    distance = x_m - float(trace.x_m[step - 1])
    before, after = float(trace.speed_mps[step - 1]), float(trace.speed_mps[step])
    acceleration = (after - before) / trace.step_s
    root = math.sqrt(max(0.0, before**2 + 2 * acceleration * distance))
    within = 2 * distance / (before + root) if before + root > 0 else trace.step_s
    return (step - 1) * trace.step_s + min(within, trace.step_s)


def ego_state(trace: Trace, time_s: float) -> tuple[float, float]:
    """(x of the bumper, speed) at any time of the trace."""
    step = min(int(time_s / trace.step_s), len(trace.x_m) - 2)
    elapsed = time_s - step * trace.step_s
    x, speed = float(trace.x_m[step]), float(trace.speed_mps[step])
    acceleration = (float(trace.speed_mps[step + 1]) - speed) / trace.step_s
    return x + speed * elapsed + acceleration * elapsed**2 / 2, speed + acceleration * elapsed


def post_encroachment_time(trace: Trace, walk: Walk) -> float | None:
    """PET of one pedestrian in s: from one leaving the contact zone to the other entering it.

    The zone is where the ego's width and the walker's disc cross.  0 if both were in it at once
    without touching (a corner); None if either never enters it.  Source: Allen, Shin, Cooper
    1978, with the pedestrian going on at his speed after the trace's end.
    """
    if walk.start_s is None or walk.speed_mps is None:
        return None
    crossing, half = trace.crossing, trace.vehicle.width_m / 2 + PEDESTRIAN_RADIUS_M
    lane = crossing.lane_centre_m
    if walk.arrival.side is Side.FAR:
        lane = crossing.length_m - lane
    ego_enters = crossing_time(trace, -PEDESTRIAN_RADIUS_M)
    ego_leaves = crossing_time(trace, trace.vehicle.length_m + PEDESTRIAN_RADIUS_M)
    enters = walk.start_s + max(0.0, lane - half) / walk.speed_mps
    leaves = walk.start_s + min(crossing.length_m, lane + half) / walk.speed_mps
    if ego_enters is None:
        return None
    if leaves <= ego_enters:
        return ego_enters - leaves
    if ego_leaves is None:
        return None
    return max(0.0, enters - ego_leaves)


def body_of(trace: Trace) -> tuple[float, float, float]:
    """(length, y of the right side, y of the left side) of the ego in m."""
    lane, half = trace.crossing.lane_centre_m, trace.vehicle.width_m / 2
    return trace.vehicle.length_m, lane - half, lane + half


def _pass_time(trace: Trace) -> float | None:
    if trace.ending is not Ending.CROSSED:
        return None
    # The episode ends within rounding of that point.
    passed_at = trace.vehicle.length_m + trace.crossing.width_m / 2
    return crossing_time(trace, min(passed_at, float(trace.x_m[-1])))


def _end(trace: Trace, strike: _Strike | None, pass_time_s: float | None) -> float:
    if strike is not None:
        return strike.time_s
    if pass_time_s is not None:
        return pass_time_s
    return (len(trace.x_m) - 1) * trace.step_s if len(trace.x_m) else 0.0


def _rows(traces: Sequence[Trace], walks: list[tuple[int, Walk]]) -> _Rows:
    step = traces[0].step_s
    crossing = traces[0].crossing
    steps = np.array([max(0, len(trace.x_m) - 1) for trace in traces], dtype=np.int64)
    offsets = np.concatenate(([0], np.cumsum([len(trace.x_m) for trace in traces])[:-1]))
    owner = np.array([number for number, _ in walks], dtype=np.int64)
    began = np.array([walk.start_s for _, walk in walks], dtype=float)
    pace = np.array([walk.speed_mps for _, walk in walks], dtype=float)
    far = np.array([walk.arrival.side is Side.FAR for _, walk in walks], dtype=bool)
    cleared = began + crossing.length_m / pace
    first = np.floor(began / step).astype(np.int64)
    # A start that is a step's time may fall just short of it as a quotient.
    first += (first + 1) * step <= began
    last = np.minimum(np.ceil(cleared / step).astype(np.int64), steps[owner])
    counts = np.maximum(last - first, 0)
    walk_of_row = np.repeat(np.arange(len(walks)), counts)
    within = np.arange(len(walk_of_row)) - np.repeat(np.cumsum(counts) - counts, counts)
    number = first[walk_of_row] + within
    trace_of_row = owner[walk_of_row]
    state = offsets[trace_of_row] + number
    x = np.concatenate([trace.x_m for trace in traces])
    speed = np.concatenate([trace.speed_mps for trace in traces])
    begin = number * step
    start = np.maximum(begin, began[walk_of_row])
    elapsed = start - begin
    acceleration = (speed[state + 1] - speed[state]) / step
    walking = np.where(far, -pace, pace)[walk_of_row]
    kerb = np.where(far, crossing.length_m, 0.0)[walk_of_row]
    return _Rows(
        trace=trace_of_row,
        walk=walk_of_row,
        start_s=start,
        stop_s=np.minimum(begin + step, cleared[walk_of_row]),
        x_m=x[state] + speed[state] * elapsed + acceleration * elapsed**2 / 2,
        x_stop_m=x[state + 1],
        speed_mps=speed[state] + acceleration * elapsed,
        acceleration_mps2=acceleration,
        y_m=kerb + walking * (start - began[walk_of_row]),
        walking_mps=walking,
    )


def _strikes(
    traces: Sequence[Trace], walks: list[tuple[int, Walk]], rows: _Rows
) -> list[_Strike | None]:
    """The first contact of every trace; exact work only where bounding boxes overlap."""
    found: list[_Strike | None] = [None] * len(traces)
    body = body_of(traces[0])
    length, right, left = body
    radius = PEDESTRIAN_RADIUS_M
    duration = rows.stop_s - rows.start_s
    y_stop = rows.y_m + rows.walking_mps * duration
    candidates = np.flatnonzero(
        (rows.x_stop_m >= -radius)
        & (rows.x_m <= length + radius)
        & (np.maximum(rows.y_m, y_stop) >= right - radius)
        & (np.minimum(rows.y_m, y_stop) <= left + radius)
        & (duration >= 0)
    )
    struck: set[int] = set()
    for row in candidates:
        walk, trace = int(rows.walk[row]), int(rows.trace[row])
        if walk in struck or traces[trace].ending is Ending.ENGINE_FAILED:
            continue
        within = first_contact_in_step(
            float(rows.x_m[row]),
            float(rows.speed_mps[row]),
            float(rows.acceleration_mps2[row]),
            float(rows.y_m[row]),
            float(rows.walking_mps[row]),
            float(duration[row]),
            body,
        )
        if within is None:
            continue
        struck.add(walk)
        time = float(rows.start_s[row]) + within
        earlier = found[trace]
        if earlier is None or time < earlier.time_s:
            speed = float(rows.speed_mps[row]) + float(rows.acceleration_mps2[row]) * within
            x, _ = ego_state(traces[trace], time)
            found[trace] = _Strike(
                time,
                walks[walk][1].arrival.index,
                Contact.FRONT if x <= 0 else Contact.SIDE,
                max(0.0, speed),
            )
    return found


def _proximity(traces: Sequence[Trace], rows: _Rows, ends: FloatArray) -> FloatArray:
    """Minimum gap, TTC and time advantage of every trace up to its end, shape (traces, 3)."""
    minima = np.full((3, len(traces)), np.inf)
    kept = rows.start_s < ends[rows.trace]
    trace, x, y = rows.trace[kept], rows.x_m[kept], rows.y_m[kept]
    speed, walking = rows.speed_mps[kept], rows.walking_mps[kept]
    body, crossing = body_of(traces[0]), traces[0].crossing
    np.minimum.at(minima[0], trace, gap(-x, y, body))
    np.minimum.at(minima[1], trace, time_to_collision(-x, y, speed, walking, body))
    lateral = (crossing.lane_centre_m - y) * np.sign(walking)
    ahead = (x < 0) & (lateral > 0) & (speed > 0)
    advantage = np.abs(-x[ahead] / speed[ahead] - lateral[ahead] / np.abs(walking[ahead]))
    np.minimum.at(minima[2], trace[ahead], advantage)
    return minima.T


def _record(
    trace: Trace,
    strike: _Strike | None,
    passed_s: float | None,
    end_s: float,
    minima: tuple[float, ...],
) -> EpisodeRecord:
    steps = min(math.ceil(end_s / trace.step_s - 1e-9), max(0, len(trace.x_m) - 1))
    speeds = trace.speed_mps[: steps + 1]
    braking = float(np.max(speeds[:-1] - speeds[1:], initial=0.0)) / trace.step_s
    # The first step at a0 often ends at 0.1 m/s exactly, to the last bit but one.
    standing = speeds < STANDING_MPS - 1e-9
    started = [w for w in trace.walks if w.start_s is not None and w.start_s < end_s]
    failed = trace.ending is Ending.ENGINE_FAILED
    crashed = strike is not None and not failed
    pass_time = None if crashed else passed_s
    encroachments = [] if crashed else [post_encroachment_time(trace, w) for w in started]
    defined = [value for value in encroachments if value is not None]
    vehicle = trace.vehicle
    road = vehicle.trigger_range_m + vehicle.length_m + trace.crossing.width_m / 2
    free_s = road / vehicle.initial_speed_mps
    smallest_gap, ttc, advantage = (value if value < np.inf else None for value in minima)
    return EpisodeRecord(
        ending=Ending.CRASHED if crashed else trace.ending,
        reason=trace.reason,
        end_s=end_s,
        pass_time_s=pass_time,
        contact=strike.contact if strike else None,
        contact_index=strike.index if strike else None,
        contact_time_s=strike.time_s if strike else None,
        contact_speed_mps=strike.speed_mps if strike else None,
        sumo_collision=trace.sumo_collision,
        fallback=trace.fallback,
        steps=steps,
        pedestrians=len(started),
        min_gap_m=0.0 if crashed else smallest_gap,
        min_ttc_s=ttc,
        min_time_advantage_s=advantage,
        pet_s=min(defined) if defined else None,
        max_deceleration_mps2=braking,
        stops=int(np.count_nonzero(standing[1:] & ~standing[:-1])),
        stopped_s=int(np.count_nonzero(standing[1:])) * trace.step_s,
        delay_s=None if pass_time is None else pass_time - free_s,
    )
