"""A study from scenario to run folder: the way of the data in one page."""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from harness.comparison import CONFIDENCE, Interval, Summary, summarise
from harness.encounter import Ending
from harness.errors import InputError, InterruptedRunError
from harness.execution import Executor, LocalPool, default_workers, run_tasks
from harness.interaction import InteractionModel, load_model
from harness.measure_tables import ConflictRate, conflict_rates, conflict_row, measure_rows
from harness.pairing import check_arms
from harness.place import network_of
from harness.results import SCHEMA, pair_columns, summary_row, versions
from harness.run_folder import RunFolder, claim_folder, read_table, write_csv, write_parquet
from harness.study import Cell, Study, study_from
from harness.worker import Task

TASK_PAIRS = 50
"""Pairs in a task; results do not depend on it."""

HANG_AFTER_S = 120.0
HANG_AFTER_S_PER_STEP = 0.002
"""A worker that finishes no pair for so long, and so long for each of its steps, is ended."""

FIRST_LOOK = 1_000
"""Pairs at the first look of ``--until``; each further look is at twice as many."""

_BOOTSTRAP = 5
"""Keys the resampling apart from the streams of ``seeding``, which begin with the same seed."""

MakeExecutor = Callable[[int], Executor]
Progress = Callable[[int, int], None]
"""(pairs done, pairs planned)."""


@dataclass(frozen=True)
class Precision:
    """``--until``: go on until the half-width of every cell's interval is this small.

    ``measure`` is ``mu`` or ``kappa``.
    """

    measure: str
    half_width: float


@dataclass(frozen=True)
class Options:
    """How a run is carried out; nothing of it changes what one pair gives.

    ``workers`` None means all cores.
    """

    traces: bool = False
    until: Precision | None = None
    workers: int | None = None
    hang_after_s: float = HANG_AFTER_S
    task_pairs: int = TASK_PAIRS


@dataclass(frozen=True)
class Run:
    """A finished run: where it lies and what came out, by cell."""

    folder: Path
    study: Study
    summaries: tuple[Summary, ...]
    conflicts: tuple[tuple[ConflictRate, ...], ...]
    failures: tuple[tuple[int, int, str, str], ...]
    """(cell, pair, arm, reason) of every episode the engine failed in."""


def run_study(
    study: Study,
    options: Options,
    *,
    out: Path | None = None,
    progress: Progress = lambda _done, _planned: None,
    make_executor: MakeExecutor = LocalPool,
) -> Run:
    """Run every cell and write the run folder.

    Args:
        study: what to run.
        options: how.
        out: the folder; default ``runs/<name>-<next free number>``.
        progress: told how far it is.
        make_executor: makes the executor for a number of workers.

    Raises:
        InputError: model, strategies or folder are refused; nothing has been written then.
        HarnessError: the folder cannot be written any more; the run can be resumed.
    """
    models = recall_models(study)
    folder = RunFolder(claim_folder(out, study.name))
    try:
        folder.write_manifest(_manifest(study, models, options, None))
        return _carry_out(folder, study, models, options, progress, make_executor)
    except KeyboardInterrupt:
        raise InterruptedRunError(folder.path) from None
    finally:
        folder.close()


def resume(
    path: Path,
    *,
    workers: int | None = None,
    progress: Progress = lambda _done, _planned: None,
    make_executor: MakeExecutor = LocalPool,
) -> Run:
    """Go on with an interrupted run; a finished one is only read.

    Raises:
        InputError: no run folder, another process works on it, or versions or model differ.
    """
    if not path.is_dir():
        raise InputError(f"--resume {path}", "is no folder", "a run folder")
    folder = RunFolder(path)
    try:
        document = folder.read_manifest()
        study, options = recall_study(document), options_of(document, workers)
        models = recall_models(study)
        _refuse_other_versions(document, _manifest(study, models, options, None))
        if document.get("counts") is not None:
            # Interrupted, if at all, while it cleared up.
            folder.drop_shards()
            return _read_finished(path, study, options)
        folder.note("resumed")
        return _carry_out(folder, study, models, options, progress, make_executor)
    except KeyboardInterrupt:
        raise InterruptedRunError(folder.path) from None
    finally:
        folder.close()


def recall_models(study: Study) -> dict[int, InteractionModel]:
    """The model of every cell, by number; all that a user may have got wrong is found here."""
    loaded: dict[tuple[str, str | None], InteractionModel] = {}
    models = {}
    for cell in study.cells:
        section = cell.scenario.model
        key = (section.name, section.path)
        if key not in loaded:
            loaded[key] = load_model(*key)
        models[cell.number] = loaded[key]
        check_arms(cell.scenario, models[cell.number])
        network_of(cell.scenario)
    return models


def _manifest(
    study: Study,
    models: dict[int, InteractionModel],
    options: Options,
    counts: dict[str, int] | None,
) -> dict[str, Any]:
    """Everything a run depends on; ``counts`` is null until it is finished."""
    until = options.until
    used = {model.name: model.sha256 for model in models.values()}
    return {
        "schema": SCHEMA,
        "name": study.name,
        "scenario": study.base.model_dump(),
        "cells": [cell.varied for cell in study.cells],
        "traces": options.traces,
        "until": None if until is None else {until.measure: until.half_width},
        "seed": study.base.experiment.seed,
        "versions": versions(),
        "models": [{"name": name, "sha256": sha256} for name, sha256 in used.items()],
        "counts": counts,
    }


def recall_study(document: dict[str, Any]) -> Study:
    """The study of a manifest.

    Raises:
        InputError: the manifest is of another format, or damaged.
    """
    try:
        if document["schema"] != SCHEMA:
            raise InputError("manifest.json", f"format version {document['schema']!r}", str(SCHEMA))
        return study_from(document)
    except (KeyError, TypeError, AttributeError, ValueError):
        raise InputError("manifest.json", "is damaged", "a manifest as a run writes it") from None


def options_of(document: dict[str, Any], workers: int | None = None) -> Options:
    """The options of a manifest that decide what a run holds.

    Raises:
        InputError: the manifest is damaged.
    """
    try:
        until = document["until"]
        return Options(
            traces=bool(document["traces"]),
            until=None if until is None else Precision(*next(iter(until.items()))),
            workers=workers,
        )
    except (KeyError, TypeError, AttributeError, StopIteration):
        raise InputError("manifest.json", "is damaged", "a manifest as a run writes it") from None


def _refuse_other_versions(then: dict[str, Any], now: dict[str, Any]) -> None:
    """Half a run under one version and half under another would be neither."""
    versions_then = then.get("versions")
    for name, version in now["versions"].items():
        before = versions_then.get(name) if isinstance(versions_then, dict) else None
        if before != version:
            raise InputError(
                "--resume",
                f"the run was begun with {name} {before}, this is {version}",
                "the same versions",
            )
    if then.get("models") != now["models"]:
        raise InputError("--resume", "the interaction model has changed", "the same model")


def _carry_out(
    folder: RunFolder,
    study: Study,
    models: dict[int, InteractionModel],
    options: Options,
    progress: Progress,
    make_executor: MakeExecutor,
) -> Run:
    work = _Work(folder, study, models, options, progress, make_executor)
    planned = {cell.number: cell.scenario.experiment.pairs for cell in study.cells}
    if options.until is None:
        work.reach(planned)
    else:
        _reach_precision(work, study, planned, options.until)
    folder.note("simulated")
    return finish(folder, study, models, options)


class _Work:
    """Brings cells to a number of pairs, skipping what is done."""

    def __init__(
        self,
        folder: RunFolder,
        study: Study,
        models: dict[int, InteractionModel],
        options: Options,
        progress: Progress,
        make_executor: MakeExecutor,
    ) -> None:
        self.folder, self.study, self.models = folder, study, models
        self.options, self.progress, self.make_executor = options, progress, make_executor
        self.done = folder.done_pairs()

    def reach(self, goals: dict[int, int]) -> None:
        """Run what is missing up to ``goals`` pairs of each cell."""
        tasks = list(self._missing(goals))
        if not tasks:
            return
        workers = min(self.options.workers or default_workers(), len(tasks))
        begin, open_pairs = time.perf_counter(), sum(task.count for task in tasks)
        total = sum(goals.values())
        finished = total - open_pairs
        self.folder.note("started", pairs=open_pairs, workers=workers)
        executor = self.make_executor(workers)
        try:
            for task, result in run_tasks(executor, iter(tasks), self.folder.note):
                self.folder.write_shard(task.cell, task.first_pair, task.count, result.rows)
                for failure in result.failures:
                    self.folder.note("episode failed", **failure)
                pairs = range(task.first_pair, task.first_pair + task.count)
                self.done.setdefault(task.cell, set()).update(pairs)
                finished += task.count
                self.progress(finished, total)
        finally:
            executor.stop()
        rate = open_pairs / (time.perf_counter() - begin)
        self.folder.note("reached", pairs=total, pairs_per_s=round(rate, 1))

    def _missing(self, goals: dict[int, int]) -> Iterator[Task]:
        for cell in self.study.cells:
            done = self.done.get(cell.number, set())
            missing = [pair for pair in range(goals[cell.number]) if pair not in done]
            begin = 0
            while begin < len(missing):
                end = begin + 1
                while (
                    end < len(missing)
                    and missing[end] == missing[end - 1] + 1
                    and end - begin < self.options.task_pairs
                ):
                    end += 1
                yield self._task(cell, missing[begin], end - begin)
                begin = end

    def _task(self, cell: Cell, first: int, count: int) -> Task:
        steps = cell.scenario.experiment.timeout_s / cell.scenario.experiment.step_s
        return Task(
            cell=cell.number,
            first_pair=first,
            count=count,
            scenario=cell.scenario,
            model=self.models[cell.number],
            traces=self.options.traces,
            hang_after_s=self.options.hang_after_s + 2 * steps * HANG_AFTER_S_PER_STEP,
            stack_file=self.folder.stack_file(f"{cell.number}-{first}-{count}"),
        )


def looks(pairs: int) -> list[int]:
    """Numbers of pairs at which ``--until`` looks: 1,000, 2,000, 4,000 … and at last ``pairs``."""
    numbers = []
    look = FIRST_LOOK
    while look < pairs:
        numbers.append(look)
        look *= 2
    return [*numbers, pairs]


def confidence_of(study: Study, options: Options) -> float:
    """Confidence of each interval.

    Looking L times and stopping at the best moment would spoil a 95 % interval, so with
    ``--until`` each look uses 1 − 0.05/L (Bonferroni): all of them together hold with 95 %.
    """
    if options.until is None:
        return CONFIDENCE
    most = max(cell.scenario.experiment.pairs for cell in study.cells)
    return 1 - (1 - CONFIDENCE) / len(looks(most))


def _reach_precision(work: _Work, study: Study, planned: dict[int, int], until: Precision) -> None:
    """Go on until every cell's interval is narrow enough, or all its pairs are done."""
    most = looks(max(planned.values()))
    confidence = confidence_of(study, work.options)
    goals = dict.fromkeys(planned, 0)
    open_cells = list(study.cells)
    for look in most:
        for cell in open_cells:
            goals[cell.number] = min(look, planned[cell.number])
        work.reach(goals)
        open_cells = [
            cell
            for cell in open_cells
            if goals[cell.number] < planned[cell.number]
            and not _narrow(work.folder, cell, until, confidence)
        ]
        if not open_cells:
            return


def _narrow(folder: RunFolder, cell: Cell, until: Precision, confidence: float) -> bool:
    summary = summarise_cell(folder.episodes_of(cell.number), cell, confidence)
    interval: Interval = getattr(summary, until.measure)
    if interval.low is None or interval.high is None:
        return False
    return (interval.high - interval.low) / 2 <= until.half_width


def summarise_cell(episodes: pa.Table, cell: Cell, confidence: float) -> Summary:
    """What is reported of a cell, from its episodes by pair.

    The resampling's stream is the scenario's alone: the same episodes give the same intervals.
    """
    experiment = cell.scenario.experiment
    rng = np.random.default_rng((experiment.seed, _BOOTSTRAP))
    return summarise(pair_columns(episodes), experiment.timeout_s, rng, confidence)


def finish(
    folder: RunFolder, study: Study, models: dict[int, InteractionModel], options: Options
) -> Run:
    """Turn a folder's shards into tables, summary and, last of all, the manifest with counts."""
    confidence = confidence_of(study, options)
    folder.finish_tables(options.traces)
    write_parquet(folder.path / "cells.parquet", *_cells_table(study))
    summaries, conflicts, failures = [], [], []
    tables: dict[str, list[dict[str, Any]]] = {"summary": [], "measures": [], "conflicts": []}
    counts = {"pairs": 0, "episodes": 0, **{ending.value: 0 for ending in Ending}}
    for cell in study.cells:
        episodes = folder.episodes_of(cell.number)
        summary = summarise_cell(episodes, cell, confidence)
        rates = conflict_rates(episodes, cell.scenario.conflicts, confidence)
        summaries.append(summary)
        conflicts.append(rates)
        which = {"cell": cell.number, **cell.varied}
        tables["summary"].append({**cell.varied, **summary_row(summary)})
        tables["measures"] += [which | row for row in measure_rows(episodes)]
        tables["conflicts"] += [which | conflict_row(rate) for rate in rates]
        counts["pairs"] += summary.pairs
        counts["episodes"] += episodes.num_rows
        endings = episodes["ending"].to_pylist()
        for ending in Ending:
            counts[ending.value] += endings.count(ending.value)
        failures += _failures(episodes, cell.number)
    for name, rows in tables.items():
        write_csv(folder.path / f"{name}.csv", rows)
    folder.write_manifest(_manifest(study, models, options, counts))
    folder.drop_shards()
    folder.note("finished")
    return Run(folder.path, study, tuple(summaries), tuple(conflicts), tuple(failures))


def _read_finished(path: Path, study: Study, options: Options) -> Run:
    """What a run folder with all its tables says."""
    confidence = confidence_of(study, options)
    summaries, conflicts, failures = [], [], []
    for cell in study.cells:
        episodes = read_table(path, "episodes", cell.number)
        summaries.append(summarise_cell(episodes, cell, confidence))
        conflicts.append(conflict_rates(episodes, cell.scenario.conflicts, confidence))
        failures += _failures(episodes, cell.number)
    return Run(path, study, tuple(summaries), tuple(conflicts), tuple(failures))


def _failures(episodes: pa.Table, cell: int) -> list[tuple[int, int, str, str]]:
    columns = (episodes[name].to_pylist() for name in ("ending", "pair", "arm", "reason"))
    return [
        (cell, pair, arm, reason or "")
        for ending, pair, arm, reason in zip(*columns, strict=True)
        if ending == Ending.ENGINE_FAILED
    ]


def _cells_table(study: Study) -> tuple[pa.Schema, Iterator[pa.Table]]:
    """``cells.parquet``: number and varied keys; mixed types of a key become text."""
    columns: dict[str, pa.Array] = {
        "cell": pa.array([cell.number for cell in study.cells], type=pa.int32())
    }
    for key in study.varied_keys:
        values = [cell.varied[key] for cell in study.cells]
        if any(isinstance(value, float) and math.isfinite(value) for value in values) and all(
            isinstance(value, int | float) and not isinstance(value, bool) for value in values
        ):
            values = [float(value) for value in values]
        try:
            columns[key] = pa.array(values)
        except (pa.ArrowInvalid, pa.ArrowTypeError):
            columns[key] = pa.array([None if value is None else str(value) for value in values])
    table = pa.table(columns)
    return table.schema, iter([table])
