"""The command line: thin; what it calls is imported when it is called."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.exceptions import Abort, Exit, TyperException

from harness.errors import HarnessError, InputError

app = typer.Typer(
    name="harness",
    help="Judge an automated vehicle's strategy at an unsignalized crosswalk, in SUMO, against a "
    "human driver who meets the same pedestrians.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

ScenarioArgument = Annotated[
    str, typer.Argument(help="A scenario file (TOML), or the name of a shipped one: cctc.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Change a key of the scenario, e.g. --set ego.initial_speed_mps=8. Repeatable.",
        metavar="KEY=VALUE",
    ),
]
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
    scenario: ScenarioArgument,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the results; default runs/<scenario>-<next number>."),
    ] = None,
    pairs: Annotated[
        int | None, typer.Option(help="Number of pairs, instead of the scenario's.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Root seed, instead of the scenario's.")] = None,
    settings: SetOption = None,
    traces: Annotated[
        bool, typer.Option("--traces", help="Keep every step in traces.parquet.")
    ] = False,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run one experiment: every pair once with the AV, once with the human driver."""
    loaded, name = _load(scenario, settings, pairs, seed)
    from harness.experiment import run_experiment
    from harness.report.terminal import print_run, run_document

    with _progress(loaded.experiment.pairs, "pairs", hidden=quiet or as_json) as advance:
        finished = run_experiment(loaded, name, out=out, traces=traces, progress=advance)
    if as_json:
        _print(json.dumps(run_document(finished), indent=1))
    elif quiet:
        _print(str(finished.folder))
    else:
        print_run(finished)
    if finished.failures:
        shown = "; ".join(f"pair {pair} {arm}: {why}" for pair, arm, why in finished.failures[:3])
        _say(f"harness: {len(finished.failures)} episodes failed in the engine: {shown}")
        raise typer.Exit(1)


@app.command()
def network(
    scenario: ScenarioArgument,
    out: Annotated[Path, typer.Option(help="Folder for the sources and the network.")],
    settings: SetOption = None,
) -> None:
    """Build the scenario's SUMO network: plain-XML sources and the .net.xml."""
    loaded, name = _load(scenario, settings, None, None)
    from harness.experiment import geometry_of
    from harness.network import build_network

    files = build_network(geometry_of(loaded), out, name)
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
    from harness.results import export_csv

    if not csv:
        raise InputError("export", "no format given", "--csv")
    for path in export_csv(run_folder):
        _print(str(path))


def _load(
    scenario: str, settings: list[str] | None, pairs: int | None, seed: int | None
) -> tuple[Any, str]:
    from harness.scenario import Setting, load_scenario, parse_setting

    chosen = [parse_setting(text) for text in settings or []]
    if pairs is not None:
        chosen.append(Setting("experiment.pairs", pairs, "--pairs"))
    if seed is not None:
        chosen.append(Setting("experiment.seed", seed, "--seed"))
    return load_scenario(scenario, chosen)


@contextmanager
def _progress(total: int, what: str, hidden: bool) -> Iterator[Any]:
    """A bar on stderr that takes the number of finished items."""
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
        TimeRemainingColumn(),
        console=Console(stderr=True),
        disable=hidden,
    )
    task = bar.add_task(what, total=total)

    def advance(done: int) -> None:
        # Shown once there is something to show: a refusal is one line and no bar.
        if not hidden:
            bar.start()
        bar.update(task, completed=done)

    try:
        yield advance
    finally:
        if bar.live.is_started:
            bar.stop()


def _print(text: str) -> None:
    sys.stdout.write(text + "\n")


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")
