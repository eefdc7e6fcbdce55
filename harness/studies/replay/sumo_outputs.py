"""Writes SUMO's own outputs for episodes of a finished run (``--sumo-outputs``).

Each selected episode, or arm of an hour, runs again in its own SUMO and writes into
``RUN/sumo/CELL-PAIR-ARM/``.  A folder is either complete or missing, so after an interruption only
missing folders are written.
"""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from harness.core.encounter import Arm
from harness.core.errors import HarnessError
from harness.scenario import Options, Study
from harness.store.kinds import kind_of_study
from harness.store.reading import read_table
from harness.store.run_folder import SUMO_OUTPUTS, RunFolder
from harness.studies.kinds.tasks import Failure
from harness.studies.replay.rerun import Repetition, repetition, run_again
from harness.studies.runs.stored import StoredCell
from harness.studies.workers.execution import ATTEMPTS, call_each, reason_of
from harness.studies.workers.executor import ExecutorLostError
from harness.studies.workers.pool import LocalPool, default_workers


def write_outputs(
    folder: RunFolder, study: Study, options: Options, progress: Callable[[int, int], None]
) -> tuple[Failure, ...]:
    """Write the missing outputs of the selected episodes.

    Args:
        folder: folder of a run with finished tables.
        study: the study of the run.
        options: options of the run; ``sumo_outputs`` selects episodes.
        progress: called with the numbers of done and planned episodes.

    Returns:
        Every episode that has no outputs after two attempts or whose record differs.
    """
    selected = _selected(folder.path, study, options.sumo_outputs)
    missing = {
        cell: [key for key in keys if not _place(folder.path, cell, *key).is_dir()]
        for cell, keys in selected.items()
    }
    total, left = sum(map(len, selected.values())), sum(map(len, missing.values()))
    if not left:
        return ()
    folder.note("SUMO outputs", episodes=left)
    failures, tries = [], dict[Path, int]()
    retries: list[Repetition] = []
    waiting = _repetitions(folder.path, missing, options.hang_after_s)

    def take() -> Repetition | None:
        return retries.pop() if retries else next(waiting, None)

    pool = LocalPool(min(options.workers or default_workers(), left))
    try:
        for job, future in call_each(pool, run_again, take):
            try:
                differences = future.result().differences
            except ExecutorLostError:
                raise
            except HarnessError as error:
                reason = reason_of(error, job.hang_after_s, job.stack_file)
                folder.note("SUMO outputs failed", episode=job.arm.name, reason=reason)
                tries[job.folder] = tries.get(job.folder, 0) + 1
                if tries[job.folder] < ATTEMPTS:
                    retries.append(job)
                    continue
            else:
                job.folder.replace(job.folder.with_name(job.arm.name))
                reason = "; ".join(differences)
            if reason:
                arm = job.arm
                failures.append((arm.cell.number, arm.pair, arm.arm.value, reason))
            left -= 1
            progress(total - left, total)
    finally:
        pool.stop()
    return tuple(failures)


def _selected(run: Path, study: Study, whose: str | None) -> dict[int, list[tuple[int, Arm]]]:
    """Return pair and arm of every selected episode, by cell.

    Failed episodes are never selected, because SUMO completes its files only at a regular end.
    """
    kind, selected = kind_of_study(study), {}
    for cell in study.cells:
        ran = kind.ran(read_table(run, kind.rows, cell.number), crashed=whose == "crashed")
        pairs, arms = (ran[name].to_pylist() for name in ("pair", "arm"))
        selected[cell.number] = [*zip(pairs, map(Arm, arms), strict=True)]
    return selected


def _repetitions(
    run: Path, missing: dict[int, list[tuple[int, Arm]]], hang_after_s: float
) -> Iterator[Repetition]:
    for cell, episodes in missing.items():
        if not episodes:
            continue
        stored = StoredCell(run, cell)
        for pair, arm in episodes:
            place = _place(run, cell, pair, arm)
            partial = place.with_name(f".{place.name}.partial")
            # An interrupted attempt may have left this folder.
            shutil.rmtree(partial, ignore_errors=True)
            yield repetition(stored, pair, arm, partial, hang_after_s)


def _place(run: Path, cell: int, pair: int, arm: Arm) -> Path:
    return run / SUMO_OUTPUTS / f"{cell}-{pair}-{arm.value}"
