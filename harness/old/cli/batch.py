"""The commands ``run`` (also called ``sweep``) and ``resume``."""

from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from harness.core.errors import one_line
from harness.old.cli import options
from harness.old.cli.interruption import unwinding
from harness.old.cli.options import not_with, settings_of
from harness.old.cli.output import emit, progress_bar, say

if TYPE_CHECKING:
    from harness.old.studies.runs.run_data import RunData
    from harness.old.studies.workers.cluster import DaskCluster
    from harness.old.studies.workers.executor import Executor
    from harness.scenario import EngineName, Study


def run(
    scenario: str,
    vary: list[str] | None,
    out: Path | None,
    pairs: int | None,
    seed: int | None,
    settings: list[str] | None,
    workers: int | None,
    traces: bool,
    engine: "EngineName",
    dask: str | None,
    full: bool,
    quiet: bool,
    as_json: bool,
) -> None:
    """Run every pair with the AV and again with the human driver."""
    from harness.scenario import Options, parse_variation, read_scenario_file, remarks, study_of
    from harness.scenario.variation import flatten

    file = read_scenario_file(scenario, settings_of(settings, pairs, seed))
    study = study_of(file, [parse_variation(text) for text in vary or []])
    if vary and file.sweep is not None:
        say(f"note: --vary replaces the [sweep] of {file.source}: {', '.join(flatten(file.sweep))}")
    notes = [line for cell in study.cells for line in remarks(cell.scenario)]
    for remark in dict.fromkeys([study.remark, *notes]):
        if remark is not None:
            say(f"harness: {remark}")
    choices = Options(traces, workers, engine=engine)
    from harness.old.studies.workers.executors import executor_for

    # Local workers import modules at the same time as this process.  A wrong address is refused
    # before a run folder exists.
    executor = executor_for(study, choices, dask)

    def begin(_workers: int) -> "Executor":
        # All input is checked by now, and a refusal has one line only.
        if (planned := _planned_hours(study)) is not None:
            say(f"note: {planned}")
        return executor

    try:
        from harness.old.studies.batch.experiment import run_study

        with progress_bar("pairs", quiet or as_json) as advance, unwinding():
            finished = run_study(study, choices, out=out, progress=advance, make_executor=begin)
    finally:
        executor.stop()
    _report(finished, full, quiet, as_json)


def _planned_hours(study: "Study") -> str | None:
    """Return how many hours of traffic a run counts; None if they are at most one."""
    from harness.old.studies.runs.notes import counted

    if study.hours <= 1:
        return None
    # Cells that differ in the reference may share the AV's arm.
    most = "at most " if "arms.human" in study.varied_keys else ""
    cells = counted(len(study.cells), "cell")
    pairs = counted(study.base.experiment.pairs, "pair")
    hours = f"{most}{study.hours:,.4g} hours of traffic in each arm"
    return f"{cells} × {pairs}: {hours}, without the warm-ups"


def resume(
    run_folder: options.RunArgument,
    workers: options.WorkersOption = None,
    dask: options.DaskOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Continue an interrupted run or risk estimate."""
    from harness.old.cli.risk import resume_risk
    from harness.old.store.reading import kind_of_folder

    resumes = {"run": _resume_run, "risk": resume_risk}
    resumes[kind_of_folder(run_folder)](run_folder, workers, dask, full, quiet, as_json)


def _resume_run(
    run_folder: Path, workers: int | None, dask: str | None, full: bool, quiet: bool, as_json: bool
) -> None:
    from harness.old.studies.batch.experiment import resume as resume_run

    if dask is not None and workers is not None:
        raise not_with("--workers", "--dask", "the cluster's own workers")
    with progress_bar("pairs", quiet or as_json) as advance, unwinding():
        finished = resume_run(
            run_folder,
            workers=workers,
            progress=advance,
            make_executor=None if dask is None else lambda _: _cluster(dask),
        )
    _report(finished, full, quiet, as_json)


def _cluster(address: str) -> "DaskCluster":
    from harness.old.studies.workers.cluster import DaskCluster

    return DaskCluster(address)


def _report(finished: "RunData", full: bool, quiet: bool, as_json: bool) -> None:
    from harness.old.report.screens.run_document import run_document
    from harness.old.report.screens.terminal import print_run

    show = partial(print_run, finished, full)
    emit(quiet, as_json, partial(run_document, finished), [finished.path], show)
    if failures := finished.failures:
        first = (f"cell {cell} pair {pair} {arm}: {why}" for cell, pair, arm, why in failures)
        more = f" and {len(failures) - 3} more (log.jsonl)" if len(failures) > 3 else ""
        examples = "; ".join(islice(first, 3))
        say(one_line(f"harness: {len(failures)} episodes failed: {examples}{more}"))
        raise typer.Exit(1)
