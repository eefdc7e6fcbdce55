"""Which episodes a report shows, and their traces: kept ones read, others simulated again."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import pandas as pd

from harness.encounter import Arm, Ending
from harness.errors import HarnessError
from harness.network import network_of
from harness.replay.stored import differences_of
from harness.results.manifest import explained
from harness.results.tables import table_of
from harness.runs.run_data import RunData
from harness.scenario import hang_limit_s
from harness.scenario.options import HANG_AFTER_S
from harness.workers.execution import run_tasks
from harness.workers.pool import LocalPool, default_workers
from harness.workers.tasks import Task, TaskResult

ALL_BELOW = 50
"""A run of at most so many pairs is shown whole."""

_EACH = 5
"""Episodes of each kind."""

_WORKERS = 2
"""Processes that simulate again: enough for so few episodes."""

_MOST_MEDIANS = 12
"""Cells whose median is shown."""

TIME_ADVANTAGE = "smallest time advantage (passes 0 in calm yields too)"

_DANGEROUS = {
    "smallest PET": "pet_s",
    "smallest TTC": "min_ttc_s",
    "largest DRAC": "-max_drac_mps2",
}
"""Reasons by danger, with the AV's column; a minus before it asks for the largest values."""

Key = tuple[int, int]
"""(cell, pair)."""


@dataclass(frozen=True)
class ShownPair:
    """A pair with the traces of both arms, columns as ``RunData.traces``.

    ``reasons`` say why it is shown.  Where the trace was not kept, ``note`` says where it comes
    from and ``differences`` how the episode simulated again is not as stored.
    """

    cell: int
    pair: int
    reasons: tuple[str, ...]
    rows: pd.DataFrame
    note: str | None = None
    differences: tuple[str, ...] = ()


def choose_pairs(run: RunData) -> dict[str, list[Key]]:
    """The pairs worth watching, by reason: (cell, pair), the most dangerous first.

    Contacts come first, then the AV's smallest PET and TTC and its largest DRAC.  Cells share their
    pedestrians: by a measure each pair counts once, in the cell where it is most striking.  A
    reason without a pair is left out; the last one, ``other pairs``, completes a run of few.
    """
    episodes = run.episodes[run.episodes["ending"] != Ending.ENGINE_FAILED]
    av, human = (episodes[episodes["arm"] == arm.value] for arm in (Arm.AV, Arm.HUMAN))
    tau = run.pairs.dropna(subset="tau").sort_values("tau", kind="stable")
    found = {
        "crash of the AV": _keys(av[av["ending"] == Ending.CRASHED]),
        "crash of the human": _keys(human[human["ending"] == Ending.CRASHED]),
        **{reason: _most_striking(av, column) for reason, column in _DANGEROUS.items()},
        "slowest AV": _most_striking(av, "-pass_time_s"),
        "timed out": _keys(episodes[episodes["ending"] == Ending.TIMED_OUT]),
        "fallback": _keys(av[av["fallback"]]),
        "lowest τ": _keys(tau)[:1],
        "median τ": _medians(tau),
        "highest τ": _keys(tau.iloc[::-1])[:1],
        TIME_ADVANTAGE: _most_striking(av, "min_time_advantage_s"),
    }
    everyone = _keys(run.pairs, most=None)
    if len(everyone) <= ALL_BELOW:
        shown = {key for keys in found.values() for key in keys}
        found["other pairs"] = [key for key in everyone if key not in shown]
    return {reason: keys for reason, keys in found.items() if keys}


def _most_striking(rows: pd.DataFrame, column: str) -> list[Key]:
    """The pairs with the smallest values of a column, or with a minus before it the largest.

    Each pair counts once; there are none where a run is older than the column.
    """
    name = column.removeprefix("-")
    if name not in rows:
        return []
    known = rows.dropna(subset=name).sort_values(name, ascending=name == column, kind="stable")
    return _keys(known.drop_duplicates("pair"))


def _keys(rows: pd.DataFrame, most: int | None = _EACH) -> list[Key]:
    pairs = zip(rows["cell"].tolist(), rows["pair"].tolist(), strict=True)
    return list(dict.fromkeys(pairs))[:most]


def _medians(tau: pd.DataFrame) -> list[Key]:
    """The pair in the middle of each cell, sorted by τ (the lower one of two)."""
    keys = []
    for _, rows in tau.groupby("cell", sort=True):
        middle = rows.iloc[(len(rows) - 1) // 2]
        keys.append((int(middle["cell"]), int(middle["pair"])))
    return keys[:_MOST_MEDIANS]


def shown_pairs(run: RunData, chosen: dict[str, list[Key]]) -> list[ShownPair]:
    """The chosen pairs with their traces, each once, in the order of ``chosen``.

    Raises:
        HarnessError: there are no traces, and the pairs cannot be simulated again.
    """
    reasons: dict[Key, list[str]] = {}
    for reason, keys in chosen.items():
        for key in keys:
            reasons.setdefault(key, []).append(reason)
    if run.kept_traces:
        return [
            ShownPair(cell, pair, tuple(why), run.traces_of(cell, pair))
            for (cell, pair), why in reasons.items()
        ]
    again = {(shown.cell, shown.pair): shown for shown in _simulate(run, reasons)}
    return [replace(again[key], reasons=tuple(why)) for key, why in reasons.items()]


def _simulate(run: RunData, keys: Iterable[Key]) -> Iterator[ShownPair]:
    """The pairs run again on SUMO, and compared with what is stored."""
    for task, result in simulated_again([task_of(run, *key) for key in sorted(keys)]):
        differences = differences_from_stored(run, task, result, ("episodes", "pedestrians"))
        rows = table_of("traces", result.rows["traces"]).to_pandas()
        verdict = "differs from" if differences else "is identical to"
        note = f"Simulated again for this page; the record {verdict} the stored one."
        yield ShownPair(task.cell, task.first_pair, (), rows, note, differences)


def simulated_again(tasks: Sequence[Task]) -> Iterator[tuple[Task, TaskResult]]:
    """Run stored pairs again; a report keeps no log, for a pair's record says what became of it.

    In processes of their own: an episode may kill or hang the one it runs in.
    """
    pool = LocalPool(min(_WORKERS, default_workers(), max(1, len(tasks))))
    try:
        yield from run_tasks(pool, tasks, lambda _event, **_details: None)
    finally:
        pool.stop()


def differences_from_stored(
    run: RunData, task: Task, result: TaskResult, names: Iterable[str]
) -> tuple[str, ...]:
    """How the tables of these names that came out differ from those of the run, and why."""
    differences = (
        difference
        for name in names
        for difference in differences_of(
            name, result.rows[name], run.rows_of(name, task.cell, task.first_pair).to_pylist()
        )
    )
    return explained(differences, run.manifest, task.scenario, task.model)


def task_of(run: RunData, cell: int, pair: int) -> Task:
    """A stored pair as a task that is to keep its traces.

    Raises:
        HarnessError: its network or model is gone, or another one.
    """
    scenario = run.scenario_of(cell)
    network_of(scenario)
    return Task(
        cell=cell,
        first_pair=pair,
        count=1,
        scenario=scenario,
        model=run.model_of(cell),
        traces=True,
        hang_after_s=hang_limit_s(HANG_AFTER_S, scenario),
        stack_file=None,
        engine=run.engine,
    )


def nothing_to_show(error: HarnessError) -> str:
    """Why there is no episode to watch."""
    return f"Traces were not kept and the episodes could not be simulated again: {error}."
