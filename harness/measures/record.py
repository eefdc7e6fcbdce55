"""Traces in; the record of each episode, with every measure, out."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from harness.core.vocabulary import Arm, Contact, Ending, FailedIn, Trace
from harness.measures.chunk import Chunk, chunk_of
from harness.measures.contacts import Strike, strikes_of
from harness.measures.ego import ego_states
from harness.measures.measured import COLUMNS, MEASURES, Measure, Measured
from harness.measures.steps import legs_in, rows_of

Value = float | int | bool | None


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeRecord(Measured):
    """The stored results of an episode: a row of the table ``episodes`` (docs/files.md).

    ``end_s`` is the time of the record's end: the contact, the pass, the time-out or the failure;
    it is undefined if the episode failed before its first state, and so is every count then.  Each
    measure is an attribute (``record.pet_s``).  Undefined values are None.
    """

    ending: Ending
    reason: str | None
    failed_in: FailedIn | None
    end_s: float | None
    contact: Contact | None
    contact_index: int | None
    contact_time_s: float | None
    sumo_collision: bool | None
    fallback: bool
    steps: int | None
    pedestrians: int | None
    conditionings: int | None
    clamped: int | None
    near_clamped: int | None
    clamped_speed_excess_mps: float | None
    clamped_range_excess_m: float | None

    @property
    def values(self) -> dict[str, Value]:
        """The measures by their columns, in the order of ``MEASURES``."""
        return {column: getattr(self, column) for column in COLUMNS}


@dataclass(frozen=True, slots=True)
class Outcome:
    """An episode: its pair, arm and strategy, its record and its trace."""

    pair: int
    arm: Arm
    strategy: str
    record: EpisodeRecord
    trace: Trace


def has_contact(trace: Trace) -> bool:
    """Whether the ego touches a pedestrian anywhere in a trace; ``measure`` says when and where."""
    legs, ego = legs_in([trace]), ego_states([trace])
    return strikes_of([trace], rows_of(legs, ego, trace.step_s))[0] is not None


def measure(
    traces: Sequence[Trace], strikes: Sequence[Strike | None] | None = None
) -> list[EpisodeRecord]:
    """The record of every trace, in order.

    Args:
        traces: traces with the same vehicle, crossing and step (a chunk of one cell).  v0 and the
            trigger range of the vehicle may differ, and how late it obeys.
        strikes: the first contact of each trace, if its lane is not straight; its ``walk`` counts
            those of the trace's walkers who stepped off.  None: they are found in the traces.
    """
    if not traces:
        return []
    chunk = chunk_of(traces, strikes)
    columns = [_values(entry, chunk) for entry in MEASURES]
    return [
        _record(chunk, number, dict(zip(COLUMNS, values, strict=True)))
        for number, values in enumerate(zip(*columns, strict=True))
    ]


def _values(entry: Measure, chunk: Chunk) -> list[Value]:
    kind = entry.kind
    return [None if math.isnan(value) else kind(value) for value in entry.compute(chunk).tolist()]


def _record(chunk: Chunk, number: int, measures: dict[str, Any]) -> EpisodeRecord:
    """The record of one episode of a chunk, with its measures."""
    trace, strike = chunk.traces[number], chunk.strikes[number]
    end_s = float(chunk.end_s[number])
    began, model_use = not math.isnan(end_s), trace.conditionings
    on_foot = sum(walk.start_s is not None and walk.start_s < end_s for walk in trace.walks)
    return EpisodeRecord(
        ending=trace.ending if strike is None else Ending.CRASHED,
        reason=trace.reason,
        failed_in=trace.failed_in,
        end_s=end_s if began else None,
        contact=None if strike is None else strike.contact,
        contact_index=None if strike is None else chunk.legs.walks[strike.walk].arrival.index,
        contact_time_s=None if strike is None else strike.time_s,
        sumo_collision=trace.sumo_collision,
        fallback=trace.fallback,
        steps=int(chunk.steps[number]) if began else None,
        pedestrians=on_foot if began else None,
        conditionings=model_use.uses if began else None,
        clamped=model_use.clamped if began else None,
        near_clamped=model_use.near_clamped if began else None,
        clamped_speed_excess_mps=model_use.speed_excess_mps if model_use.clamped else None,
        clamped_range_excess_m=model_use.range_excess_m if model_use.clamped else None,
        **measures,
    )
