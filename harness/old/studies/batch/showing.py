"""Repeats the pairs that a page shows if the run kept no traces of them."""

import os
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from harness.core.encounter import Arm
from harness.core.errors import HarnessError, InputError
from harness.core.files import cannot_write, write_file
from harness.old.store.reading import CRITICAL, MANIFEST
from harness.old.store.shards import encode_shard, shard_name
from harness.old.store.simulations.simulation_traces import only_passages
from harness.old.studies.kinds.table import simulation_of
from harness.old.studies.kinds.tasks import Task, TaskResult
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.shown import MARGIN_S, differences_in, missing_pairs, shown_folders
from harness.old.studies.runs.simulation_choice import Key
from harness.old.studies.runs.views import view_of
from harness.old.studies.workers.execution import run_tasks
from harness.old.studies.workers.pool import LocalPool, default_workers
from harness.results.run import load_run
from harness.scenario import hang_limit_s
from harness.scenario.options import HANG_AFTER_S
from harness.studies.run import resume, run

_WORKERS = 2
"""Number of processes.  The page shows only a few pairs."""


def write_shown(run: RunData, page: Path | None = None) -> str:
    """Write the missing pairs that a page shows into the run folder.

    Args:
        run: a run with at least one finished pair.
        page: the file that shows the pairs; they are written next to it if the run is read-only.

    Returns:
        The reason why pairs are still missing; empty if none is missing.
    """
    try:
        missing = missing_pairs(run, page)
        if not missing:
            return ""
        folders = shown_folders(run.path, page)
        folder = next((each for each in folders if os.access(each.parent, os.W_OK)), folders[0])
        folder.mkdir(exist_ok=True)
        # A pair may kill or hang its process, so it runs in a process of its own.
        tasks = [_task(run, *key) for key in missing]
        pool = LocalPool(min(_WORKERS, default_workers(), len(tasks)))
        try:
            for task, result in run_tasks(pool, tasks, lambda _event, **_details: None):
                tables = _tables(run, (task.cell, task.first_pair), result)
                write_file(folder / shard_name(task.cell, task.first_pair, 1), encode_shard(tables))
        finally:
            pool.stop()
    except OSError as error:
        return f"The traces could not be stored: {cannot_write(folder, error)}."
    except HarnessError as error:
        return f"The run kept no traces, and the episodes could not be simulated again: {error}."
    return ""


def write_shown_risk(folder: Path, page: Path | None = None) -> str:
    """Repeat the likeliest events of a finished risk estimate and keep their traces.

    See ``write_shown`` for the arguments.

    Returns:
        The reason why there are no events to show; empty if there are some.
    """
    if not (folder / CRITICAL).is_file():
        return "No episode of the estimate ended in the event."
    folders = shown_folders(folder, page)
    shown = next((each for each in folders if os.access(each.parent, os.W_OK)), folders[0])
    try:
        if any(map(is_shown, folders)):
            return ""
        if (shown / MANIFEST).is_file():
            resume(shown, workers=_WORKERS)
        else:
            run(str(folder / CRITICAL), traces=True, workers=_WORKERS, out=shown)
    except HarnessError as error:
        return f"The likeliest events could not be simulated again: {error}."
    return ""


def is_shown(folder: Path) -> bool:
    """Return whether a folder holds the finished run of a risk's likeliest events."""
    return (folder / MANIFEST).is_file() and load_run(folder).finished


def traced_pair(
    run: RunData, cell: int, pair: int, arm: Arm
) -> tuple[dict[str, pa.Table], tuple[str, ...] | None]:
    """Return the tables of one arm of a pair, with its traces.

    The pair is simulated again if the run kept no traces.

    Returns:
        The tables, and how the repeated arm differs from its record; None if it was not repeated.

    Raises:
        InputError: the cell or pair does not exist.
        HarnessError: the pair could not be simulated.
    """
    if not 0 <= cell < len(run.study.cells):
        raise InputError("--cell", f"{cell}", f"0 to {len(run.study.cells) - 1}")
    kind = run.kind
    pairs = run.rows_of_cell(cell)["pair"]
    if not pc.is_in(pa.scalar(pair, pairs.type), pairs.combine_chunks()).as_py():
        raise InputError("--pair", f"{pair}", f"0 to {pc.max(pairs).as_py()}")
    names = dict.fromkeys((*kind.records, *kind.shown))
    if run.kept_traces:
        tables = {name: run.rows_of(name, cell, pair) for name in names}
        return {name: _of_arm(table, arm) for name, table in tables.items()}, None
    pool = LocalPool(1)
    try:
        tasks = run_tasks(pool, [_task(run, cell, pair)], lambda _event, **_details: None)
        tables = dict(next(result for _, result in tasks).tables)
    finally:
        pool.stop()
    differences = differences_in(run, (cell, pair), tables, arm)
    return {name: _of_arm(tables[name], arm) for name in names}, differences


def _of_arm(table: pa.Table, arm: Arm) -> pa.Table:
    return table.filter(pc.equal(table["arm"], arm.value))


def _task(run: RunData, cell: int, pair: int) -> Task:
    """Return a task that repeats a stored pair and keeps its traces.

    Raises:
        HarnessError: the network or model is missing or has changed.
    """
    scenario = run.scenario_of(cell)
    simulation_of(scenario).network(scenario)
    return Task(
        cell=cell,
        first_pair=pair,
        count=1,
        scenario=scenario,
        model=run.model_of(cell),
        traces=True,
        hang_after_s=hang_limit_s(HANG_AFTER_S, scenario),
        stack_file=None,
    )


def _tables(run: RunData, key: Key, result: TaskResult) -> dict[str, pa.Table]:
    """Return the tables of a pair.  A long pair keeps only the traces that the page shows."""
    tables = dict(result.tables)
    passages = view_of(run).passages(run, *key)
    if passages is not None and "scenes_over" in tables:
        tables = only_passages(tables, passages)
    stretch = view_of(run).stretch(run, *key)
    if stretch is not None and "traces" in tables:
        begin_s, end_s = stretch
        times = tables["traces"]["time_s"]
        near = pc.and_(
            pc.greater_equal(times, begin_s - MARGIN_S), pc.less_equal(times, end_s + MARGIN_S)
        )
        tables["traces"] = tables["traces"].filter(near)
    return tables
