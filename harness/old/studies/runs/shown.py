"""Chooses the pairs that a page shows and reads their traces.

A run with ``--traces`` contains all traces.  For any other run ``old.studies.batch.showing``
repeats the chosen pairs and stores them as shards in the folder ``shown`` of the run, or next to
the page.
"""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pyarrow as pa

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.old.store.manifest import explained
from harness.old.store.shards import DamagedShardError, Shard, read_shard, shard_name
from harness.old.store.simulations.simulation_traces import has_passages, only_passages
from harness.old.store.tables import Row
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.simulation_choice import Key
from harness.old.studies.runs.stored import differences_of
from harness.old.studies.runs.views import view_of

SHOWN = "shown"
"""The folder inside a run folder that contains the pairs repeated for the page."""

MARGIN_S = 1.0
"""Additional time in s that is read before and after the shown part."""


@dataclass(frozen=True)
class ShownPair:
    """A pair with the traces of both arms, from ``begin_s`` to ``end_s``.

    ``reasons`` are the reasons for showing the pair.  ``people`` has the rows of ``pedestrians``;
    for an hour, of ``walks``; for a user's own simulation, of ``scenes_over``.  ``differences``
    lists how a ``repeated`` pair differs from its record.
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

    def of_arm(self, arm: Arm) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Return the rows of ``traces`` and ``people`` of one arm."""
        traces, people = (rows[rows["arm"] == arm.value] for rows in (self.traces, self.people))
        return traces, people

    @property
    def note(self) -> str:
        """The origin of the traces; empty if the run kept them."""
        if not self.repeated:
            return ""
        verdict = "differs from" if self.differences else "is identical to"
        return f"Simulated again for the page; the record {verdict} the stored record."


def choose_pairs(run: RunData) -> dict[str, list[Key]]:
    """Choose the pairs worth watching, by reason; see ``View.chosen``."""
    return view_of(run).chosen(run)


def shown_pairs(run: RunData, page: Path | None = None) -> list[ShownPair]:
    """Return the chosen pairs with traces, without duplicates, in the order of ``choose_pairs``.

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


def _shown(run: RunData, key: Key, reasons: tuple[str, ...], page: Path | None) -> ShownPair | None:
    trace_names = run.kind.shown
    differences: tuple[str, ...] = ()
    passages = view_of(run).passages(run, *key)
    if run.kept_traces:
        tables = {name: run.rows_of(name, *key) for name in trace_names}
    else:
        kept = _repeated(run.path, key, page)
        if kept is None or (passages is not None and not has_passages(kept, passages)):
            return None
        tables, differences = kept, differences_in(run, key, kept)
    if passages is not None:
        tables = only_passages(tables, passages)
    traces, people = (tables[name].to_pandas() for name in trace_names)
    begin_s, end_s = 0.0, float(traces["time_s"].max()) if len(traces) else 0.0
    if (stretch := view_of(run).stretch(run, *key)) is not None:
        begin_s, end_s = stretch
        traces = traces[traces["time_s"].between(begin_s - MARGIN_S, end_s + MARGIN_S)]
    repeated = not run.kept_traces
    return ShownPair(*key, reasons, traces, people, begin_s, end_s, repeated, differences)


def _repeated(run: Path, key: Key, page: Path | None) -> dict[str, pa.Table] | None:
    """Return the tables of a repeated pair; None if they are missing or damaged."""
    for folder in shown_folders(run, page):
        with suppress(OSError, DamagedShardError):
            return read_shard(Shard(*key, 1, folder / shard_name(*key, 1)))
    return None


def differences_in(
    run: RunData, key: Key, tables: dict[str, pa.Table], arm: Arm | None = None
) -> tuple[str, ...]:
    """Return how a repeated pair differs from its record, in one arm or in both."""
    arms = [each.value for each in (Arm if arm is None else (arm,))]

    def rows(table: pa.Table) -> list[Row]:
        return [row for row in table.to_pylist() if row["arm"] in arms]

    differences = tuple(
        difference
        for name in run.kind.records
        for difference in differences_of(name, rows(tables[name]), rows(run.rows_of(name, *key)))
    )
    try:
        scenario, model = run.scenario_of(key[0]), run.model_of(key[0])
    except InputError:
        return differences
    return explained(differences, run.manifest, scenario, model)
