"""A trace in; the ego's position at any time, and the time at any position, out.

Within a step the acceleration or the speed is constant (``Trace.motion``), so both are exact.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.freezing import Frozen
from harness.core.vocabulary import ROUNDING, BoolArray, FloatArray, IntArray, Trace
from harness.measures.motion.contact import Body, Motion


@dataclass(frozen=True, slots=True)
class EgoStates(Frozen):
    """The states of all egos of a chunk, one after another.

    ``first`` is the index of each trace's first state; ``steps`` is the number of its steps.
    ``euler`` says for each trace whether its ego drives each step at that step's final speed.
    """

    x_m: FloatArray
    speed_mps: FloatArray
    first: IntArray
    steps: IntArray
    euler: BoolArray


def ego_states(traces: Sequence[Trace]) -> EgoStates:
    """The states of every trace; a trace may have none."""
    counts = np.array([len(trace.x_m) for trace in traces], dtype=np.int64)
    return EgoStates(
        x_m=np.concatenate([trace.x_m for trace in traces]),
        speed_mps=np.concatenate([trace.speed_mps for trace in traces]),
        first=np.cumsum(counts) - counts,
        steps=np.maximum(counts - 1, 0),
        euler=np.array([trace.motion == "euler" for trace in traces], dtype=bool),
    )


def crossing_time_s(trace: Trace, x_m: float) -> float | None:
    """The exact time at which the front bumper reaches ``x_m``; None if it never does.

    The time is 0 if the bumper is there, or past it, in the first state.
    """
    step = int(trace.x_m.searchsorted(x_m))
    if step >= len(trace.x_m):
        return None
    if step == 0:
        return 0.0
    distance = x_m - float(trace.x_m[step - 1])
    before, after = _speeds(trace, step - 1)
    acceleration = (after - before) / trace.step_s
    root = math.sqrt(max(0.0, before**2 + 2 * acceleration * distance))
    within = 2 * distance / (before + root) if before + root > 0 else trace.step_s
    return (step - 1) * trace.step_s + min(within, trace.step_s)


def ego_state(trace: Trace, time_s: float) -> tuple[float, float]:
    """(x of the bumper, speed) at any time of the trace."""
    step = min(int(time_s / trace.step_s), len(trace.x_m) - 2)
    elapsed = time_s - step * trace.step_s
    x, (speed, after) = float(trace.x_m[step]), _speeds(trace, step)
    acceleration = (after - speed) / trace.step_s
    return x + speed * elapsed + acceleration * elapsed**2 / 2, speed + acceleration * elapsed


def ego_positions(trace: Trace, time_s: FloatArray) -> FloatArray:
    """x of the bumper at some times of the trace, shape of time_s."""
    step = np.minimum((time_s / trace.step_s).astype(int), len(trace.x_m) - 2)
    elapsed, speed, after = (
        time_s - step * trace.step_s,
        trace.speed_mps[step],
        trace.speed_mps[step + 1],
    )
    speed = after if trace.motion == "euler" else speed
    x_m: FloatArray = trace.x_m[step] + elapsed * (
        speed + (after - speed) / trace.step_s * elapsed / 2
    )
    return x_m


def motion_within(trace: Trace, begin_s: float, end_s: float) -> Iterator[tuple[float, Motion]]:
    """The recorded motion between two times of a trace: when each piece begins, and the piece."""
    step = int(begin_s / trace.step_s + ROUNDING)
    while begin_s < end_s - ROUNDING:
        x, speed = ego_state(trace, begin_s)
        before, after = _speeds(trace, step)
        yield begin_s, Motion(x, speed, (after - before) / trace.step_s)
        step += 1
        begin_s = step * trace.step_s


def _speeds(trace: Trace, step: int) -> tuple[float, float]:
    """The speeds at the beginning and the end of a step, under the trace's ``motion``."""
    after = float(trace.speed_mps[step + 1])
    return (after if trace.motion == "euler" else float(trace.speed_mps[step])), after


def body_of(trace: Trace) -> Body:
    """The ego's rectangle."""
    lane, half = trace.crossing.lane_centre_m, trace.vehicle.width_m / 2
    return Body(trace.vehicle.length_m, lane - half, lane + half)
