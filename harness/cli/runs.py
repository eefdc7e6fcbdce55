"""The commands ``run`` (also ``sweep``), ``risk`` and ``resume``, and where their tasks run."""

import logging
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from harness.cli import options
from harness.cli.interruption import unwinding
from harness.cli.options import settings_of
from harness.cli.output import progress_bar, say, show
from harness.core.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from concurrent.futures import Executor


def run(
    scenario: options.StudyArgument,
    vary: options.VaryOption = None,
    out: options.OutOption = None,
    pairs: Annotated[int | None, Option(help="Pairs per cell, instead of the scenario's.")] = None,
    seed: options.SeedOption = None,
    settings: options.SetOption = None,
    workers: options.WorkersOption = None,
    traces: Annotated[bool, Option("--traces", help="Keep the state at every step.")] = False,
    engine: options.EngineOption = "sumo",
    dask: options.DaskOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Run every pair of every cell with the AV and the reference."""
    from harness.studies.running import children, workers as local

    if dask is None:
        # They import their modules while this process imports its own.
        children.start_children(local.workers_for(workers, pairs))
    try:
        from harness.scenario import read_scenario_file, study_of
        from harness.scenario.variation import parse_variation

        given = settings_of(settings, pairs, seed)
        if Path(scenario).is_dir():  # a run's folder needs more modules
            from harness.studies.running.run import scenario_file

            file = scenario_file(scenario, given)
        else:
            file = read_scenario_file(scenario, given)
        variations = [parse_variation(text) for text in vary or []]
        study = study_of(file, variations)
        if vary and file.sweep is not None:
            say(f"note: --vary replaces the [sweep] of {file.source}")
        children.import_arrow()
        from harness.studies.running.run import run as run_study

        bar = progress_bar(quiet or as_json)
        with bar as advance, unwinding(), _cluster(dask, workers, study.driven) as cluster:
            finished = run_study(
                study,
                out=out,
                traces=traces,
                workers=workers,
                engine=engine,
                executor=cluster,
                progress=advance,
            )
    finally:
        children.stop_children()
    show(finished.result(), [finished.path], full=full, quiet=quiet, as_json=as_json)


def resume(
    run_folder: options.RunArgument,
    workers: options.WorkersOption = None,
    dask: options.DaskOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Continue an interrupted run or risk estimate."""
    from harness.results.folder import read_manifest
    from harness.scenario.study import study_from

    manifest = read_manifest(run_folder)
    driven = study_from(manifest, str(run_folder)).driven
    bar = progress_bar(quiet or as_json, "done")
    with bar as advance, unwinding(), _cluster(dask, workers, driven) as cluster:
        how: dict[str, Any] = {"workers": workers, "executor": cluster, "progress": advance}
        if manifest["kind"] == "risk":
            from harness.studies.risk.estimate import resume_risk

            result = resume_risk(run_folder, **how)
        else:
            from harness.studies.running.run import resume as resume_run

            result = resume_run(run_folder, **how).result()
    show(result, [run_folder], full=full, quiet=quiet, as_json=as_json)


def risk(
    scenario: options.StudyArgument,
    event: options.EventOption = "crashed",
    arm: options.ArmOption = "av",
    target_cv: Annotated[float, Option(help="Target: standard error / probability.")] = 0.1,
    out: options.OutOption = None,
    seed: options.SeedOption = None,
    settings: options.SetOption = None,
    workers: options.WorkersOption = None,
    engine: options.EngineOption = "plain",
    dask: options.DaskOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Estimate the probability of a rare event in an episode."""
    from harness.core.vocabulary import Arm
    from harness.scenario import study_of
    from harness.studies.risk.estimate import risk as estimate
    from harness.studies.running.run import scenario_file

    study = study_of(scenario_file(scenario, settings_of(settings, None, seed)))
    bar = progress_bar(quiet or as_json, "parts")
    with bar as advance, unwinding(), _cluster(dask, workers, study.driven) as cluster:
        result = estimate(
            study,
            event,
            arm=Arm(arm),
            target_cv=target_cv,
            out=out,
            engine=engine,
            workers=workers,
            executor=cluster,
            progress=advance,
        )
    show(result, [result.facts["folder"]], full=full, quiet=quiet, as_json=as_json)


@contextmanager
def _cluster(at: str | None, workers: int | None, driven: list[str]) -> "Iterator[Executor | None]":
    """Yield the executor of the cluster at an address, if there is one."""
    if at is None:
        yield None
        return
    if workers is not None:
        raise InputError("--workers", "cannot be combined with --dask", "one of the two")
    from harness.studies.running.workers import dask_executor

    with dask_executor(at, driven) as executor:
        # A lost scheduler is told in one line.  Importing Dask has set these levels.
        for name in ("distributed", "distributed.client", "asyncio", "tornado.application"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        yield executor
