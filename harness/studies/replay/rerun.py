"""Takes episodes of a stored run and runs each again in a new SUMO that writes its own outputs."""

import math
import os
import shutil
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from harness.core.encounter import Arm, Crossing
from harness.core.errors import HarnessError, InputError
from harness.engine.control import SumoEngine
from harness.engine.installation import check_packages
from harness.engine.network import network_of, place_of
from harness.engine.road import SumoRoad
from harness.engine.shared import close_engine, engine_for, following_of, road_for
from harness.episode.pairing import PairRunner
from harness.episode.traffic.pairing import HourOutcome, HourRunner
from harness.measures import Outcome
from harness.model.interaction import InteractionModel
from harness.scenario import Cell, EngineName, Scenario, hang_limit_s
from harness.scenario.options import HANG_AFTER_S
from harness.studies.replay.stored import Rows, StoredCell, record_differences, run_arm
from harness.studies.workers.execution import reason_of
from harness.studies.workers.pool import LocalPool
from harness.studies.workers.watchdog import watchdog

SUMO_FILES = {
    "--fcd-output": "fcd.xml",
    "--tripinfo-output": "tripinfo.xml",
    "--collision-output": "collisions.xml",
}

HOUR_FILES = SUMO_FILES | {"--queue-output": "queues.xml"}
"""SUMO's files of an hour of traffic, beside ``DETECTORS``."""

DETECTORS = "e2.xml"

_FURTHER_OPTIONS = {
    "--fcd-output.acceleration": "true",
    "--tripinfo-output.write-unfinished": "true",
    "--precision": "6",
    # The harness moves the pedestrians, so SUMO's trips of persons are meaningless.
    "--personinfo-output": os.devnull,
}

_HOUR_PERIOD_S = "1"
"""Period of positions and queues of an hour in s; files with every step would be too large."""


@dataclass(frozen=True)
class Replayed:
    """One repeated episode or hour: its folder, and how its record differs from the stored record.

    ``problem`` is the reason if there is no record; SUMO's files are then incomplete.
    ``traceback`` is the strategy's traceback if it raised an exception.
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
    """The input of a worker that repeats a stored episode or arm of an hour."""

    cell: Cell
    model: InteractionModel
    pair: int
    arm: Arm
    rows: Rows
    engine: EngineName
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
    # Episodes run in other processes, because an episode may kill its process.
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
    scenario = stored.cell.scenario
    runner: PairRunner | HourRunner
    if stored.in_traffic:
        runner = HourRunner(scenario, stored.model, lambda: road_for(scenario))
    else:
        runner = PairRunner(scenario, stored.model, lambda: engine_for(scenario))
    try:
        outcomes = {arm: runner.run_arm(pair, arm) for arm in arms}
    finally:
        close_engine()
    return {
        arm: Repeated(stored.differences(outcome), _traceback_of(outcome))
        for arm, outcome in outcomes.items()
    }


def refuse_in_use(folder: Path, option: str) -> None:
    """Raise if a folder for new files is a file or is not empty."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{option} {folder}", "is not empty", "a new or empty folder")


def _traceback_of(outcome: Outcome | HourOutcome) -> str | None:
    return outcome.traceback if isinstance(outcome, HourOutcome) else outcome.trace.traceback


def _replayed(stored: StoredCell, job: Repetition, future: "Future[Repeated]") -> Replayed:
    try:
        differences, traceback = future.result()
        return Replayed(job.arm, job.folder, stored.explained(differences), traceback=traceback)
    except HarnessError as error:
        problem = reason_of(error, job.hang_after_s, job.stack_file)
        return Replayed(job.arm, job.folder, (), problem)


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
        shutil.copyfile(network_of(scenario), folder / "site.net.xml")
    except OSError as error:
        why = f"cannot be written ({error.strerror})"
        raise InputError(str(folder), why, "a writable folder") from None
    limit_s = hang_limit_s(hang_after_s, scenario)
    rows = stored.rows_of(pair, arm)
    return Repetition(stored.cell, stored.model, pair, arm, rows, stored.engine, folder, limit_s)


def run_again(job: Repetition) -> Repeated:
    """Run an episode, or one arm of an hour, in a new SUMO in this process."""
    from harness.engine.sumo import libsumo_engine, libsumo_road

    close_engine()
    scenario = job.cell.scenario
    place = place_of(scenario), scenario.vehicle(), _with_speed_limit(scenario)
    step_s = scenario.experiment.step_s
    hours = scenario.traffic is not None
    limit_s = math.inf if hours else scenario.experiment.decide_limit_s
    with watchdog(job.hang_after_s, job.stack_file, limit_s) as watch:
        engine: SumoEngine | SumoRoad
        if hours:
            period = dict.fromkeys(("--device.fcd.period", "--queue-output.period"), _HOUR_PERIOD_S)
            outputs = {**_files(HOUR_FILES, job.folder), **_FURTHER_OPTIONS, **period}
            detectors = job.folder / DETECTORS
            following = following_of(scenario)
            engine = libsumo_road(*place, step_s, following, outputs=outputs, detectors=detectors)
        else:
            outputs = {**_files(SUMO_FILES, job.folder), **_FURTHER_OPTIONS}
            engine = libsumo_engine(*place, step_s, outputs=outputs)
        outcome = run_arm(scenario, job.model, engine, job.pair, job.arm, watch.begins)
    differences = record_differences(outcome, job.cell.number, job.rows, job.engine)
    return Repeated(tuple(differences), _traceback_of(outcome))


def _files(names: Mapping[str, str], folder: Path) -> dict[str, str]:
    return {option: str(folder / name) for option, name in names.items()}


def _with_speed_limit(scenario: Scenario) -> Crossing:
    """Return the crosswalk on a road with a speed limit, which SUMO's time loss refers to.

    Without a limit in the scenario the limit is v0, as for the delay of the harness.  SUMO's own
    driver would obey this limit, so with that driver the road keeps the limit of the run.
    """
    crossing = scenario.crosswalk()
    arms = (scenario.arms.av, scenario.arms.human)
    if crossing.speed_limit_mps is not None or "sumo_driver" in arms:
        return crossing
    return replace(crossing, speed_limit_mps=scenario.ego.initial_speed_mps)
