"""The pairs worth watching with their traces, simulated again if the run kept none."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import pyarrow as pa

from harness.core.encounter import Arm
from harness.results.run import Run
from harness.results.tables import read_cell
from harness.studies.replay import differences_of, stored_tasks
from harness.studies.workers import LocalExecutor, default_workers, supervise
from harness.studies.worst import Key, chosen_pairs

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class ShownPair:
    """A pair with the traces of both arms.

    Attributes:
        cell, pair: which pair.
        reasons: why it is shown.
        traces, people: its rows of ``traces`` and ``pedestrians``.
        repeated: whether it was simulated again, because the run kept no traces.
        differences: how a repeated pair differs from its record.
    """

    cell: int
    pair: int
    reasons: tuple[str, ...]
    traces: "pd.DataFrame"
    people: "pd.DataFrame"
    repeated: bool = False
    differences: tuple[str, ...] = ()


def shown_pairs(run: Run) -> list[ShownPair]:
    """The pairs of ``chosen_pairs`` with their traces, each once.

    Args:
        run: a run with at least one finished pair.

    Raises:
        HarnessError: pairs cannot be simulated again.
    """
    reasons: dict[Key, list[str]] = {}
    for reason, keys in chosen_pairs(run).items():
        for key in keys:
            reasons.setdefault(key, []).append(reason)
    kept = bool(run.manifest["traces"])
    if kept:
        names = ("episodes", "pedestrians", "traces")
        found = {
            (cell, pair): {
                name: read_cell(run.path, name, cell, run.manifest, pair) for name in names
            }
            for cell, pair in reasons
        }
    else:
        found = dict(_simulated(run, reasons))
    shown = []
    for (cell, pair), whys in reasons.items():
        tables = found[cell, pair]
        traces, people = tables["traces"].to_pandas(), tables["pedestrians"].to_pandas()
        differences = () if kept else differences_of(run, cell, pair, tables, tuple(Arm))
        shown.append(ShownPair(cell, pair, tuple(whys), traces, people, not kept, differences))
    return shown


def _simulated(run: Run, keys: Collection[Key]) -> Iterator[tuple[Key, dict[str, pa.Table]]]:
    engine, arms = run.manifest["engine"], tuple(Arm)
    tasks = [
        replace(task, arms=arms, traces=True, engine=engine)
        for cell in sorted({cell for cell, _ in keys})
        for task in stored_tasks(run, cell, [pair for of, pair in keys if of == cell], [Arm.AV])
    ]
    executor = LocalExecutor(min(default_workers(), len(tasks)), len(tasks))
    try:
        for task, future in [(task, executor.submit(supervise, task)) for task in tasks]:
            number = task.cells[0].number
            yield (number, task.first), future.result().tables[number]
    finally:
        executor.abort()
