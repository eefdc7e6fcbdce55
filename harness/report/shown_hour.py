"""The hour that a report shows, and everybody's way through it: read, or simulated again."""

from dataclasses import dataclass

import pandas as pd

from harness.encounter import Arm
from harness.errors import HarnessError
from harness.report.episode_traces import differences_from_stored, simulated_again, task_of
from harness.results.tables import HOUR_TABLES, HOUR_TRACES, table_of
from harness.runs.run_data import RunData


@dataclass(frozen=True)
class ShownHour:
    """A stretch of one pair, from ``begin_s`` to ``end_s`` since the end of the warm-up.

    ``ways`` has the rows of ``traces`` of both arms, ``walks`` those of ``walks``.  Where they
    were not kept, ``note`` says where they come from and ``differences`` how the hour simulated
    again is not as stored.
    """

    cell: int
    pair: int
    begin_s: float
    end_s: float
    ways: pd.DataFrame
    walks: pd.DataFrame
    note: str
    differences: tuple[str, ...] = ()


STRETCH_S = 180.0
"""How much of an hour is shown: all of it would be too large for a page."""


def shown_hour(run: RunData) -> ShownHour | None:
    """The three minutes around the longest queue of the AV's arm; None where no pair ran.

    Raises:
        HarnessError: there are no traces, and the hour cannot be simulated again.
    """
    ran = run.hours[run.hours["reason"].isna()]
    both = ran.groupby(["cell", "pair"])["arm"].transform("size") == len(Arm)
    av = ran[both & (ran["arm"] == Arm.AV.value)]
    if av.empty:
        return None
    longest = av.sort_values(["queue_longest", "cell", "pair"], ascending=[False, True, True])
    cell, pair = int(longest.iloc[0]["cell"]), int(longest.iloc[0]["pair"])
    begin_s, end_s = _stretch(run, cell, pair)
    ways, walks, note, differences = _ways(run, cell, pair)
    return ShownHour(cell, pair, begin_s, end_s, ways, walks, note, differences)


def _stretch(run: RunData, cell: int, pair: int) -> tuple[float, float]:
    traffic = run.scenario_of(cell).known_traffic
    queues = run.queues
    own = queues[(queues["cell"] == cell) & (queues["pair"] == pair) & (queues["arm"] == Arm.AV)]
    worst = own.sort_values(["longest", "minute"], ascending=[False, True]).iloc[0]
    middle_s = 60.0 * float(worst["minute"]) + 30.0
    begin_s = min(max(0.0, middle_s - STRETCH_S / 2), max(0.0, traffic.duration_s - STRETCH_S))
    return begin_s, min(begin_s + STRETCH_S, traffic.duration_s)


def _ways(
    run: RunData, cell: int, pair: int
) -> tuple[pd.DataFrame, pd.DataFrame, str, tuple[str, ...]]:
    if run.kept_traces:
        traces, walks = (run.rows_of(name, cell, pair) for name in HOUR_TRACES)
        return traces.to_pandas(), walks.to_pandas(), "", ()
    results = list(simulated_again([task_of(run, cell, pair)]))
    if len(results) != 1:
        raise HarnessError(f"cell {cell} pair {pair} could not be simulated again")
    task, result = results[0]
    differences = differences_from_stored(run, task, result, HOUR_TABLES)
    verdict = "differ from" if differences else "are identical to"
    note = f"Simulated again for this page; the records {verdict} the stored ones."
    ways, walks = (table_of(name, result.rows[name]).to_pandas() for name in HOUR_TRACES)
    return ways, walks, note, differences
