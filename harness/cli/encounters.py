"""The commands ``run`` (also called ``sweep``) and ``resume``."""

from typing import TYPE_CHECKING

import typer

from harness.cli import options
from harness.cli.interruption import unwinding
from harness.cli.options import settings_of
from harness.cli.output import progress_bar, say, show
from harness.core.errors import InputError, one_line

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from harness.results.run import Run


def run(
    scenario: options.ScenarioArgument,
    vary: options.VaryOption = None,
    out: options.OutOption = None,
    pairs: options.PairsOption = None,
    seed: options.SeedOption = None,
    settings: options.SetOption = None,
    workers: options.WorkersOption = None,
    traces: options.TracesOption = False,
    engine: options.EngineOption = "sumo",
    dask: options.DaskOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Run every pair with the AV and again with the human driver; with --vary, every cell."""
    from harness.studies import children, workers as local

    if dask is None:
        # They import their modules while this process imports its own.
        children.start_children(local.workers_for(workers, pairs))
    try:
        from harness.scenario import parse_variation, read_scenario_file, remarks, study_of

        file = read_scenario_file(scenario, settings_of(settings, pairs, seed))
        study = study_of(file, [parse_variation(text) for text in vary or []])
        lines = [line for cell in study.cells for line in remarks(cell.scenario)]
        for remark in filter(None, dict.fromkeys([study.remark, *lines])):
            say(f"harness: {remark}")
        if vary and file.sweep is not None:
            say(f"note: --vary replaces the [sweep] of {file.source}")
        from harness.studies.run import run as run_study

        with progress_bar(quiet or as_json) as advance, unwinding():
            finished = run_study(
                study,
                out=out,
                traces=traces,
                workers=workers,
                engine=engine,
                executor=_cluster(dask, workers, study.driven),
                progress=advance,
            )
    finally:
        children.stop_children()
    print_run(finished, full, quiet, as_json)


def resume(
    run_folder: options.RunArgument,
    workers: options.WorkersOption = None,
    dask: options.DaskOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Continue an interrupted run."""
    from harness.results.run import load_run
    from harness.studies.run import resume as resume_run

    driven = load_run(run_folder).study.driven
    with progress_bar(quiet or as_json) as advance, unwinding():
        finished = resume_run(
            run_folder, workers=workers, executor=_cluster(dask, workers, driven), progress=advance
        )
    print_run(finished, full, quiet, as_json)


def _cluster(address: str | None, workers: int | None, drivers: list[str]) -> "Executor | None":
    if address is None:
        return None
    if workers is not None:
        raise InputError("--workers", "cannot be combined with --dask", "one of the two")
    from harness.studies.workers import dask_executor

    return dask_executor(address, drivers)


def print_run(run: "Run", full: bool, quiet: bool, as_json: bool) -> None:
    """Print a run's result, and its failures on stderr.

    Raises:
        Exit: with code 1, if an episode failed.
    """
    show(run.result(), full, quiet, as_json, [run.path])
    if failures := run.failures:
        cell, pair, arm, why = failures[0]
        first = f"cell {cell} pair {pair} {arm}: {why}"
        say(one_line(f"harness: {len(failures)} episodes failed (log.jsonl); the first: {first}"))
        raise typer.Exit(1)
