"""Repeats episodes of a stored run, each in a new SUMO that writes its own outputs."""

import shutil
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from harness.core.encounter import Arm
from harness.core.errors import HarnessError, InputError
from harness.engine.installation import check_packages
from harness.engine.shared import close_engine
from harness.old.studies.kinds.simulation import ArmOfPair
from harness.old.studies.kinds.table import simulation_of
from harness.old.studies.kinds.watchdog import watchdog
from harness.old.studies.runs.stored import Rows, StoredCell, record_differences
from harness.old.studies.workers.execution import reason_of
from harness.old.studies.workers.pool import LocalPool
from harness.scenario import hang_limit_s
from harness.scenario.options import HANG_AFTER_S


@dataclass(frozen=True)
class Replayed:
    """A repeated episode or hour: its folder, and how its record differs from the stored record.

    ``problem`` is the reason why there is no record; SUMO's files are then incomplete.
    ``traceback`` is the traceback of a strategy that raised an exception.
    """

    arm: Arm
    folder: Path
    differences: tuple[str, ...]
    problem: str | None = None
    traceback: str | None = None


class Repeated(NamedTuple):
    """How a repeated episode differs from its record, and the traceback of its strategy."""

    differences: tuple[str, ...]
    traceback: str | None


@dataclass(frozen=True)
class Repetition:
    """The input of a worker that repeats a stored arm of a pair."""

    arm: ArmOfPair
    rows: Rows
    folder: Path
    hang_after_s: float

    @property
    def stack_file(self) -> Path:
        """The file for the Python stack of a worker that hangs."""
        return self.folder / "stack.txt"


def replay(
    run: Path,
    pair: int,
    arms: Sequence[Arm],
    cell: int,
    out: Path,
    hang_after_s: float = HANG_AFTER_S,
) -> list[Replayed]:
    """Run the arms of a pair again; each arm gets a folder with SUMO's outputs.

    Times in SUMO's files are one step later than in the episode, because SUMO inserts the ego in
    its second step.  Times of an hour count from the beginning of the warm-up.

    Args:
        run: a finished run folder.
        pair: index of the pair.
        arms: the arms; with two arms, each gets a folder with its name inside ``out``.
        cell: number of the cell.
        out: a new or empty folder.
        hang_after_s: see ``Options``.

    Raises:
        InputError: the run, cell or pair does not exist, or ``out`` is not empty.
    """
    check_packages()
    # An episode may kill its process, so each runs in another process.
    pool = LocalPool(len(arms))
    folders: list[Path] = []
    try:
        stored = StoredCell(run, cell, pair)
        refuse_in_use(out, "--out")
        folders = [out / arm.value if len(arms) > 1 else out for arm in arms]
        jobs = [
            repetition(stored, pair, arm, folder, hang_after_s)
            for arm, folder in zip(arms, folders, strict=True)
        ]
        futures = [pool.submit(run_again, job) for job in jobs]
        return [_replayed(stored, job, future) for job, future in zip(jobs, futures, strict=True)]
    except KeyboardInterrupt:
        pool.stop()
        for folder in folders:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    finally:
        pool.stop()


def debug(run: Path, pair: int, arms: Sequence[Arm], cell: int = 0) -> dict[Arm, Repeated]:
    """Run the arms of a pair again in this process, so that ``breakpoint()`` works in a strategy.

    Standard input is that of this process, and there is no time limit.

    Args:
        run: a finished run folder.
        pair: index of the pair.
        arms: the arms.
        cell: number of the cell.

    Raises:
        InputError: the run, cell or pair does not exist.
    """
    check_packages()
    stored = StoredCell(run, cell, pair)
    simulation, repeated = simulation_of(stored.cell.scenario), {}
    try:
        for arm in arms:
            again = stored.arm(pair, arm)
            rows = simulation.in_this_process(again)
            repeated[arm] = Repeated(stored.differences(again, rows), rows.traceback)
    finally:
        close_engine()
    return repeated


def refuse_in_use(folder: Path, option: str) -> None:
    """Raise if a folder for new files is a file or is not empty."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{option} {folder}", "is not empty", "a new or empty folder")


def _replayed(stored: StoredCell, job: Repetition, future: "Future[Repeated]") -> Replayed:
    try:
        differences, traceback = future.result()
        return Replayed(job.arm.arm, job.folder, stored.explained(differences), traceback=traceback)
    except HarnessError as error:
        problem = reason_of(error, job.hang_after_s, job.stack_file)
        return Replayed(job.arm.arm, job.folder, (), problem)


def repetition(
    stored: StoredCell, pair: int, arm: Arm, folder: Path, hang_after_s: float
) -> Repetition:
    """Make an episode's folder and return the input of ``run_again``.

    Raises:
        InputError: the folder cannot be written.
    """
    scenario = stored.cell.scenario
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(simulation_of(scenario).network(scenario), folder / "site.net.xml")
    except OSError as error:
        why = f"cannot be written ({error.strerror})"
        raise InputError(str(folder), why, "a writable folder") from None
    limit_s = hang_limit_s(hang_after_s, scenario)
    rows = stored.rows_of(pair, arm)
    return Repetition(stored.arm(pair, arm), rows, folder, limit_s)


def run_again(job: Repetition) -> Repeated:
    """Run an arm of a pair in a new SUMO in this process."""
    close_engine()
    with watchdog(job.hang_after_s, job.stack_file):
        rows = simulation_of(job.arm.scenario).with_outputs(job.arm, job.folder)
    differences = record_differences(rows.tables, job.rows)
    return Repeated(tuple(differences), rows.traceback)
