"""Which episodes a report shows, and their traces: kept ones read, others simulated again."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import pandas as pd

from harness.encounter import Arm, Ending
from harness.errors import HarnessError
from harness.pairing import PairRunner
from harness.results import table_of, trace_rows
from harness.run_data import RunData
from harness.stored import record_differences
from harness.worker import close_engine, engine_for

ALL_BELOW = 50
"""A run of at most so many pairs is shown whole."""

_EACH = 5
"""Episodes of each kind."""

_MOST_MEDIANS = 12
"""Cells whose median is shown."""

Key = tuple[int, int]
"""(cell, pair)."""


@dataclass(frozen=True)
class ShownPair:
    """A pair with the traces of both arms, columns as ``RunData.traces``.

    ``reasons`` say why it is shown; ``note`` says where the trace comes from, when it was not
    kept, and ``differences`` how an episode simulated again is not as stored.
    """

    cell: int
    pair: int
    reasons: tuple[str, ...]
    rows: pd.DataFrame
    note: str | None = None
    differences: tuple[str, ...] = ()


def choose_pairs(run: RunData) -> dict[str, list[Key]]:
    """The pairs worth watching, by reason: (cell, pair), the most striking first.

    A reason without a pair is left out; the last one, ``other pairs``, completes a run of few.
    """
    episodes = run.episodes[run.episodes["ending"] != Ending.ENGINE_FAILED]
    av, human = (episodes[episodes["arm"] == arm.value] for arm in (Arm.AV, Arm.HUMAN))
    tau = run.pairs.dropna(subset="tau").sort_values("tau", kind="stable")
    found = {
        "worst time advantage": _keys(
            av.dropna(subset="min_time_advantage_s").sort_values(
                "min_time_advantage_s", kind="stable"
            )
        ),
        "crash of the AV": _keys(av[av["ending"] == Ending.CRASHED]),
        "crash of the human": _keys(human[human["ending"] == Ending.CRASHED]),
        "slowest AV": _keys(
            av.dropna(subset="pass_time_s").sort_values(
                "pass_time_s", ascending=False, kind="stable"
            )
        ),
        "timed out": _keys(episodes[episodes["ending"] == Ending.TIMED_OUT]),
        "fallback": _keys(av[av["fallback"]]),
        "lowest τ": _keys(tau)[:1],
        "median τ": _medians(tau),
        "highest τ": _keys(tau.iloc[::-1])[:1],
    }
    everyone = _keys(run.pairs, most=None)
    if len(everyone) <= ALL_BELOW:
        shown = {key for keys in found.values() for key in keys}
        found["other pairs"] = [key for key in everyone if key not in shown]
    return {reason: keys for reason, keys in found.items() if keys}


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
    """The pairs run again on SUMO, cell by cell, and compared with what is stored."""
    by_cell: dict[int, list[int]] = {}
    for cell, pair in keys:
        by_cell.setdefault(cell, []).append(pair)
    try:
        for cell, pairs in sorted(by_cell.items()):
            yield from _simulate_cell(run, cell, sorted(pairs))
    finally:
        close_engine()


def _simulate_cell(run: RunData, cell: int, pairs: list[int]) -> Iterator[ShownPair]:
    scenario = run.scenario_of(cell)
    runner = PairRunner(scenario, run.model_of(cell), lambda: engine_for(scenario))
    outcomes = list(runner.run(pairs))
    for pair in pairs:
        both = [outcome for outcome in outcomes if outcome.pair == pair]
        stored = {
            name: run.rows_of(name, cell, pair).to_pylist() for name in ("episodes", "pedestrians")
        }
        differences: list[str] = []
        for outcome in both:
            own = (
                [row for row in rows if row["arm"] == outcome.arm.value] for rows in stored.values()
            )
            differences += record_differences(outcome, cell, *own)
        rows = table_of("traces", trace_rows(cell, both)).to_pandas()
        note = "Simulated again for this page; the record is identical to the stored one."
        if differences:
            note = "Simulated again for this page; the record differs from the stored one."
        yield ShownPair(cell, pair, (), rows, note, tuple(differences))


def nothing_to_show(error: HarnessError) -> str:
    """Why there is no episode to watch."""
    return f"Traces were not kept and the episodes could not be simulated again: {error}."
