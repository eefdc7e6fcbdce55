"""The pairs worth watching with their traces, simulated again if the run kept none.

Those of a run without traces are parts in ``RUN/shown``, or next to the page if the run cannot be
written.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from harness.core.encounter import Arm
from harness.core.errors import HarnessError, InputError
from harness.results.run import Run
from harness.results.tables import read_cell, write_part
from harness.studies.replay import RECORDS, differences_of, stored_tasks
from harness.studies.tasks import Task
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


def shown_pairs(
    run: Run, page: Path | None = None, say: Callable[[str], None] = lambda _text: None
) -> list[ShownPair]:
    """The pairs of ``chosen_pairs`` with their traces, each once.

    Args:
        run: a run with at least one finished pair.
        page: the file that shows the pairs, if it is not in the run folder.
        say: called with the reason if pairs could not be simulated again and are left out.
    """
    reasons: dict[Key, list[str]] = {}
    for reason, keys in chosen_pairs(run).items():
        for key in keys:
            reasons.setdefault(key, []).append(reason)
    kept = bool(run.manifest["traces"])
    places = [run.path / "shown", *([] if page is None else [page.parent / f"{page.stem}-shown"])]
    found = {} if kept else {key: _repeated(run, key, places) for key in reasons}
    missing = [key for key, pair in found.items() if pair is None or pair.differences]
    try:
        _simulate(run, missing, places)
    except HarnessError as error:
        say(f"pairs could not be simulated again: {error}")
    found |= {key: _repeated(run, key, places) for key in missing}
    pairs = {key: _kept(run, key) if kept else found[key] for key in reasons}
    return [
        replace(pair, reasons=tuple(reasons[key]))
        for key, pair in pairs.items()
        if pair is not None
    ]


def _kept(run: Run, key: Key) -> ShownPair:
    cell, pair = key
    read = (read_cell(run.path, name, cell, run.manifest, pair) for name in ("traces", RECORDS[1]))
    traces, people = (table.to_pandas() for table in read)
    return ShownPair(cell, pair, (), traces, people)


def _repeated(run: Run, key: Key, places: Sequence[Path]) -> ShownPair | None:
    """A pair that was simulated again; None if it was not, or if its part is damaged."""
    manifest = {**run.manifest, "pairs_per_part": 1}
    for place in places:
        try:
            names = (*RECORDS, "traces")
            tables = {name: read_cell(place, name, key[0], manifest, key[1]) for name in names}
        except InputError:
            continue
        if tables["episodes"].num_rows:
            traces, people = tables["traces"].to_pandas(), tables["pedestrians"].to_pandas()
            found = differences_of(run, *key, tables, tuple(Arm))
            return ShownPair(*key, (), traces, people, True, found)
    return None


def _simulate(run: Run, missing: Sequence[Key], places: Sequence[Path]) -> None:
    """Simulate pairs again, and write each as a part.

    Raises:
        HarnessError: the model, a strategy or the folder cannot be used.
    """
    tasks: list[Task] = []
    for cell in sorted({cell for cell, _ in missing}):
        pairs = sorted(pair for of, pair in missing if of == cell)
        engine, arms = run.manifest["engine"], tuple(Arm)
        for task in stored_tasks(run, cell, pairs, [Arm.AV]):
            tasks.append(replace(task, arms=arms, traces=True, engine=engine))
    if not tasks:
        return
    place = next((each for each in places if os.access(each.parent, os.W_OK)), places[0])
    place.mkdir(exist_ok=True)
    executor = LocalExecutor(min(default_workers(), len(tasks)), len(tasks))
    try:
        futures = {executor.submit(supervise, task): task for task in tasks}
        for future in as_completed(futures):
            for cell, tables in future.result().tables.items():
                write_part(place, cell, futures[future].first, tables, run.manifest["digest"])
    finally:
        executor.abort()
