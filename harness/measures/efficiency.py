"""Measures of delay: times of the ego and waits of the pedestrians."""

from collections.abc import Iterator

import numpy as np

from harness.core.vocabulary import ROUNDING, STANDING_MPS, BoolArray, FloatArray, IntArray, Walk
from harness.measures.chunk import Chunk


def delay_s(chunk: Chunk) -> FloatArray:
    """Pass time minus the free pass time at v0, in s; NaN if the ego did not cross."""
    free_s = np.array([each.vehicle.free_pass_time_s(each.crossing) for each in chunk.traces])
    return beyond(chunk.pass_time_s, free_s)


def beyond(time_s: FloatArray | float, free_s: FloatArray | float) -> FloatArray:
    """A time minus the time of a free passage, in s; differences up to 1e-9 s count as 0.

    A sum of step times and a quotient may differ in their last bits.
    """
    delay = np.subtract(time_s, free_s)
    return np.where(np.abs(delay) < ROUNDING, 0.0, delay)


def stops(chunk: Chunk) -> FloatArray:
    """Number of times the speed at a step's end falls below 0.1 m/s; NaN without a step."""
    trace, before, after = _standing(chunk)
    count = np.bincount(trace[after & ~before], minlength=len(chunk.traces))
    return np.where(chunk.steps > 0, count, np.nan)


def stopped_s(chunk: Chunk) -> FloatArray:
    """Number of steps that end below 0.1 m/s, times the step, in s; NaN without a step."""
    trace, _, after = _standing(chunk)
    count = np.bincount(trace[after], minlength=len(chunk.traces))
    return np.where(chunk.steps > 0, count * chunk.step_s, np.nan)


def max_speed_mps(chunk: Chunk) -> FloatArray:
    """Largest speed within the record, in m/s; NaN without a step."""
    trace, state = chunk.record_steps
    before, after = chunk.ego.speed_mps[state], chunk.ego.speed_mps[state + 1]
    # The record ends within its last step, in which the speed is linear.
    number = state - chunk.ego.first[trace]
    share = np.clip(chunk.end_s[trace] / chunk.step_s - number, 0.0, 1.0)
    return chunk.largest(trace, np.maximum(before, before + share * (after - before)))


def pedestrian_delay_s(chunk: Chunk) -> FloatArray:
    """Mean wait at the kerb of the people who arrived within the record, in s; NaN if nobody did.

    A wait lasts from arrival until stepping off, or until the record's end.  Timed pedestrians do
    not count, because they step off at a given time.
    """
    total = np.zeros(len(chunk.traces))
    for number, walk, end_s in _arrivals(chunk):
        until_s = end_s if walk.start_s is None else min(walk.start_s, end_s)
        total[number] += until_s - walk.arrival.arrival_s
    with np.errstate(invalid="ignore"):
        mean: FloatArray = total / arrivals(chunk)
    return mean


def arrivals(chunk: Chunk) -> FloatArray:
    """Number of people who arrived within the record, not timed ones; NaN without a state."""
    count = np.zeros(len(chunk.traces))
    for number, _, _ in _arrivals(chunk):
        count[number] += 1
    return np.where(np.isnan(chunk.end_s), np.nan, count)


def _arrivals(chunk: Chunk) -> Iterator[tuple[int, Walk, float]]:
    """Episode's number, walk and record's end for everyone who arrived within the record."""
    for number, (trace, end_s) in enumerate(zip(chunk.traces, chunk.end_s.tolist(), strict=True)):
        for walk in trace.walks:
            if 0 <= walk.arrival.arrival_s <= end_s and walk.arrival.path is None:
                yield number, walk, end_s


def _standing(chunk: Chunk) -> tuple[IntArray, BoolArray, BoolArray]:
    """For every step: its episode, and whether the ego stands at its beginning and at its end."""
    trace, state = chunk.record_steps
    # The first step at a0 often ends at 0.1 m/s, up to rounding.
    standing = chunk.ego.speed_mps < STANDING_MPS - ROUNDING
    return trace, standing[state], standing[state + 1]
