"""Arrays that the measures of a chunk of episodes share, computed once."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from harness.core.freezing import Frozen
from harness.core.vocabulary import (
    ROUNDING,
    BoolArray,
    Crossing,
    Ending,
    FloatArray,
    IntArray,
    Trace,
    Vehicle,
)
from harness.measures.contacts import Strike, strikes_of
from harness.measures.ego import EgoStates, body_of, crossing_time_s, ego_states
from harness.measures.motion.contact import Body, time_to_collision_s
from harness.measures.steps import Legs, Rows, legs_in, rows_of


@dataclass(frozen=True)
class Chunk(Frozen):
    """Traces with the same vehicle, crossing and step, and arrays computed from them.

    ``vehicle`` is the first trace's; v0, the trigger range and the actuation may differ.

    Arrays have one entry for each episode unless stated otherwise.
    """

    traces: tuple[Trace, ...]
    ego: EgoStates
    legs: Legs
    met: Rows
    """The rows that begin within the record."""
    ttc_s: FloatArray
    """Time to collision of every row of ``met``; infinite off a collision course."""
    strikes: tuple[Strike | None, ...]
    crashed: BoolArray
    pass_time_s: FloatArray
    """Time from the trigger until the rear bumper leaves the far edge; NaN after a contact, or
    if the ego did not cross."""
    pass_time_ignoring_contact_s: FloatArray
    """The pass time if contacts are ignored: the simulation continues after a contact."""
    end_s: FloatArray
    """The record's end: the contact, the pass, the time-out or the failure; NaN without a state."""
    steps: IntArray
    """Steps of the record."""

    @property
    def vehicle(self) -> Vehicle:
        """The ego's constants."""
        return self.traces[0].vehicle

    @property
    def crossing(self) -> Crossing:
        """The crosswalk's constants."""
        return self.traces[0].crossing

    @property
    def step_s(self) -> float:
        """Length of a step."""
        return self.traces[0].step_s

    @property
    def body(self) -> Body:
        """The ego's rectangle."""
        return body_of(self.traces[0])

    @cached_property
    def record_steps(self) -> tuple[IntArray, IntArray]:
        """Number of the episode and index of the state in ``ego`` of every step."""
        trace = np.repeat(np.arange(len(self.traces)), self.steps)
        within = np.arange(len(trace)) - np.repeat(np.cumsum(self.steps) - self.steps, self.steps)
        return trace, self.ego.first[trace] + within

    def smallest(self, trace: IntArray, values: FloatArray) -> FloatArray:
        """The smallest value of every episode; NaN if there is none, or if it is infinite.

        Args:
            trace: number of each value's episode.
            values: the values, without NaN.
        """
        minima = np.full(len(self.traces), np.inf)
        np.minimum.at(minima, trace, values)
        return np.where(np.isinf(minima), np.nan, minima)

    def largest(self, trace: IntArray, values: FloatArray) -> FloatArray:
        """The largest value of every episode; see ``smallest``."""
        return -self.smallest(trace, -values)


def chunk_of(traces: Sequence[Trace], strikes: Sequence[Strike | None] | None = None) -> Chunk:
    """Find contacts and ends of some episodes, at least one; see ``measure``."""
    ego, legs, step_s = ego_states(traces), legs_in(traces), traces[0].step_s
    rows = rows_of(legs, ego, step_s)
    if strikes is None:
        strikes = strikes_of(traces, rows)
    else:
        begins = np.searchsorted(legs.walk_trace, np.arange(len(traces))).tolist()
        strikes = [
            strike and replace(strike, walk=begin + strike.walk)
            for strike, begin in zip(strikes, begins, strict=True)
        ]
    passes = [_pass_time(trace) for trace in traces]
    ends = np.array(list(map(_end, traces, strikes, passes)))
    in_time = np.array(
        [
            math.nan if time is None else time + trace.trace_offset_s
            for trace, time in zip(traces, passes, strict=True)
        ]
    )
    crashed = np.array([strike is not None for strike in strikes])
    met = rows.where(rows.start_s < ends[rows.trace])
    steps = np.ceil(np.nan_to_num(ends) / step_s - ROUNDING)
    return Chunk(
        traces=tuple(traces),
        ego=ego,
        legs=legs,
        met=met,
        ttc_s=time_to_collision_s(
            met.ahead_m, met.walker_y_m, -met.closing_mps, met.walker_y_mps, body_of(traces[0])
        ),
        strikes=tuple(strikes),
        crashed=crashed,
        pass_time_s=np.where(crashed, np.nan, in_time),
        pass_time_ignoring_contact_s=in_time,
        end_s=ends,
        steps=np.minimum(steps.astype(np.int64), ego.steps),
    )


def _pass_time(trace: Trace) -> float | None:
    if trace.ending is not Ending.CROSSED:
        return None
    # The episode ends within rounding of that point.
    passed_at = trace.vehicle.length_m + trace.crossing.width_m / 2
    return crossing_time_s(trace, min(passed_at, float(trace.x_m[-1])))


def _end(trace: Trace, strike: Strike | None, pass_time_s: float | None) -> float:
    if strike is not None:
        return strike.time_s
    if pass_time_s is not None:
        return pass_time_s
    return (len(trace.x_m) - 1) * trace.step_s if len(trace.x_m) else math.nan
