"""The commands ``replay``, ``compare`` and ``worst`` for run folders."""

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from harness.core.errors import InputError, one_line
from harness.old.cli import options
from harness.old.cli.interruption import unwinding
from harness.old.cli.options import not_with, refuse_without
from harness.old.cli.output import emit, print_line, say


def replay(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A finished run folder.")],
    pair: Annotated[int, typer.Option(help="Number of the pair.")],
    out: Annotated[
        Path | None,
        typer.Option(help="A new folder for SUMO's output files; not with --gui.", metavar="DIR"),
    ] = None,
    cell: Annotated[int, typer.Option(help="Number of the cell in a sweep.")] = 0,
    arm: Annotated[
        Literal["av", "human", "both"], typer.Option(help="Arm to repeat, or both.")
    ] = "both",
    gui: Annotated[
        bool, typer.Option("--gui", help="Show the episode in sumo-gui, one arm after the other.")
    ] = False,
    pace: Annotated[
        float | None,
        typer.Option(help="With --gui: playback speed; 1 is real time, 4 is four times as fast."),
    ] = None,
    screenshots: Annotated[
        Path | None,
        typer.Option(help="With --gui: a new folder for screenshots (PNG).", metavar="DIR"),
    ] = None,
    every: Annotated[
        float | None,
        typer.Option(help="With --screenshots: seconds between two screenshots; default 0.5."),
    ] = None,
    vehicle: Annotated[
        str | None,
        typer.Option(
            help="With --gui, for [simulation]: show this vehicle's most striking passage.",
            metavar="ID",
        ),
    ] = None,
    crosswalk: Annotated[
        str | None,
        typer.Option(help="The same, over this crosswalk.", metavar="ID"),
    ] = None,
    in_this_process: Annotated[
        bool,
        typer.Option(
            "--debug",
            help="Run in this process without time limits, so that breakpoint() works in decide.",
        ),
    ] = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Repeat one episode: with SUMO's outputs, or in sumo-gui."""
    from harness.core.encounter import Arm

    arms = list(Arm) if arm == "both" else [Arm(arm)]
    if gui and out is not None:
        raise not_with("--out", "--gui", "--screenshots DIR")
    if gui and in_this_process:
        raise not_with("--debug", "--gui", "--gui alone, in which breakpoint() works, too")
    if in_this_process and out is not None:
        raise not_with("--out", "--debug", "one of the two")
    which = {"vehicle": vehicle, "crosswalk": crosswalk}
    refuse_without("--gui", gui, pace=pace, screenshots=screenshots, **which)
    refuse_without("--screenshots DIR", screenshots is not None, every=every)
    problems, tracebacks = list[str](), list[str | None]()
    if gui:
        from harness.old.studies.replay.watch import watch

        with unwinding():
            pace, every = 1.0 if pace is None else pace, 0.5 if every is None else every
            watched = watch(
                *(run_folder, pair, arms, cell),
                pace=pace,
                screenshots=screenshots,
                every_s=every,
                vehicle=vehicle,
                crosswalk=crosswalk,
            )
        shown = [(f"pair {pair}, arm {item.arm}", item.differences) for item in watched]
    elif in_this_process:
        from harness.old.studies.replay.rerun import debug

        repeated = debug(run_folder, pair, arms, cell)
        tracebacks = [item.traceback for item in repeated.values()]
        shown = [(f"pair {pair}, arm {key}", item.differences) for key, item in repeated.items()]
    elif out is None:
        raise InputError("--out", "is missing", "a new folder for SUMO's files, --gui or --debug")
    else:
        from harness.old.studies.replay.rerun import replay as run_again

        with unwinding():
            replayed = run_again(run_folder, pair, arms, cell, out)
        tracebacks = [item.traceback for item in replayed]
        problems = [f"{item.folder}: {item.problem}" for item in replayed if item.problem]
        shown = [(str(item.folder), item.differences) for item in replayed if not item.problem]
    for traceback in filter(None, tracebacks):
        say(traceback.rstrip())
    if problems:
        say(one_line(f"harness: {'; '.join(problems)}; SUMO's files are incomplete"))
    _report_replays(shown, problems, quiet, as_json)


def _report_replays(
    shown: list[tuple[str, tuple[str, ...]]], problems: list[str], quiet: bool, as_json: bool
) -> None:
    """Print for each repeated episode whether its record is identical to the stored record."""

    def show() -> None:
        for name, differences in shown:
            verdict = "differs from" if differences else "is identical to"
            print_line(f"{name}: the record {verdict} the stored record")
            for difference in differences:
                print_line(f"    {difference}")

    document = {
        "episodes": [{"episode": name, "differences": [*differing]} for name, differing in shown],
        "problems": problems,
    }
    emit(quiet, as_json, document, [name for name, _ in shown], show)
    if problems or any(differences for _, differences in shown):
        raise typer.Exit(1)


def compare(
    run_folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN…",
            help="A finished sweep, or several finished runs with the same pedestrians.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Write the comparisons to a new CSV file.", metavar="FILE"),
    ] = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Compare the AV's arms of several runs with [traffic] or [simulation]."""
    from harness.core.files import write_csv
    from harness.old.report.screens.run_document import arms_document, arms_rows
    from harness.old.report.screens.terminal import print_arms
    from harness.old.studies.runs.compare_arms import compare_arms
    from harness.old.studies.runs.opening import load_run

    runs = [load_run(folder) for folder in run_folders]
    findings = compare_arms(runs)
    if out is not None:
        write_csv(out, arms_rows(findings))
    screen = partial(print_arms, findings, full)
    written = [out] if out is not None else []
    emit(quiet, as_json, partial(arms_document, findings), written, screen)


def worst(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A finished run folder.")],
    by: Annotated[
        str,
        typer.Option(help="Measure to rank by, e.g. min_ttc_s, delay_s, stops."),
    ] = "pet_s",
    most: Annotated[int, typer.Option("-n", help="Number of episodes.", metavar="N")] = 20,
    arm: options.ArmOption = "av",
    cell: Annotated[int | None, typer.Option(help="Only this cell.")] = None,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print only the replay commands.")
    ] = False,
    as_json: options.JsonOption = False,
) -> None:
    """List the worst episodes and the commands that replay them."""
    from harness.old.report.screens.worst_tables import worst_document, worst_tables
    from harness.old.studies.conflicts import is_conflicts
    from harness.old.studies.runs.worst import worst as worst_of

    if is_conflicts(run_folder):
        refuse_without("a run of pairs", False, cell=cell)
        _worst_passages(run_folder, by, most, quiet, as_json)
        return
    episodes = worst_of(run_folder, by, most, arm, cell)

    def show() -> None:
        from harness.old.report.screens.console import make_console, print_table

        console = make_console()
        print_table(console, worst_tables(episodes, by))
        for episode in episodes:
            console.print(episode.command, soft_wrap=True)

    commands = [episode.command for episode in episodes]
    emit(quiet, as_json, lambda: worst_document(episodes, by), commands, show)


def _worst_passages(folder: Path, by: str, most: int, quiet: bool, as_json: bool) -> None:
    """List the worst passages of a recording's conflicts; they cannot be repeated."""
    from harness.old.report.screens.conflict_tables import worst_table
    from harness.old.report.screens.console import make_console, print_table
    from harness.old.studies.conflicts import worst_passages

    rows = worst_passages(folder, by, most)
    lines = [f"{row['crosswalk']} {row['vehicle']} {row['begin_s']:g}" for row in rows]
    document = {"by": by, "passages": rows}
    emit(
        quiet,
        as_json,
        document,
        lines,
        lambda: print_table(make_console(), worst_table(rows, by)),
    )
