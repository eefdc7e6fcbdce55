"""``run`` (``sweep`` is its other name) and ``resume``: experiments begun, and gone on with."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli.interruption import unwinding
from harness.cli.options import (
    AuditOption,
    DaskOption,
    EngineOption,
    JsonOption,
    OutOption,
    PairsOption,
    QuietOption,
    ScenarioArgument,
    SeedOption,
    SetOption,
    SettleOption,
    SumoOutputsOption,
    TracesOption,
    UntilOption,
    VaryOption,
    WorkersOption,
    settings_of,
)
from harness.cli.output import print_json, print_line, progress_bar, say
from harness.errors import InputError, one_line


def run(
    scenario: ScenarioArgument,
    vary: VaryOption = None,
    out: OutOption = None,
    pairs: PairsOption = None,
    seed: SeedOption = None,
    settings: SetOption = None,
    until: UntilOption = None,
    settle: SettleOption = False,
    workers: WorkersOption = None,
    traces: TracesOption = False,
    sumo_outputs: SumoOutputsOption = None,
    engine: EngineOption = "sumo",
    audit: AuditOption = None,
    dask: DaskOption = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run every pair once with the AV, once with the human driver.

    With --vary: so in each cell of a sweep.
    """
    from harness.scenario import Options, parse_variation, read_scenario_file, remarks, study_of
    from harness.scenario.options import AUDIT_SHARE

    file = read_scenario_file(scenario, settings_of(settings, pairs, seed))
    study = study_of(file, [parse_variation(text) for text in vary or []])
    if study.remark is not None:
        say(f"harness: {study.remark}")
    for remark in dict.fromkeys(line for cell in study.cells for line in remarks(cell.scenario)):
        say(f"harness: {remark}")
    if sumo_outputs not in (None, "all", "crashed"):
        raise InputError(f"--sumo-outputs {sumo_outputs}", "no such choice", "all or crashed")
    _refuse_workers_beside_dask(workers, dask)
    options = Options(
        traces,
        _precision(until),
        workers,
        sumo_outputs=sumo_outputs,  # type: ignore[arg-type]
        engine=_engine(engine, audit),
        audit=AUDIT_SHARE if audit is None else audit,
    )
    if settle:
        study = _settled(study, options, quiet or as_json)
    with _executor(study, options, dask) as make_executor:
        from harness.batch.experiment import run_study

        with progress_bar("pairs", quiet or as_json) as advance, unwinding():
            finished = run_study(
                study, options, out=out, progress=advance, make_executor=make_executor
            )
    _report(finished, quiet, as_json)


def _settled(study: Any, options: Any, quiet: bool) -> Any:
    from harness.batch.settling import settled

    with progress_bar("pilots", quiet) as advance, unwinding():
        found = settled(study, options, advance)
    warm_ups = [cell.scenario.known_traffic.warm_up_s for cell in found.cells]
    span = f"{min(warm_ups):g}" + (f" to {max(warm_ups):g}" if len({*warm_ups}) > 1 else "")
    say(f"harness: traffic.warm_up_s = {span} by a pilot of each cell")
    return found


def resume(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="The run folder.")],
    workers: WorkersOption = None,
    dask: DaskOption = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Go on with a run, or a risk, that was interrupted."""
    from harness.batch.experiment import resume as go_on
    from harness.cli.risk import go_on_with_risk, is_risk

    if is_risk(run_folder):
        go_on_with_risk(run_folder, workers, dask, quiet, as_json, full=False)
        return

    _refuse_workers_beside_dask(workers, dask)
    with (
        _cluster(dask) as make_executor,
        progress_bar("pairs", quiet or as_json) as advance,
        unwinding(),
    ):
        finished = go_on(run_folder, workers=workers, progress=advance, make_executor=make_executor)
    _report(finished, quiet, as_json)


def _refuse_workers_beside_dask(workers: int | None, dask: str | None) -> None:
    if dask is not None and workers is not None:
        raise InputError("--workers", "stands beside --dask", "the cluster has its own workers")


@contextmanager
def _executor(study: Any, options: Any, dask: str | None) -> Iterator[Any]:
    """The executor of a study's tasks; its workers import while this process still does."""
    from harness.workers.pool import pool_for

    if dask is not None:
        with _cluster(dask) as make_executor:
            yield make_executor
        return
    pool = pool_for(study, options)
    try:
        yield lambda _workers: pool
    finally:
        pool.stop()


@contextmanager
def _cluster(dask: str | None) -> Iterator[Any]:
    """The Dask cluster; None: local workers, made when the plan is known."""
    if dask is None:
        yield None
        return
    from harness.workers.cluster import DaskCluster

    # A wrong address is refused before a run folder is made.
    cluster = DaskCluster(dask)
    try:
        yield lambda _workers: cluster
    finally:
        cluster.stop()


def _engine(name: str, audit: float | None) -> Any:
    from harness.scenario import engine_named

    engine_named(name, "--engine")
    if name == "sumo" and audit is not None:
        raise InputError("--audit", "goes with --engine plain", "--engine plain")
    return name


def _precision(text: str | None) -> Any:
    if text is None:
        return None
    from harness.scenario import Precision

    measure, _, number = text.partition("=")
    try:
        return Precision(measure, float(number))
    except (ValueError, InputError):
        allowed = "mu=WIDTH or kappa=WIDTH, 0 to 1"
        raise InputError(f"--until {text}", "is not accepted", allowed) from None


def _report(finished: Any, quiet: bool, as_json: bool) -> None:
    from harness.report.terminal import print_run, run_document

    if as_json:
        print_json(run_document(finished))
    elif quiet:
        print_line(str(finished.path))
    else:
        print_run(finished)
    for failures, what in (
        (finished.failures, "episodes failed"),
        (finished.output_failures, "episodes have no SUMO outputs, or others than they should"),
        (finished.disagreements, "records of the plain engine are not SUMO's"),
    ):
        if failures:
            shown = "; ".join(
                f"cell {cell} pair {pair} {arm}: {why}" for cell, pair, arm, why in failures[:3]
            )
            more = f" and {len(failures) - 3} more (log.jsonl)" if len(failures) > 3 else ""
            say(one_line(f"harness: {len(failures)} {what}: {shown}{more}"))
    if finished.failures or finished.output_failures or finished.disagreements:
        raise typer.Exit(1)
