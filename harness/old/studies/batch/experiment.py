"""Carries out a study from scenario to run folder: start, resume and finish."""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from harness.core.errors import HarnessError, InputError, InterruptedRunError, resume_command
from harness.engine.installation import check_packages
from harness.old.store.manifest import refuse_other_versions
from harness.old.store.reading import MANIFEST, read_manifest
from harness.old.store.run_folder import RunFolder, claim_folder
from harness.old.studies.batch.finish import finish
from harness.old.studies.batch.plan import Plan, plan_of, recall_plan
from harness.old.studies.kinds.tasks import Task
from harness.old.studies.runs.opening import load_run
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.workers.execution import run_tasks
from harness.old.studies.workers.executor import Executor, ExecutorLostError
from harness.old.studies.workers.executors import executor_for
from harness.old.studies.workers.pool import workers_for
from harness.scenario import Cell, Options, Study, hang_limit_s

_OPTIONS = Options()

MakeExecutor = Callable[[int], Executor]
Progress = Callable[[int, int, str], None]
"""Receives the number of finished pairs, the number of planned pairs, and the unit."""


def run_study(
    study: Study,
    options: Options = _OPTIONS,
    *,
    out: Path | str | None = None,
    progress: Progress = lambda _done, _planned, _what: None,
    make_executor: MakeExecutor | None = None,
) -> RunData:
    """Run every cell and write the run folder.

    Args:
        study: the cells to run.
        options: options of the run.
        out: the folder; default ``runs/<name>-<next free number>``.
        progress: see ``Progress``.
        make_executor: makes the executor for a number of workers.  None means local processes, or
            this process if ``options.workers`` is 0 or a strategy is a class of this script
            or notebook.

    Raises:
        InputError: SUMO, model, strategies or folder are refused; nothing has been written.
        HarnessError: the folder can no longer be written; the run can be resumed.
        KeyboardInterrupt: Ctrl-C; finished work is kept, and the message says how to continue.
    """
    check_packages()
    plan = plan_of(study, options)
    folder = RunFolder(claim_folder(out, study.name))
    with _held(folder):
        folder.drop_shards()
        folder.write_manifest(plan.manifest())
        return _carry_out(folder, plan, progress, make_executor)


def resume(
    path: Path | str,
    *,
    workers: int | None = None,
    progress: Progress = lambda _done, _planned, _what: None,
    make_executor: MakeExecutor | None = None,
) -> RunData:
    """Continue an interrupted run.  A finished run is only read.

    Raises:
        InputError: the folder is not a run folder, another process uses it, or versions or the
            model differ.
    """
    path = Path(path)
    if not path.is_dir():
        raise InputError(str(path), "is no folder", "a run folder")
    check_packages()
    folder = RunFolder(path)
    with _held(folder):
        document = read_manifest(path)
        if document["counts"] is not None:
            # An interruption may have left shards behind.
            folder.drop_shards()
            return load_run(path)
        plan = recall_plan(document, workers)
        refuse_other_versions(document["simulated_with"], plan.origin["simulated_with"])
        folder.note("resumed")
        return _carry_out(folder, plan, progress, make_executor)


@contextmanager
def _held(folder: RunFolder) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        if not (folder.path / MANIFEST).is_file():
            raise  # there is nothing to resume
        raise InterruptedRunError(folder.path) from None
    except ExecutorLostError as error:
        advice = f"finished work is kept: {resume_command(folder.path)}"
        raise HarnessError(f"{error}; {advice}") from None
    finally:
        folder.close()


def _carry_out(
    folder: RunFolder, plan: Plan, progress: Progress, make_executor: MakeExecutor | None
) -> RunData:
    work = _Work(folder, plan, progress, make_executor)
    try:
        work.run()
    finally:
        work.stop()
    folder.note("simulated")
    return finish(folder, plan)


class _Work:
    """Runs the pairs of all cells and skips finished pairs."""

    def __init__(
        self,
        folder: RunFolder,
        plan: Plan,
        progress: Progress,
        make_executor: MakeExecutor | None,
    ) -> None:
        self.folder, self.plan, self.progress = folder, plan, progress
        self.make_executor = make_executor or (
            lambda _workers: executor_for(plan.study, plan.options)
        )
        self.executor: Executor | None = None

    def run(self) -> None:
        """Run the missing pairs of each cell."""
        planned = self.plan.planned
        done_pairs = self.folder.done_pairs(planned, self.plan.shard_tables)
        missing = {
            cell: [pair for pair in range(count) if pair not in done_pairs.get(cell, ())]
            for cell, count in planned.items()
        }
        total, left = sum(planned.values()), sum(map(len, missing.values()))
        if not left:
            return
        begin, done = time.perf_counter(), total - left
        executor = self.executor = self.make_executor(workers_for(total, self.plan.options))
        self.folder.note("started", pairs=left, workers=executor.workers)
        for task, result in run_tasks(executor, self._tasks(missing), self.folder.note):
            self.folder.write_shard(task.cell, task.first_pair, task.count, result.tables)
            for failure in result.failures:
                self.folder.note("episode failed", **failure)
            done += task.count
            self.progress(done, total, "pairs")
        rate = left / (time.perf_counter() - begin)
        self.folder.note("reached", pairs=total, pairs_per_s=round(rate, 1))

    def stop(self) -> None:
        """Stop the executor if it exists."""
        if self.executor is not None:
            self.executor.stop()

    def _tasks(self, missing: dict[int, list[int]]) -> Iterator[Task]:
        """Yield a task for each pair, with its twins."""
        for cells in self._twins(missing):
            for pair in missing[cells[0].number]:
                first, *others = (self._task(cell, pair, 1) for cell in cells)
                yield replace(first, twins=tuple(others))

    def _twins(self, missing: dict[int, list[int]]) -> Iterable[list[Cell]]:
        """Group cells that share episodes and lack the same pairs.

        They differ only in their reference, and no reference drives in the AV's arm.
        """
        groups: dict[object, list[Cell]] = {}
        for cell in self.plan.study.cells:
            if pairs := missing.get(cell.number):
                alone = cell.scenario.av_drives_alone
                same = (cell.but_for_arms, cell.scenario.arms.av) if alone else cell.number
                groups.setdefault((same, tuple(pairs)), []).append(cell)
        return groups.values()

    def _task(self, cell: Cell, first: int, count: int) -> Task:
        options = self.plan.options
        return Task(
            cell=cell.number,
            first_pair=first,
            count=count,
            scenario=cell.scenario,
            model=self.plan.models[cell.number],
            traces=options.traces,
            hang_after_s=hang_limit_s(options.hang_after_s, cell.scenario),
            stack_file=self.folder.stack_file(f"{cell.number}-{first}-{count}"),
            outputs=self.folder.outputs_of(cell.scenario),
        )
