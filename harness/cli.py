"""The command line: thin; what it calls is imported when it is called."""

import json
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from typer.exceptions import Abort, Exit, TyperException

from harness.cli_model import register
from harness.errors import HarnessError, InputError, InterruptedRunError

app = typer.Typer(
    name="harness",
    help="Judge an automated vehicle's strategy at an unsignalized crosswalk, in SUMO, against a "
    "human driver who meets the same pedestrians.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

_SCENARIO_HELP = "A scenario file (TOML), or the name of a shipped one: cctc, cctc_flow."
ScenarioArgument = Annotated[str, typer.Argument(help=_SCENARIO_HELP)]
OptionalScenarioArgument = Annotated[
    str | None, typer.Argument(help=_SCENARIO_HELP, show_default=False)
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Change a key of the scenario, e.g. --set ego.initial_speed_mps=8. Repeatable.",
        metavar="KEY=VALUE",
    ),
]
VaryOption = Annotated[
    list[str] | None,
    typer.Option(
        "--vary",
        help="Vary a key over values or a range, e.g. --vary pedestrians.flow_per_hour=50,100 "
        "--vary strategies.soft_yield.p1=0:0.1:0.02. Repeatable: the grid of all.",
        metavar="KEY=V1,V2,…",
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option(help="Folder for the results; default runs/<scenario>-<next number>."),
]
PairsOption = Annotated[
    int | None, typer.Option(help="Number of pairs of each cell, instead of the scenario's.")
]
SeedOption = Annotated[int | None, typer.Option(help="Root seed, instead of the scenario's.")]
UntilOption = Annotated[
    str | None,
    typer.Option(
        help="Stop when every cell's interval is this narrow (half-width), or at --pairs: "
        "mu=0.01 or kappa=0.005. Looks at 1,000 pairs and at each doubling.",
        metavar="MEASURE=WIDTH",
    ),
]
WorkersOption = Annotated[
    int | None, typer.Option(min=1, max=1024, help="Worker processes; default: all cores.")
]
ResumeOption = Annotated[
    Path | None,
    typer.Option(help="Go on with an interrupted run; stands alone.", metavar="DIR"),
]
DaskOption = Annotated[
    str | None,
    typer.Option(
        help="Run the tasks on a Dask cluster, e.g. tcp://127.0.0.1:8786 (pip install "
        "crosswalk-harness[cluster]); its workers must have one thread each.",
        metavar="ADDRESS",
    ),
]
SumoOutputsOption = Annotated[
    str | None,
    typer.Option(
        help="Run episodes again one by one with SUMO's own outputs on, into RUN/sumo: all or "
        "crashed. Slower: each gets a SUMO of its own.",
        metavar="WHICH",
    ),
]
TracesOption = Annotated[bool, typer.Option("--traces", help="Keep every step in traces.parquet.")]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the results as JSON and nothing else.")
]
QuietOption = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print only the path of what was written.")
]


def main() -> None:
    """Run the command line; every refusal becomes one line on stderr and exit code 2."""
    try:
        code = app(standalone_mode=False)
    except (InputError, TyperException) as error:
        text = error.format_message() if isinstance(error, TyperException) else str(error)
        _say("harness: " + " ".join(text.split()))
        code = 2
    except InterruptedRunError as error:
        _say(f"harness: {error}")
        code = 130
    except HarnessError as error:
        _say(f"harness: {error}")
        code = 1
    except Exit as error:
        code = error.exit_code
    except (Abort, KeyboardInterrupt):
        _say("harness: interrupted")
        code = 130
    sys.exit(code if isinstance(code, int) else 0)


@app.command()
def run(
    scenario: OptionalScenarioArgument = None,
    out: OutOption = None,
    pairs: PairsOption = None,
    seed: SeedOption = None,
    settings: SetOption = None,
    until: UntilOption = None,
    workers: WorkersOption = None,
    resume: ResumeOption = None,
    traces: TracesOption = False,
    sumo_outputs: SumoOutputsOption = None,
    dask: DaskOption = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run one experiment: every pair once with the AV, once with the human driver."""
    from harness.scenario import read_scenario_file
    from harness.study import single_cell

    if resume is not None:
        _refuse_beside_resume(scenario, out, pairs, seed, settings, until, traces, sumo_outputs)
        _resume(resume, workers, dask, quiet, as_json)
        return
    file = read_scenario_file(_required(scenario), _settings(settings, pairs, seed))
    how = _How(until, workers, traces, sumo_outputs, dask, quiet, as_json)
    _start(single_cell(file), out, how)


@app.command()
def sweep(
    scenario: OptionalScenarioArgument = None,
    vary: VaryOption = None,
    out: OutOption = None,
    pairs: PairsOption = None,
    seed: SeedOption = None,
    settings: SetOption = None,
    until: UntilOption = None,
    workers: WorkersOption = None,
    resume: ResumeOption = None,
    traces: TracesOption = False,
    sumo_outputs: SumoOutputsOption = None,
    dask: DaskOption = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run a grid of cells, e.g. over the pedestrian flow and several strategies."""
    from harness.scenario import read_scenario_file
    from harness.study import parse_variation, study_of

    if resume is not None:
        _refuse_beside_resume(
            scenario, out, pairs, seed, settings, until, traces, sumo_outputs, vary
        )
        _resume(resume, workers, dask, quiet, as_json)
        return
    file = read_scenario_file(_required(scenario), _settings(settings, pairs, seed))
    study = study_of(file, [parse_variation(text) for text in vary or []])
    how = _How(until, workers, traces, sumo_outputs, dask, quiet, as_json)
    _start(study, out, how)


@app.command()
def replay(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A finished run folder.")],
    pair: Annotated[int, typer.Option(help="Which pair.")],
    out: Annotated[Path, typer.Option(help="A new folder for SUMO's output files.")],
    cell: Annotated[int, typer.Option(help="Which cell of a sweep.")] = 0,
    arm: Annotated[str, typer.Option(help="av, human or both.")] = "both",
) -> None:
    """Run one episode again in a fresh SUMO, with SUMO's own outputs on."""
    from harness.encounter import Arm
    from harness.replay import replay as run_again

    if arm not in ("av", "human", "both"):
        raise InputError(f"--arm {arm}", "no such arm", "av, human or both")
    arms = list(Arm) if arm == "both" else [Arm(arm)]
    replayed = run_again(run_folder, pair, arms, cell, out)
    for episode in replayed:
        verdict = "differs from" if episode.differences else "is identical to"
        _print(f"{episode.folder}: the record {verdict} the stored one")
        for difference in episode.differences:
            _print(f"    {difference}")
    if any(episode.differences for episode in replayed):
        raise typer.Exit(1)


@app.command()
def score(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run with --traces.")],
    out: Annotated[Path, typer.Option(help="A new folder for the recomputed run.")],
) -> None:
    """Recompute measures and summary from kept traces, without simulating."""
    from harness.scoring import score as recompute

    _print(str(recompute(run_folder, out)))


@app.command()
def network(
    scenario: ScenarioArgument,
    out: Annotated[Path, typer.Option(help="Folder for the sources and the network.")],
    settings: SetOption = None,
) -> None:
    """Build the scenario's SUMO network: plain-XML sources and the .net.xml."""
    from harness.scenario import read_scenario_file

    file = read_scenario_file(scenario, _settings(settings, None, None))
    loaded = file.scenario()
    from harness.network import build_network
    from harness.place import geometry_of

    files = build_network(geometry_of(loaded), out, file.name)
    _print(str(files.net))


@app.command()
def strategies() -> None:
    """List the strategies and their parameters."""
    from harness.report.terminal import print_strategies

    print_strategies()


@app.command()
def doctor() -> None:
    """Check this installation: versions, SUMO, a network build, one episode."""
    from harness.report.terminal import print_checks

    if not print_checks():
        raise typer.Exit(1)


@app.command()
def export(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
    csv: Annotated[bool, typer.Option("--csv", help="Write every table as CSV.")] = False,
) -> None:
    """Write the tables of a run folder in another format, beside the originals."""
    from harness.run_folder import export_csv

    if not csv:
        raise InputError("export", "no format given", "--csv")
    for path in export_csv(run_folder):
        _print(str(path))


register(app)


def _settings(settings: list[str] | None, pairs: int | None, seed: int | None) -> list[Any]:
    from harness.scenario import Setting, parse_setting

    chosen = [parse_setting(text) for text in settings or []]
    if pairs is not None:
        chosen.append(Setting("experiment.pairs", pairs, "--pairs"))
    if seed is not None:
        chosen.append(Setting("experiment.seed", seed, "--seed"))
    return chosen


def _required(scenario: str | None) -> str:
    if scenario is None:
        raise InputError("SCENARIO", "is missing", "a scenario file (TOML), or a name such as cctc")
    return scenario


def _refuse_beside_resume(*others: object) -> None:
    if any(other not in (None, False) for other in others):
        raise InputError(
            "--resume", "stands beside other options", "--workers, --dask, --quiet and --json alone"
        )


class _How(NamedTuple):
    """How a run is carried out and reported: the options `run` and `sweep` share."""

    until: str | None
    workers: int | None
    traces: bool
    sumo_outputs: str | None
    dask: str | None
    quiet: bool
    as_json: bool


def _start(study: Any, out: Path | None, how: _How) -> None:
    from harness.experiment import Options, run_study

    if how.sumo_outputs not in (None, "all", "crashed"):
        raise InputError(f"--sumo-outputs {how.sumo_outputs}", "no such choice", "all or crashed")
    options = Options(
        traces=how.traces, until=_precision(how.until), workers=_workers(how.workers, how.dask)
    )
    hidden = how.quiet or how.as_json
    with _progress("pairs", hidden) as advance, _termination():
        finished = run_study(
            study, options, out=out, progress=advance, make_executor=_executor(how.dask)
        )
    if how.sumo_outputs is not None:
        from harness.replay import replay_into

        if not hidden:
            _say(f"SUMO's outputs of {how.sumo_outputs} episodes: one SUMO for each, be patient")
        for episode in replay_into(finished.folder, how.sumo_outputs):
            for difference in episode.differences:
                raise HarnessError(f"{episode.folder}: {difference}")
    _report(finished, how.quiet, how.as_json)


def _resume(
    folder: Path, workers: int | None, dask: str | None, quiet: bool, as_json: bool
) -> None:
    from harness.experiment import resume

    with _progress("pairs", hidden=quiet or as_json) as advance, _termination():
        finished = resume(
            folder,
            workers=_workers(workers, dask),
            progress=advance,
            make_executor=_executor(dask),
        )
    _report(finished, quiet, as_json)


def _workers(workers: int | None, dask: str | None) -> int | None:
    if dask is not None and workers is not None:
        raise InputError("--workers", "stands beside --dask", "the cluster has its own workers")
    return workers


def _executor(dask: str | None) -> Any:
    if dask is None:
        from harness.execution import LocalPool

        return LocalPool
    from harness.cluster import DaskCluster

    # A wrong address is refused before a run folder is made.
    DaskCluster(dask).stop()
    return lambda _workers: DaskCluster(dask)


def _precision(text: str | None) -> Any:
    if text is None:
        return None
    from harness.experiment import Precision

    measure, _, number = text.partition("=")
    try:
        width = float(number)
    except ValueError:
        width = 0.0
    if measure not in ("mu", "kappa") or not 0 < width < 1:
        raise InputError(f"--until {text}", "is not accepted", "mu=WIDTH or kappa=WIDTH, 0 to 1")
    return Precision(measure, width)


def _report(finished: Any, quiet: bool, as_json: bool) -> None:
    from harness.report.terminal import print_run, run_document

    if as_json:
        _print(json.dumps(run_document(finished), indent=1))
    elif quiet:
        _print(str(finished.folder))
    else:
        print_run(finished)
    failures = finished.failures
    if failures:
        shown = "; ".join(
            f"cell {cell} pair {pair} {arm}: {why}" for cell, pair, arm, why in failures[:3]
        )
        more = f" and {len(failures) - 3} more (log.jsonl)" if len(failures) > 3 else ""
        _say(f"harness: {len(failures)} episodes failed in the engine: {shown}{more}")
        raise typer.Exit(1)


@contextmanager
def _termination() -> Iterator[None]:
    """SIGTERM ends a run as Ctrl-C does: workers stopped, folder resumable."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _progress(what: str, hidden: bool) -> Iterator[Any]:
    """A bar on stderr that takes (done, planned)."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        disable=hidden,
    )
    task = bar.add_task(what, rate="")

    def advance(done: int, planned: int) -> None:
        # Shown once there is something to show: a refusal is one line and no bar.
        if not hidden:
            bar.start()
        speed = bar.tasks[0].speed
        bar.update(
            task, completed=done, total=planned, rate=f"{speed:.0f}/s" if speed is not None else ""
        )

    try:
        yield advance
    finally:
        if bar.live.is_started:
            bar.stop()


def _print(text: str) -> None:
    sys.stdout.write(text + "\n")


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")
