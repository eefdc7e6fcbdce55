"""Time: how long the ego took, waited and stood."""

import numpy as np

from harness.encounter import FloatArray
from harness.measures.chunk import Chunk

STANDING_MPS = 0.1
"""Slower than this counts as stopped (SUMO's own threshold for waiting time)."""


def pass_time_s(chunk: Chunk) -> FloatArray:
    """From the trigger until the rear bumper leaves the far edge, in s; NaN if not crossed."""
    return chunk.pass_time_s


def delay_s(chunk: Chunk) -> FloatArray:
    """Pass time less the free pass time at v0, in s; NaN if not crossed."""
    vehicle = chunk.vehicle
    road = vehicle.trigger_range_m + vehicle.length_m + chunk.crossing.width_m / 2
    return chunk.pass_time_s - road / vehicle.initial_speed_mps


def stops(chunk: Chunk) -> FloatArray:
    """How often the speed at a step's end falls below 0.1 m/s."""
    trace, before, after = _standing(chunk)
    return np.bincount(trace[after & ~before], minlength=len(chunk.traces)).astype(float)


def stopped_s(chunk: Chunk) -> FloatArray:
    """Number of steps that end below 0.1 m/s, times the step, in s."""
    trace, _, after = _standing(chunk)
    count = np.bincount(trace[after], minlength=len(chunk.traces)).astype(float)
    return count * chunk.step_s


def pedestrian_delay_s(chunk: Chunk) -> FloatArray:
    """Mean wait at the kerb of those who came within the record, in s; NaN if nobody did.

    From arrival until stepping off, or until the record's end for whoever still waits then.
    Timed pedestrians, who have no quantile, wait for their time and for nobody else.
    """
    count, total = np.zeros(len(chunk.traces)), np.zeros(len(chunk.traces))
    for number, (trace, end_s) in enumerate(zip(chunk.traces, chunk.end_s.tolist(), strict=True)):
        for walk in trace.walks:
            arrival_s = walk.arrival.arrival_s
            if arrival_s <= end_s and walk.arrival.quantile is not None:
                count[number] += 1
                until_s = end_s if walk.start_s is None else min(walk.start_s, end_s)
                total[number] += until_s - arrival_s
    with np.errstate(invalid="ignore"):
        mean: FloatArray = total / count
    return mean


def _standing(chunk: Chunk) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of every step: whose it is, whether the ego stands at its beginning and at its end."""
    trace, state = chunk.record_steps()
    # The first step at a0 often ends at 0.1 m/s exactly, to the last bit but one.
    standing = chunk.ego.speed_mps < STANDING_MPS - 1e-9
    return trace, standing[state], standing[state + 1]
