"""Chooses the pairs that a page shows and reads their traces.

A run with ``--traces`` contains all traces.  For any other run ``harness.studies.batch.showing``
repeats the chosen pairs and stores them as shards in the folder ``shown`` of the run, or next to
the page.
"""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pyarrow as pa

from harness.core.encounter import Arm, Ending
from harness.core.errors import InputError
from harness.store.manifest import explained
from harness.store.shards import DamagedShardError, Shard, read_shard, shard_name
from harness.studies.replay.stored import differences_of
from harness.studies.runs.run_data import RunData

SHOWN = "shown"
"""The folder inside a run folder with the pairs that were repeated for the page."""

ALL_BELOW = 50
"""A run with at most this many pairs is shown completely."""

STRETCH_S = 180.0
"""Time of an hour that is shown; a whole hour would be too large for a page."""

MARGIN_S = 1.0
"""Additional time that is read on either side."""

TIME_ADVANTAGE = "smallest time advantage (passes 0 in calm yields too)"

_EACH = 5
"""Number of episodes for each reason."""

_MOST_MEDIANS = 12
"""Number of cells with a median pair."""

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
    """A pair with the traces of both arms, from ``begin_s`` to ``end_s``.

    ``reasons`` say why the pair is shown.  ``people`` has the rows of ``pedestrians``, or of
    ``walks`` for an hour.  ``differences`` lists how a ``repeated`` pair differs from its record.
    """

    cell: int
    pair: int
    reasons: tuple[str, ...]
    traces: pd.DataFrame
    people: pd.DataFrame
    begin_s: float
    end_s: float
    repeated: bool = False
    differences: tuple[str, ...] = ()

    @property
    def note(self) -> str:
        """The origin of the traces; empty if the run kept them."""
        if not self.repeated:
            return ""
        verdict = "differs from" if self.differences else "is identical to"
        return f"Simulated again for the page; the record {verdict} the stored record."


def choose_pairs(run: RunData) -> dict[str, list[Key]]:
    """Choose the pairs worth watching, by reason: (cell, pair), the most dangerous first.

    Contacts come first, then the AV's smallest PET and TTC and its largest DRAC.  Cells share their
    pedestrians, so for a measure each pair counts once, in the cell with the most extreme value.
    Reasons without a pair are omitted.  The last reason, ``other pairs``, completes a small run.
    For hours the only choice is the hour with the AV's longest queue.
    """
    if run.kind.long_pairs:
        ran = run.hours[run.hours["reason"].isna()]
        both = ran.groupby(["cell", "pair"])["arm"].transform("size") == len(Arm)
        queues = ran[both & (ran["arm"] == Arm.AV.value)]
        longest = _keys(_by_danger(queues, "-queue_longest"), most=1)
        return {"longest queue of the AV's arm": longest} if longest else {}
    episodes = run.episodes[run.episodes["ending"] != Ending.ENGINE_FAILED]
    av, human = (episodes[episodes["arm"] == arm.value] for arm in (Arm.AV, Arm.HUMAN))
    tau = run.pairs.dropna(subset="tau").sort_values("tau", kind="stable")
    chosen = {
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
        shown = {key for keys in chosen.values() for key in keys}
        chosen["other pairs"] = [key for key in everyone if key not in shown]
    return {reason: keys for reason, keys in chosen.items() if keys}


def _by_danger(rows: pd.DataFrame, column: str) -> pd.DataFrame:
    """Sort rows by a column, smallest first; with a minus before its name largest first."""
    name = column.removeprefix("-")
    return rows.dropna(subset=name).sort_values(name, ascending=name == column, kind="stable")


def _most_striking(rows: pd.DataFrame, column: str) -> list[Key]:
    return _keys(_by_danger(rows, column).drop_duplicates("pair"))


def _keys(rows: pd.DataFrame, most: int | None = _EACH) -> list[Key]:
    pairs = zip(rows["cell"].tolist(), rows["pair"].tolist(), strict=True)
    return list(dict.fromkeys(pairs))[:most]


def _medians(tau: pd.DataFrame) -> list[Key]:
    """Return the pair with the median τ of each cell (the lower one of two)."""
    middles = [rows.iloc[[(len(rows) - 1) // 2]] for _, rows in tau.groupby("cell", sort=True)]
    return [key for middle in middles[:_MOST_MEDIANS] for key in _keys(middle)]


def shown_pairs(run: RunData, page: Path | None = None) -> list[ShownPair]:
    """Return the chosen pairs that have traces, each once, in the order of ``choose_pairs``.

    Args:
        run: a run with at least one finished pair.
        page: the file that shows the pairs; traces next to it are read as well.
    """
    reasons: dict[Key, list[str]] = {}
    for reason, keys in choose_pairs(run).items():
        for key in keys:
            reasons.setdefault(key, []).append(reason)
    shown = (_shown(run, key, tuple(why), page) for key, why in reasons.items())
    return [pair for pair in shown if pair is not None]


def missing_pairs(run: RunData, page: Path | None = None) -> list[Key]:
    """Return the chosen pairs without traces, or with traces that contradict the record."""
    if run.kept_traces:
        return []
    shown = {(pair.cell, pair.pair) for pair in shown_pairs(run, page) if not pair.differences}
    return sorted({key for keys in choose_pairs(run).values() for key in keys} - shown)


def shown_folders(run: Path, page: Path | None) -> list[Path]:
    """Return the folders for repeated pairs: in the run folder, and next to a page."""
    return [run / SHOWN, *([] if page is None else [page.parent / f"{page.stem}-{SHOWN}"])]


def stretch_of(run: RunData, cell: int, pair: int) -> tuple[float, float]:
    """Return begin and end, in s, of the three minutes around the AV's longest queue."""
    duration_s = run.scenario_of(cell).known_traffic.duration_s
    queues = run.queues
    queues = queues[(queues["cell"] == cell) & (queues["pair"] == pair) & (queues["arm"] == Arm.AV)]
    worst = queues.sort_values(["longest", "minute"], ascending=[False, True]).iloc[0]
    middle_s = 60.0 * float(worst["minute"]) + 30.0
    begin_s = min(max(0.0, middle_s - STRETCH_S / 2), max(0.0, duration_s - STRETCH_S))
    return begin_s, min(begin_s + STRETCH_S, duration_s)


def _shown(run: RunData, key: Key, reasons: tuple[str, ...], page: Path | None) -> ShownPair | None:
    trace_names = run.kind.shown
    differences: tuple[str, ...] = ()
    if run.kept_traces:
        tables = {name: run.rows_of(name, *key) for name in trace_names}
    else:
        kept = _repeated(run.path, key, page)
        if kept is None:
            return None
        tables, differences = kept, _differences(run, key, kept)
    traces, people = (tables[name].to_pandas() for name in trace_names)
    begin_s, end_s = 0.0, float(traces["time_s"].max()) if len(traces) else 0.0
    if run.kind.long_pairs:
        begin_s, end_s = stretch_of(run, *key)
        traces = traces[traces["time_s"].between(begin_s - MARGIN_S, end_s + MARGIN_S)]
    repeated = not run.kept_traces
    return ShownPair(*key, reasons, traces, people, begin_s, end_s, repeated, differences)


def _repeated(run: Path, key: Key, page: Path | None) -> dict[str, pa.Table] | None:
    """Return the tables of a repeated pair; None if they are missing or damaged."""
    for folder in shown_folders(run, page):
        with suppress(OSError, DamagedShardError):
            return read_shard(Shard(*key, 1, folder / shard_name(*key, 1)))
    return None


def _differences(run: RunData, key: Key, tables: dict[str, pa.Table]) -> tuple[str, ...]:
    differences = tuple(
        difference
        for name in run.kind.records
        for difference in differences_of(
            name, tables[name].to_pylist(), run.rows_of(name, *key).to_pylist()
        )
    )
    try:
        scenario, model = run.scenario_of(key[0]), run.model_of(key[0])
    except InputError:
        return differences
    return explained(differences, run.manifest, scenario, model)
