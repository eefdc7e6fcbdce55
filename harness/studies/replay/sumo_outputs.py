"""Takes a finished run and writes SUMO's own outputs of its episodes (``--sumo-outputs``).

Each selected episode, or arm of an hour, runs again in its own SUMO and writes into
``RUN/sumo/CELL-PAIR-ARM/``.  A folder is either complete or missing, so after an interruption only
the missing ones are written.
"""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from harness.core.encounter import Arm, Ending
from harness.core.errors import HarnessError
from harness.scenario import Options, Study
from harness.store.reading import read_table
from harness.store.run_folder import SUMO_OUTPUTS, RunFolder
from harness.studies.replay.rerun import Repetition, repetition, run_again
from harness.studies.replay.stored import StoredCell
from harness.studies.workers.execution import ATTEMPTS, call_each, reason_of
from harness.studies.workers.pool import LocalPool, default_workers
from harness.studies.workers.tasks import ExecutorLostError, Failure


def write_outputs(
    folder: RunFolder, study: Study, options: Options, progress: Callable[[int, int], None]
) -> tuple[Failure, ...]:
    """Write the selected outputs that are missing.

    Args:
        folder: folder of a run with finished tables.
        study: the study of the run.
        options: options of the run; ``sumo_outputs`` selects episodes.
        progress: called with the numbers of done and planned episodes.

    Returns:
        Every episode without outputs after two attempts, or with a different record.
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
                folder.note("SUMO outputs failed", episode=_name(job), reason=reason)
                tries[job.folder] = tries.get(job.folder, 0) + 1
                if tries[job.folder] < ATTEMPTS:
                    retries.append(job)
                    continue
            else:
                job.folder.replace(_place(folder.path, job.cell.number, job.pair, job.arm))
                reason = "; ".join(differences)
            if reason:
                failures.append((job.cell.number, job.pair, job.arm.value, reason))
            left -= 1
            progress(total - left, total)
    finally:
        pool.stop()
    return tuple(failures)


def _selected(run: Path, study: Study, whose: str | None) -> dict[int, list[tuple[int, Arm]]]:
    """Pair and arm of every selected episode, by cell.

    Failed episodes are never selected, because SUMO completes its files only at a regular end.
    """
    ran = _hours_that_ran if study.in_traffic else _episodes_that_ran
    return {cell.number: list(ran(run, cell.number, whose)) for cell in study.cells}


def _episodes_that_ran(run: Path, cell: int, whose: str | None) -> Iterator[tuple[int, Arm]]:
    endings = {Ending.CRASHED} if whose == "crashed" else set(Ending) - {Ending.ENGINE_FAILED}
    episodes = read_table(run, "episodes", cell)
    columns = (episodes[name].to_pylist() for name in ("pair", "arm", "ending"))
    for pair, arm, ending in zip(*columns, strict=True):
        if ending in endings:
            yield pair, Arm(arm)


def _hours_that_ran(run: Path, cell: int, whose: str | None) -> Iterator[tuple[int, Arm]]:
    """Pair and arm of every selected hour: those with a crash, or all."""
    hours = read_table(run, "hours", cell)
    columns = (hours[name].to_pylist() for name in ("pair", "arm", "reason", "crashes"))
    for pair, arm, reason, crashes in zip(*columns, strict=True):
        if reason is None and (whose != "crashed" or crashes > 0):
            yield pair, Arm(arm)


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


def _name(job: Repetition) -> str:
    return f"{job.cell.number}-{job.pair}-{job.arm.value}"
