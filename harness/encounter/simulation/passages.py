"""SUMO's records of a vehicle and of people in; the trace of one passage out.

The records are positions and speeds, one step apart.  Between two records a vehicle moves as
``motion`` says, and a person walks straight at constant speed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.core.encounter import (
    Arrival,
    Crossing,
    Ending,
    FloatArray,
    Leg,
    Side,
    StepMotion,
    Trace,
    Vehicle,
    Walk,
)
from harness.measures import crossing_time
from harness.measures.ego import ego_state
from harness.site import WayOver

WAITING_M = 1.0
"""A person who stands within this distance of the kerb waits there."""
KERB_M = 0.02
"""A person nearer to a kerb than this is at it: SUMO may hold people 1 cm away from a kerb."""
STANDING_MPS = 0.1
"""SUMO's threshold for waiting."""


@dataclass(frozen=True, slots=True)
class VehicleTrack:
    """The records of a vehicle on a way over a crosswalk, one step apart.

    ``x_m`` is the position of its front bumper on the way (``WayOver.place_m``).
    Shapes (n,), n ≥ 2.
    """

    time_s: FloatArray
    x_m: FloatArray
    speed_mps: FloatArray


@dataclass(frozen=True, slots=True)
class PersonTrack:
    """The records of a person who goes over a crosswalk once, in the network's coordinates.

    ``on_crossing`` says whether each record is on the crossing's edge.  Earlier records, on the
    walking area, show how long they waited.  Shapes (n,).
    """

    id: str
    time_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    on_crossing: np.ndarray


def passage(
    track: VehicleTrack,
    people: Sequence[PersonTrack],
    way: WayOver,
    vehicle: Vehicle,
    *,
    motion: StepMotion,
    rounding_m: float = 0.0,
) -> Trace:
    """The trace of a vehicle's passage over a crosswalk.

    The trace begins at the first record within the vehicle's trigger range.  It ends at the first
    record with the rear beyond the crosswalk.  If the vehicle's records begin within the range, its
    trigger range is shortened accordingly.

    Args:
        track: the vehicle's records on the way.
        people: everybody who went over this crosswalk; their numbers are the indices of arrivals.
            People who are not there during the passage are left out.
        way: the vehicle's way over the crosswalk.
        vehicle: its constants; v0 is the speed of a free passage.
        motion: how it moves between two records.
        rounding_m: largest error of a recorded position.  Records within this distance of a walk at
            constant speed are left out.

    Returns:
        The trace, in the way's frame; ``timed_out`` if the rear never left the crosswalk.
    """
    base = _driven(track, way, vehicle, motion)
    begin_s = float(track.time_s[_first(track, vehicle)])
    length_s = (len(base.x_m) - 1) * base.step_s
    walks = []
    for index, person in enumerate(people):
        if person.time_s[-1] <= begin_s or person.time_s[0] >= begin_s + length_s:
            continue
        time_s = _in_steps(person.time_s - begin_s, base.step_s)
        walk = _walk(index, person, way, time_s, rounding_m)
        if walk is None or walk.legs is None or walk.legs[-1].time_s <= 0.0:
            continue
        if walk.arrival.arrival_s < length_s:
            walks.append(_seen(walk, base, length_s))
    return replace(base, walks=tuple(walks))


def _first(track: VehicleTrack, vehicle: Vehicle) -> int:
    """The first record within the trigger range."""
    return int(np.searchsorted(track.x_m, -vehicle.trigger_range_m - 1e-9))


def _driven(track: VehicleTrack, way: WayOver, vehicle: Vehicle, motion: StepMotion) -> Trace:
    """The trace without people."""
    first = _first(track, vehicle)
    rear_m = vehicle.length_m + way.crossing.width_m / 2
    last = int(np.searchsorted(track.x_m, rear_m))
    crossed = last < len(track.x_m)
    step_s = float(track.time_s[1] - track.time_s[0])
    whole = Trace(
        vehicle=vehicle,
        crossing=way.crossing,
        step_s=step_s,
        x_m=track.x_m[max(first - 1, 0) : last + 1].copy(),
        speed_mps=track.speed_mps[max(first - 1, 0) : last + 1].copy(),
        walks=(),
        ending=Ending.CROSSED if crossed else Ending.TIMED_OUT,
        reason=None,
        sumo_collision=None,
        fallback=False,
        motion=motion,
    )
    if first == 0:
        return replace(whole, vehicle=replace(vehicle, trigger_range_m=-float(track.x_m[0])))
    triggered_s = crossing_time(whole, -vehicle.trigger_range_m)
    return replace(
        whole,
        x_m=whole.x_m[1:],
        speed_mps=whole.speed_mps[1:],
        trace_offset_s=step_s - (triggered_s or 0.0),
    )


def _seen(walk: Walk, trace: Trace, length_s: float) -> Walk:
    """A walk with the vehicle's state at the moment of stepping off, if it is recorded."""
    assert walk.start_s is not None
    if not 0.0 <= walk.start_s <= length_s or len(trace.x_m) < 2:
        return walk
    x_m, speed_mps = ego_state(trace, walk.start_s)
    return replace(walk, range_m=-x_m, vehicle_speed_mps=speed_mps)


def _walk(
    index: int, person: PersonTrack, way: WayOver, time_s: FloatArray, rounding_m: float
) -> Walk | None:
    """The walk of a person from kerb to kerb, in the passage's time and the way's frame.

    ``time_s`` has the times of the records in the passage's time.  The walk is None if no part of a
    way over the crosswalk is recorded.  A person whose records end between the kerbs is gone
    afterwards.
    """
    crossing = way.crossing
    x_m, y_m = way.frame.to_road(person.x_m, person.y_m)
    on = np.flatnonzero(person.on_crossing)
    if not len(on):
        return None
    near = _goes_up(y_m, on, crossing)
    ahead_m = y_m if near else crossing.length_m - y_m
    points = _between_kerbs(np.column_stack((time_s, x_m, ahead_m)), on, crossing.length_m)
    if len(points) < 2:
        return None
    points = _simplified(points, rounding_m)
    side = Side.NEAR if near else Side.FAR
    start_s, end_s = float(points[0, 0]), float(points[-1, 0])
    walked_m = float(points[-1, 2] - points[0, 2])
    return Walk(
        # There is no quantile; NaN distinguishes them from timed pedestrians.
        arrival=Arrival(index, _arrival_s(time_s, x_m, ahead_m, on[0], start_s), side, math.nan),
        start_s=start_s,
        speed_mps=max(walked_m / (end_s - start_s), 1e-3),
        legs=_legs(points, side, crossing),
    )


def _in_steps(time_s: FloatArray, step_s: float) -> FloatArray:
    """Times with those at the beginning of a step free of rounding errors.

    Otherwise a leg that begins with a step may count in the step before, with its velocity.
    """
    whole = np.round(time_s / step_s) * step_s
    return np.where(np.abs(time_s - whole) < 1e-6 * step_s, whole, time_s)


def _goes_up(y_m: FloatArray, on: np.ndarray, crossing: Crossing) -> bool:
    """Whether they come from the near kerb."""
    first, last = max(on[0] - 1, 0), min(on[-1] + 1, len(y_m) - 1)
    moved_m = float(y_m[last] - y_m[first])
    return moved_m > 0 if moved_m else float(y_m[first]) < crossing.length_m / 2


def _between_kerbs(track: FloatArray, on: np.ndarray, length_m: float) -> FloatArray:
    """The rows (time, x, y ahead) of a walk from 0 to ``length_m``, cut at both kerbs.

    A person crosses a kerb at the speed of the nearest step between the kerbs, because they may
    have waited in the step before or may turn in the step after it.  If the kerb would then fall
    into another step, the point is taken from the straight line to the record beyond the kerb.
    """
    inside = (track[:, 2] >= KERB_M) & (track[:, 2] <= length_m - KERB_M)
    inside[: on[0]] = inside[on[-1] + 1 :] = False
    rows = np.flatnonzero(inside)
    if not len(rows):
        ends = track[max(on[0] - 1, 0)], track[min(on[-1] + 1, len(track) - 1)]
        if ends[0][2] > KERB_M or ends[1][2] < length_m - KERB_M:
            return track[:0]
        # The step is long: no record lies between the kerbs.
        return np.array([_cut(*ends, 0.0), _cut(*ends, length_m)])
    low, high = int(rows[0]), int(rows[-1])
    points = [track[low : high + 1]]
    start = _kerb(track, low, -1, 0.0, high)
    end = _kerb(track, high, 1, length_m, low)
    if start is not None:
        points.insert(0, start[None])
    if end is not None:
        points.append(end[None])
    joined = np.concatenate(points)
    return joined[np.concatenate(([True], np.diff(joined[:, 0]) > 1e-9))]


def _kerb(track: FloatArray, near: int, way: int, y_m: float, far: int) -> FloatArray | None:
    """The point at which a kerb is crossed; None if the records do not reach it.

    Args:
        track: rows (time, x, y ahead).
        near: the record between the kerbs that is nearest to this one.
        way: -1 for the kerb that they come from, 1 for the other one.
        y_m: y of the kerb.
        far: the record between the kerbs that is farthest from it.
    """
    beyond = near + way
    if not 0 <= beyond < len(track) or way * (track[beyond, 2] - y_m) < -KERB_M:
        return None
    if near != far:
        steady = _cut(track[near - way], track[near], y_m, beyond=True)
        if 0 <= way * (steady[0] - track[near, 0]) <= way * (track[beyond, 0] - track[near, 0]):
            return steady
    return _cut(track[near], track[beyond], y_m)


def _cut(before: FloatArray, after: FloatArray, y_m: float, *, beyond: bool = False) -> FloatArray:
    """The point of a straight step at which y is reached; with ``beyond`` also after the step."""
    rise = float(after[2] - before[2])
    share = (y_m - float(before[2])) / rise if rise else 0.0
    point: FloatArray = before + (share if beyond else min(max(share, 0.0), 1.0)) * (after - before)
    point[2] = y_m
    return point


def _simplified(points: FloatArray, rounding_m: float) -> FloatArray:
    """A walk without the points within rounding of a straight walk (Douglas and Peucker, 1973).

    The distance of a point is its distance from the straight walk's position at the same time; both
    the point and the ends of the walk may have errors.
    """
    keep = {0, len(points) - 1}
    spans = [(0, len(points) - 1)]
    while spans:
        low, high = spans.pop()
        if high - low < 2:
            continue
        part = points[low : high + 1]
        share = (part[:, :1] - part[0, 0]) / (part[-1, 0] - part[0, 0])
        off = part[:, 1:] - (part[0, 1:] + share * (part[-1, 1:] - part[0, 1:]))
        away = np.hypot(off[:, 0], off[:, 1])
        far = int(away.argmax())
        if away[far] > 2 * rounding_m + 1e-9:
            keep.add(low + far)
            spans += [(low, low + far), (low + far, high)]
    return points[sorted(keep)]


def _legs(points: FloatArray, side: Side, crossing: Crossing) -> tuple[Leg, ...]:
    """The legs of a walk; the last one stands at the other kerb, where the walk is over."""
    sign = 1.0 if side is Side.NEAR else -1.0
    legs = []
    for (time_s, x_m, ahead_m), (until_s, to_x_m, to_m) in zip(
        points[:-1].tolist(), points[1:].tolist(), strict=True
    ):
        taken_s = until_s - time_s
        y_m = crossing.place_of(side, crossing.length_m - ahead_m)
        across_mps = sign * (to_m - ahead_m) / taken_s
        legs.append(Leg(time_s, x_m, y_m, (to_x_m - x_m) / taken_s, across_mps, 0.0))
    end_s, end_x_m, _ = points[-1].tolist()
    legs.append(Leg(end_s, end_x_m, crossing.place_of(side, 0.0), 0.0, 0.0, 0.0))
    return tuple(legs)


def _arrival_s(
    time_s: FloatArray, x_m: FloatArray, ahead_m: FloatArray, first: int, start_s: float
) -> float:
    """When they began to wait within 1 m of the kerb, or when they stepped off without a wait."""
    arrival_s = start_s
    for number in range(first - 1, 0, -1):
        if ahead_m[number] < -WAITING_M:
            break
        taken_s = time_s[number] - time_s[number - 1]
        moved_m = math.hypot(x_m[number] - x_m[number - 1], ahead_m[number] - ahead_m[number - 1])
        if moved_m < STANDING_MPS * taken_s:
            arrival_s = float(time_s[number - 1])
    return min(arrival_s, start_s)
