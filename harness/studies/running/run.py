"""Runs a study into a folder of parts, and resumes it."""

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

from harness.core.errors import (
    HarnessError,
    InputError,
    InterruptedRunError,
    Parameter,
    advised,
    checked,
    in_one_line,
    reading,
    refused_at,
)
from harness.core.files import shipped_directory
from harness.core.freezing import frozen
from harness.core.vocabulary import Progress, ignore
from harness.encounter.arms import asks_model, check_arms
from harness.engine.installation import check_packages
from harness.model.interaction import InteractionModel, load_model
from harness.results import folder as folders
from harness.results.loaded_run import Run, computed, load_run
from harness.results.tables import TABLES_OF, TRACES, RunKind
from harness.scenario import EngineName, Scenario
from harness.scenario.file import ScenarioFile, Settings, as_settings, read_scenario_file
from harness.scenario.study import Study, study_from, study_of
from harness.studies.running import claimed_folder
from harness.studies.running.claimed_folder import RunFolder
from harness.studies.running.tasks import Task, TaskRows, part_pairs, tasks_of
from harness.studies.running.workers import Limited, executor_for, submitted

_AT_ONCE = 300
"""Tasks at a time of an executor of the caller's."""

Part = tuple[int, int]
"""Cell and first pair."""


@checked
def run(
    scenario: Scenario | Study | str | Path,
    *,
    settings: Mapping[str, Any] | None = None,
    vary: Mapping[str, Sequence[Any]] | None = None,
    pairs: int | None = None,
    seed: int | None = None,
    out: Path | str | None = None,
    traces: bool = False,
    workers: int | None = None,
    engine: EngineName = "sumo",
    executor: Executor | None = None,
    progress: Progress = ignore,
) -> Run:
    """Run every pair of every cell with both drivers, and write the run folder.

    Args:
        scenario: a scenario, a study, a file, the name of a shipped scenario, or the folder of a
            run, whose study is simulated anew.
        settings: values by dotted key that replace the scenario's.
        vary: the values of each varied key; every combination is a cell.
        pairs, seed: the same as ``experiment.pairs`` and ``experiment.seed``.
        out: a new or empty folder; default ``runs/<name>-<next free number>``.
        traces: whether every step is kept.
        workers: number of processes; None uses all cores; 0 uses this process alone, without time
            limits, as do strategies that are classes of a script or notebook.
        engine: ``sumo``, or ``plain`` for the same kinematics without SUMO.
        executor: runs the tasks instead of processes of this machine, for example
            that of ``dask_executor``; it is not shut down.  If it is ``Limited``, it has no more
            than ``at_once`` tasks at a time.
        progress: receives the numbers of finished and planned pairs.

    Returns:
        The finished run.  Episodes that failed are rows with a reason.

    Raises:
        InputError: the input or the folder is refused; nothing has been written.
        HarnessError: the folder can no longer be written, or the workers are lost; the run can be
            resumed.
        KeyboardInterrupt: Ctrl-C; finished work is kept, and the message says how to continue.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as out:
    ...     run("cctc", pairs=2, out=out, workers=0, engine="plain").cells[0]["pairs"].value
    2
    """
    changes = as_settings(settings or {}, pairs=pairs, seed=seed)
    if isinstance(scenario, Study):
        if changes or vary:
            raise InputError("settings", "cannot be combined with a Study", "a file, or a Scenario")
        study = scenario
    else:
        study = study_of(scenario_file(scenario, changes), [*(vary or {}).items()])
    if study.long_pairs and (traces or engine != "sumo"):
        where = Parameter("traces") if traces else Parameter("engine", engine)
        raise InputError(where, "is not supported with simulations", "SUMO, without traces")
    models, files = _checked(study, engine)
    size = 1 if study.long_pairs else part_pairs(study.base.experiment.pairs)
    manifest = claimed_folder.manifest_of(
        study, models, traces=traces, engine=engine, pairs_per_part=size, files=files
    )
    path = claimed_folder.claim_folder(out, study.name)
    with at_work(path, study, workers, executor) as (folder, chosen):
        folders.write_manifest(path, manifest)
        return _carried_out(folder, study, manifest, models, (), chosen, progress)


@checked
def resume(
    path: Path | str,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: Progress = ignore,
) -> Run:
    """Continue an interrupted run; parts that were lost or damaged are simulated again.

    Args:
        path: the run folder.
        workers, executor, progress: as for ``run``.

    Returns:
        The finished run.

    Raises:
        InputError: the folder is a risk or no run, another process uses it, it has parts of another
            run, or versions, strategies or the model differ from those of its beginning.
    """
    path = Path(path)
    manifest = folders.read_manifest(path)
    if manifest["kind"] == "risk":
        allowed = "a run; the command `harness resume` continues this one"
        raise InputError(str(path), "is a risk estimate", allowed)
    study = study_from(manifest, str(path / folders.MANIFEST))
    with at_work(path, study, workers, executor) as (folder, chosen):
        done, planned = _whole_parts(folder, study, manifest)
        if done >= planned and folders.read_findings(path, manifest, study.cells) is not None:
            return load_run(path)
        models, files = _checked(study, manifest["engine"])
        now = claimed_folder.simulated_with(study.driven, models, files)
        if done < planned:
            claimed_folder.refuse_changes(path, manifest["simulated_with"], now)
        folder.note("resumed")
        return _carried_out(folder, study, manifest, models, done, chosen, progress)


def scenario_file(scenario: Scenario | str | Path, settings: Settings) -> ScenarioFile:
    """A scenario, the file or name of one, or the folder of a run, with settings, as a file.

    The folder of a run has the study of its manifest, whose paths are absolute.

    Raises:
        InputError: the file is no scenario, or the folder holds no run.
    """
    if isinstance(scenario, Scenario) or not (folder := Path(scenario)).is_dir():
        return read_scenario_file(scenario, settings)
    if (shipped_directory("scenarios") / f"{folder}.toml").is_file():
        return read_scenario_file(scenario, settings)
    where = str(folder / folders.MANIFEST)
    with reading(where):
        study = study_from(folders.read_manifest(folder, old=True), where)
    cells = [{k: v for k, v in cell.varied.items() if v is not None} for cell in study.cells]
    tree, given = study.base.model_dump(), as_settings(settings)
    sweep = cells if study.varied_keys else None
    return ScenarioFile(study.name, where, tree, sweep, given, Path.cwd())


def checked_models(
    scenarios: Sequence[Scenario],
    engine: EngineName,
    what: str = "",
    kind: RunKind = "encounters",
) -> list[InteractionModel]:
    """The model of each scenario, after all checks but those of the user's SUMO files.

    Args:
        scenarios: the scenarios.
        engine: as for ``run``; ``plain`` needs no SUMO.
        what: name of the list of scenarios in messages, if it has one.
        kind: the kind that each scenario has to be of.

    Raises:
        InputError: a scenario is of another kind, its model or strategies are refused, or one has a
            key of ``[model]`` and none asks the model.
    """
    if engine == "sumo":
        check_packages()
    load, models = cache(load_model), []
    for number, scenario in enumerate(scenarios):
        with refused_at(f"{what}[{number}]" if what else ""):
            if scenario.kind != kind:
                problem = f"is a scenario of {scenario.kind}"
                raise InputError(Parameter("scenario"), problem, f"one of {kind}")
            models.append(load(scenario.model.name, scenario.model.path))
            check_arms(scenario, models[-1])
    changed = [key for each in scenarios for key in each.model.changed()]
    if changed and not any(each.walks_by_model or asks_model(each) for each in scenarios):
        problem = "has no effect: nobody asks the model"
        raise InputError(f"model.{changed[0]}", problem, "its default")
    return models


def _checked(study: Study, engine: EngineName) -> tuple[list[InteractionModel], Mapping[str, str]]:
    """The model of each cell and the hashes of the user's files, after all checks."""
    scenarios = [cell.scenario for cell in study.cells]
    models = checked_models(scenarios, engine, kind=study.base.kind)
    if not study.long_pairs:
        return models, {}
    from harness.studies.running import simulations

    return models, simulations.checked_files(study, models)


def _whole_parts(
    folder: RunFolder, study: Study, manifest: folders.Manifest
) -> tuple[set[Part], set[Part]]:
    """The finished parts and the planned ones; a damaged part is removed, with a line in the log.

    Raises:
        InputError: a part belongs to another run.
    """
    firsts = range(0, study.base.experiment.pairs, manifest["pairs_per_part"])
    planned = {(cell.number, first) for cell in study.cells for first in firsts}
    done = folders.done_parts(folder.path)
    for cell, first in sorted(done):
        path = folder.path / TABLES_OF[manifest["kind"]][0].name / folders.part_name(cell, first)
        if (cell, first) not in planned:
            raise InputError(str(path), "is no part that this run plans", "the parts of this run")
        try:
            for table in TABLES_OF[manifest["kind"]]:
                if table is not TRACES or manifest["traces"]:
                    folders.read_part(folder.path, table.name, cell, first, manifest)
        except folders.DamagedPartError as error:
            folder.note("part removed", reason=str(error))
            path.unlink()
            done.remove((cell, first))
    return done, planned


@contextmanager
def at_work(
    path: Path,
    study: Study,
    workers: int | None,
    executor: Executor | None,
    pairs: int | None = None,
) -> Iterator[tuple[RunFolder, Executor]]:
    """The folder, locked, and the executor; says how a run continues that ends early.

    Args:
        path: the folder.
        study: the study.
        workers: number of processes, as for ``run``.
        executor: the caller's executor, in place of one of this machine.
        pairs: the number of pairs that decides how many processes start; None: the study's.
    """
    pairs = pairs or study.base.experiment.pairs * len(study.cells)
    own = executor_for(workers, study.driven, pairs)  # starts nothing yet
    folder = RunFolder(path)
    try:
        for left in path.rglob(".*.partial"):  # by a process that was killed
            left.unlink()
        yield folder, executor or own
    except KeyboardInterrupt:
        if not (path / folders.MANIFEST).is_file():
            raise  # there is nothing to resume
        raise InterruptedRunError(path) from None
    except InputError:
        raise
    except HarnessError as error:
        advice = f"finished work is kept: {advised('resume', path)}"
        raise HarnessError(f"{error}; {advice}") from None
    finally:
        own.abort()
        folder.close()


def _carried_out(
    folder: RunFolder,
    study: Study,
    manifest: folders.Manifest,
    models: Sequence[InteractionModel],
    done: Container[Part],
    executor: Executor,
    progress: Progress,
) -> Run:
    """Simulate the parts that are not done; compute and write the findings."""
    path = folder.path
    tasks = [
        replace(task, cells=cells, folder=path.absolute() if study.long_pairs else None)
        for task in tasks_of(study, models, manifest)
        if (cells := tuple(cell for cell in task.cells if (cell.number, task.first) not in done))
    ]
    planned = study.base.experiment.pairs * len(study.cells)
    missing = sum(task.count * len(task.cells) for task in tasks)
    folder.note("started", pairs=missing, tasks=len(tasks))
    for task, _ in written(tasks, executor, folder, manifest["digest"]):
        missing -= task.count * len(task.cells)
        progress(planned - missing, planned)
    found = computed(path, manifest, study)
    folders.write_findings(path, manifest, found)
    folder.note("finished")
    return Run(path, frozen(manifest), study, True, found)


def written(
    tasks: Iterable[Task], executor: Executor, folder: RunFolder, digest: str
) -> Iterator[tuple[Task, TaskRows]]:
    """Each task with its rows as soon as they are parts of the folder, in the order of the ends."""
    most = executor.at_once if isinstance(executor, Limited) else _AT_ONCE
    waiting, running = iter(tasks), dict[Future[TaskRows], Task]()
    try:
        while True:
            for task in islice(waiting, most - len(running)):
                running[submitted(executor, task)] = task
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                task, rows = running.pop(future), future.result()
                for event in rows.events:
                    folder.note(**event)
                for number, tables in rows.tables.items():
                    folders.write_part(folder.path, number, task.first, tables, digest)
                yield task, rows
    except HarnessError:
        raise
    except CancelledError:
        raise HarnessError("the workers are gone") from None
    except Exception as error:
        raise HarnessError(f"a worker failed: {in_one_line(error)}") from error
    finally:
        for future in running:
            future.cancel()
