"""The tables of some episodes of a cell.  The columns are described in docs/files.md."""

from collections.abc import Iterable, Iterator

import numpy as np
import pyarrow as pa

from harness.core.encounter import Arm, Side, Trace
from harness.measures import EpisodeRecord, Outcome
from harness.measures.motion.walking import cleared_s, states_at
from harness.old.store.schemas import EPISODES
from harness.old.store.tables import Motion, Row, table_of, traces_table
from harness.old.store.walk_rows import pedestrian_row, shown_states

_RECORD_COLUMNS = EPISODES.names[EPISODES.get_field_index("ending") :]


def _keys(cell: int, outcome: Outcome) -> Row:
    """The columns that identify the episode of a row."""
    return {"cell": cell, "pair": outcome.pair, "arm": outcome.arm.value}


def episode_rows(cell: int, outcomes: Iterable[Outcome]) -> pa.Table:
    """The table ``episodes``."""
    return table_of(
        "episodes",
        (
            _keys(cell, outcome)
            | {"strategy": outcome.strategy}
            | {name: getattr(outcome.record, name) for name in _RECORD_COLUMNS}
            for outcome in outcomes
        ),
    )


def pedestrian_rows(cell: int, outcomes: Iterable[Outcome]) -> pa.Table:
    """The table ``pedestrians``: everyone who arrived within the record."""
    return table_of(
        "pedestrians",
        (
            _keys(cell, outcome)
            | pedestrian_row(walk, cleared_s(walk, outcome.trace.crossing), outcome.record.end_s)
            for outcome in outcomes
            for walk in outcome.trace.walks
            if walk.arrival.arrival_s <= outcome.record.end_s
        ),
    )


def pair_rows(cell: int, episodes: pa.Table) -> pa.Table:
    """The table ``pairs`` from the episodes of one cell."""
    times: dict[int, dict[str, float | None]] = {}
    columns = (episodes[name].to_pylist() for name in ("pair", "arm", "pass_time_s"))
    for pair, arm, time in zip(*columns, strict=True):
        times.setdefault(pair, {})[arm] = time
    rows: list[Row] = []
    for pair, arms in times.items():
        av, human = arms[Arm.AV], arms[Arm.HUMAN]
        tau = None if av is None or human is None else av / human
        rows.append(
            {"cell": cell, "pair": pair, "av_time_s": av, "human_time_s": human, "tau": tau}
        )
    return table_of("pairs", rows)


def trace_rows(cell: int, outcomes: Iterable[Outcome]) -> pa.Table:
    """The table ``traces``: the ego's bumper and every pedestrian's centre.

    There is a row for each step of the record, with the acceleration of the step that begins there
    (null in the last row).  A pedestrian has rows from stepping off until they reach the other
    kerb.  With perception errors ``shown-<index>`` is a pedestrian as the strategy perceived them.
    """
    return traces_table(
        (_keys(cell, outcome), name, motion)
        for outcome in outcomes
        for name, motion in _motions(outcome.trace, outcome.record)
    )


def _motions(trace: Trace, record: EpisodeRecord) -> Iterator[tuple[str, Motion]]:
    if not len(trace.x_m):
        return  # the episode failed before its first state
    count = record.steps + 1
    times = np.arange(count, dtype=np.float64) * trace.step_s
    speeds = trace.speed_mps[:count]
    accelerations = [*(np.diff(speeds) / trace.step_s).tolist(), None]
    lane = np.full(count, trace.crossing.lane_centre_m)
    yield "ego", (times, trace.x_m[:count], lane, speeds, accelerations)
    for walk in trace.walks:
        if walk.start_s is None or walk.start_s >= record.end_s:
            continue
        since = times[times >= walk.start_s]
        x, y, speed, gain = states_at(walk, trace.crossing, since)
        on = y <= trace.crossing.length_m if walk.arrival.side is Side.NEAR else y >= 0
        motion = tuple(values[on] for values in (since, x, y, speed, gain))
        yield f"pedestrian-{walk.arrival.index}", motion
    for index, states in shown_states(trace, times).items():
        yield f"shown-{index}", tuple(zip(*states, strict=True))
