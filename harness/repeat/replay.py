"""Runs single episodes of a stored run again, in a fresh SUMO with SUMO's own outputs on."""

import shutil
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path

from harness.encounter import Arm
from harness.engine.control import SumoEngine
from harness.engine.installation import check_packages
from harness.engine.process import close_engine
from harness.engine.view import view_settings
from harness.episode.pairing import PairRunner
from harness.errors import HarnessError, InputError
from harness.files import write_file
from harness.interaction import InteractionModel
from harness.network import network_of
from harness.repeat.stored import Row, StoredCell, record_differences
from harness.scenario import Cell, hang_limit_s
from harness.scenario.options import HANG_AFTER_S
from harness.workers.execution import reason_of
from harness.workers.pool import LocalPool
from harness.workers.worker import watchdog

SUMO_FILES = {
    "--fcd-output": "fcd.xml",
    "--tripinfo-output": "tripinfo.xml",
    "--personinfo-output": "personinfo.xml",
    "--collision-output": "collisions.xml",
    "--statistic-output": "statistics.xml",
}

_FURTHER_OPTIONS = {
    "--fcd-output.acceleration": "true",
    "--tripinfo-output.write-unfinished": "true",
    "--precision": "6",
}

_CONFIGURATION = """<configuration>
    <input>
        <net-file value="site.net.xml"/>
    </input>
    <gui_only>
        <gui-settings-file value="view.xml"/>
    </gui_only>
</configuration>
"""

_VIEW_DELAY_MS = 100.0


@dataclass(frozen=True)
class Replayed:
    """One episode run again: its folder, and how its record differs from the stored one.

    ``problem`` says why there is no record; SUMO's files are then cut off.
    """

    arm: Arm
    folder: Path
    differences: tuple[str, ...]
    problem: str | None = None


@dataclass(frozen=True)
class Repetition:
    """A stored episode to be run again in a worker process: all that is needed for it."""

    cell: Cell
    model: InteractionModel
    pair: int
    arm: Arm
    rows: tuple[list[Row], list[Row]]
    folder: Path
    hang_after_s: float

    @property
    def stack_file(self) -> Path:
        """Where a worker that hangs leaves its Python stack."""
        return self.folder / "stack.txt"


def replay(
    run: Path,
    pair: int,
    arms: Sequence[Arm],
    cell: int,
    out: Path,
    hang_after_s: float = HANG_AFTER_S,
) -> list[Replayed]:
    """Run one pair's arms again; each gets a folder with SUMO's outputs.

    Times in SUMO's files are the episode's plus one step: SUMO inserts the ego in its second step.

    Args:
        run: a finished run folder.
        pair: index of the pair.
        arms: which arms; with two, each gets a folder named after it inside ``out``.
        cell: number of the cell.
        out: a new or empty folder.
        hang_after_s: see ``Options``.

    Raises:
        InputError: no such run, cell or pair, or ``out`` is not empty.
    """
    check_packages()
    # An episode may kill its process: that is then not this one.
    pool = LocalPool(len(arms))
    folders: list[Path] = []
    try:
        stored = StoredCell(run, cell)
        stored.check_pair(pair)
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise InputError(f"--out {out}", "is not empty", "a new or empty folder")
        folders = [out / arm.value if len(arms) > 1 else out for arm in arms]
        jobs = [
            repetition(stored, pair, arm, folder, hang_after_s)
            for arm, folder in zip(arms, folders, strict=True)
        ]
        futures = [pool.submit(run_again, job) for job in jobs]
        return [_replayed(job, future) for job, future in zip(jobs, futures, strict=True)]
    except KeyboardInterrupt:
        pool.stop()
        for folder in folders:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    finally:
        pool.stop()


def _replayed(job: Repetition, future: "Future[tuple[str, ...]]") -> Replayed:
    try:
        return Replayed(job.arm, job.folder, future.result())
    except HarnessError as error:
        problem = reason_of(error, job.hang_after_s, job.stack_file)
        return Replayed(job.arm, job.folder, (), problem)


def repetition(
    stored: StoredCell, pair: int, arm: Arm, folder: Path, hang_after_s: float
) -> Repetition:
    """Prepare an episode's folder and all that ``run_again`` needs.

    Raises:
        InputError: the folder cannot be written.
    """
    scenario = stored.cell.scenario
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(network_of(scenario), folder / "site.net.xml")
    except OSError as error:
        why = f"cannot be written ({error.strerror})"
        raise InputError(str(folder), why, "a writable folder") from None
    view = view_settings(scenario.ego.initial_speed_mps, _VIEW_DELAY_MS)
    write_file(folder / "view.xml", view.encode())
    write_file(folder / "episode.sumocfg", _CONFIGURATION.encode())
    limit_s = hang_limit_s(hang_after_s, scenario.experiment)
    rows = stored.rows_of(pair, arm)
    return Repetition(stored.cell, stored.model, pair, arm, rows, folder, limit_s)


def run_again(job: Repetition) -> tuple[str, ...]:
    """Run an episode in a fresh SUMO, in this process; returns how it differs from the record."""
    from harness.engine.sumo import libsumo_engine

    close_engine()
    scenario, folder = job.cell.scenario, job.folder
    outputs = {option: str(folder / name) for option, name in SUMO_FILES.items()}
    opened: list[SumoEngine] = []

    def start(options: dict[str, str]) -> SumoEngine:
        """A fresh SUMO instead of the one before."""
        for engine in opened:
            if not engine.closed:
                engine.close()
        vehicle, crossing = scenario.vehicle(), scenario.crosswalk()
        step_s, net = scenario.experiment.step_s, network_of(scenario)
        opened.append(libsumo_engine(net, vehicle, crossing, step_s, outputs=options))
        return opened[-1]

    with watchdog(job.hang_after_s, job.stack_file) as alive:
        alive()
        try:
            runner = PairRunner(scenario, job.model, lambda: start({**outputs, **_FURTHER_OPTIONS}))
            # Walking speeds of the AV's arm come from SUMO too, whose sums differ from another
            # engine's in the last bits.
            outcome = runner.run_arm(job.pair, job.arm, lambda: start({}))
        finally:
            for engine in opened:
                if not engine.closed:
                    engine.close()
    return tuple(record_differences(outcome, job.cell.number, *job.rows))
