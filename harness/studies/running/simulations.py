"""Simulates a pair of a task's cells, both arms, in the one SUMO of this process."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path

import pyarrow as pa

from harness.core.errors import EngineError, InputError
from harness.core.vocabulary import Arm, ignore
from harness.encounter.arms import arm_key
from harness.engine.arm_files import check_routes
from harness.engine.installation import scratch_folder
from harness.engine.shared import close_engine
from harness.model.interaction import InteractionModel
from harness.results.rows import simulation_rows
from harness.results.tables import Row, Tables
from harness.scenario import Cell, Scenario, Study
from harness.simulation.arm_tables import ArmTables, run_arm
from harness.simulation.opening import check, opened, opened_traffic
from harness.simulation.setup import Setup
from harness.studies.running.tasks import EpisodeId, Task, TaskRows, Tell

FILES = "sumo"
"""The folder of a run for what SUMO reads and writes, with a folder for each cell and pair."""


def checked_files(study: Study, models: Sequence[InteractionModel]) -> Mapping[str, str]:
    """The hashes of the user's files, after all checks of them, from the model of each cell.

    Raises:
        InputError: the configuration, or a key that does not fit it, is refused.
    """
    files: dict[str, str] = {}
    for cell, model in zip(study.cells, models, strict=True):
        if cell.scenario.traffic is None:
            found = opened(cell.scenario, model)
            check(found)
            now = found.config.digests
            if not now.items() <= files.items():
                check_routes(found.config)
            files |= now
    return files


def simulate_task(
    task: Task, tell: Tell = ignore, window: Mapping[str, str] | None = None
) -> TaskRows:
    """Simulate every arm of a task's pair; those that were given up are recorded as failed.

    An arm that cells share is simulated once.

    Args:
        task: a task of one pair.
        tell: see ``tasks.Tell``.
        window: options of sumo-gui, in whose window it runs; None: without one.
    """
    close_engine()  # a process has one simulation
    (pair,) = task.pairs
    known: dict[str, ArmTables] = {}
    tables: dict[int, Tables] = {}
    events: list[Row] = []

    def outcome_of(cell: Cell, arm: Arm, setup: Callable[[], Setup], arms: Path) -> ArmTables:
        """One arm of the pair; equal arms of several cells are simulated once."""
        episode, key = EpisodeId(cell.number, pair, arm), _arm_key(cell.scenario, arm)
        if (failure := task.given_up.get(episode)) is not None:
            return ArmTables(pair, arm, {}, failure.reason, failure.failed_in)
        if key is not None and key in known:
            return known[key]
        tell(episode, None)
        try:
            outcome = run_arm(
                setup(),
                pair,
                arm,
                arms / (arm if task.outputs is None else ""),
                keeps=task.outputs is not None,
                window=window,
                begins=partial(tell, episode),
            )
        except EngineError as error:  # of a program that writes the pair's files
            outcome = ArmTables(pair, arm, {}, str(error), "engine")
        tell(None, None)
        if key is not None:
            known[key] = outcome
        return outcome

    for cell in task.cells:
        with scratch_folder() as scratch:
            demand, arms = _folders(task, cell.number, Path(scratch))
            setup = cache(partial(_opened, task, cell.scenario, demand))
            outcomes = [outcome_of(cell, arm, setup, arms) for arm in task.arms]
        events += [
            task.failed(cell.number, pair, of.arm, of.reason, of.traceback)
            for of in outcomes
            if of.reason is not None
        ]
        tables[cell.number] = _tables(cell, outcomes)
    return TaskRows(tables, tuple(events))


def _opened(task: Task, scenario: Scenario, folder: Path) -> Setup:
    """The simulation of a pair; files of the user that have changed during a run are refused."""
    if scenario.traffic is not None:
        return opened_traffic(scenario, task.model, task.first, folder)
    found = opened(scenario, task.model)
    for path, digest in found.config.digests.items():
        if task.files.get(path, digest) != digest:
            raise InputError(path, "has changed since the run began", "the same file in all pairs")
    return found


def _folders(task: Task, cell: int, scratch: Path) -> tuple[Path, Path]:
    """The folders of a pair's demand and of its arms: the run's keeps the demand, a replay both."""
    if task.outputs is not None:
        return task.outputs, task.outputs
    if task.folder is None:
        return scratch, scratch
    return task.folder / FILES / f"{cell:04d}-{task.first:08d}", scratch


def _arm_key(scenario: Scenario, arm: Arm) -> str | None:
    """What an arm depends on besides the simulation, as text; see ``arm_key``."""
    alone = arm is Arm.HUMAN or scenario.av_drives_alone
    keys = [arm_key(scenario, driver) for driver in ([arm] if alone else Arm)]
    return None if None in keys else repr((arm, keys))


def _tables(cell: Cell, outcomes: Sequence[ArmTables]) -> Tables:
    """The rows of a cell's pair."""
    tables: dict[str, list[pa.Table]] = {}
    for outcome in outcomes:
        columns = dict(outcome.tables)
        arms = columns.get("arms", {})
        columns["arms"] = {**arms, "reason": [outcome.reason], "failed_in": [outcome.failed_in]}
        rows = simulation_rows(cell.number, outcome.pair, outcome.arm, columns)
        for name, table in rows.items():
            tables.setdefault(name, []).append(table)
    return {name: pa.concat_tables(each) for name, each in tables.items()}
