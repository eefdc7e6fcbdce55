"""Commands on run folders: ``replay``, ``score``, ``compare``, ``worst``, ``export``."""

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.interruption import unwinding
from harness.cli.options import JsonOption, QuietOption, settings_of
from harness.cli.output import print_json, print_line, progress_bar, say, say_traceback
from harness.errors import InputError, one_line


def replay(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A finished run folder.")],
    pair: Annotated[int, typer.Option(help="Which pair.")],
    out: Annotated[
        Path | None,
        typer.Option(help="A new folder for SUMO's output files; not with --gui.", metavar="DIR"),
    ] = None,
    cell: Annotated[int, typer.Option(help="Which cell of a sweep.")] = 0,
    arm: Annotated[str, typer.Option(help="av, human or both.")] = "both",
    gui: Annotated[
        bool, typer.Option("--gui", help="Show it in sumo-gui, both arms one after the other.")
    ] = False,
    pace: Annotated[
        float | None, typer.Option(help="With --gui: 1 (default) is real time, 4 four times it.")
    ] = None,
    screenshots: Annotated[
        Path | None,
        typer.Option(help="With --gui: a new folder for pictures (PNG).", metavar="DIR"),
    ] = None,
    every: Annotated[
        float | None,
        typer.Option(help="With --screenshots: seconds between two of them; default 0.5."),
    ] = None,
    in_this_process: Annotated[
        bool,
        typer.Option(
            "--debug", help="In this process, without limits: breakpoint() stops in decide."
        ),
    ] = False,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run one episode again: with SUMO's outputs, or in sumo-gui."""
    from harness.encounter import Arm

    if arm not in ("av", "human", "both"):
        raise InputError(f"--arm {arm}", "no such arm", "av, human or both")
    arms = list(Arm) if arm == "both" else [Arm(arm)]
    if gui:
        if out is not None:
            raise InputError("--out", "stands beside --gui", "--screenshots DIR")
        if in_this_process:
            allowed = "--gui alone, which runs in this process, too: breakpoint() stops in decide"
            raise InputError("--debug", "stands beside --gui", allowed)
        if every is not None and screenshots is None:
            raise InputError("--every", "goes with --screenshots", "--screenshots DIR")
        from harness.replay.watch import watch

        with unwinding():
            watched = watch(
                run_folder,
                pair,
                arms,
                cell,
                pace=1.0 if pace is None else pace,
                screenshots=screenshots,
                every_s=0.5 if every is None else every,
            )
        names = [(f"pair {pair}, arm {one.arm}", one.differences) for one in watched]
        _compare(names, [], quiet, as_json)
        return
    for option, value in (("--pace", pace), ("--screenshots", screenshots), ("--every", every)):
        if value is not None:
            raise InputError(option, "goes with --gui", "--gui")
    if in_this_process:
        if out is not None:
            raise InputError("--out", "stands beside --debug", "one of the two")
        from harness.replay.rerun import debug

        repeated = debug(run_folder, pair, arms, cell)
        for one in repeated.values():
            say_traceback(one.traceback)
        names = [(f"pair {pair}, arm {arm}", one.differences) for arm, one in repeated.items()]
        _compare(names, [], quiet, as_json)
        return
    if out is None:
        allowed = "a new folder for SUMO's files, --gui or --debug"
        raise InputError("--out", "is missing", allowed)
    from harness.replay.rerun import replay as run_again

    with unwinding():
        replayed = run_again(run_folder, pair, arms, cell, out)
    for again in replayed:
        say_traceback(again.traceback)
    problems = [f"{one.folder}: {one.problem}" for one in replayed if one.problem is not None]
    if problems:
        say(one_line(f"harness: {'; '.join(problems)}; SUMO's files are cut off"))
    done = [(str(one.folder), one.differences) for one in replayed if one.problem is None]
    _compare(done, problems, quiet, as_json)


def _compare(
    episodes: list[tuple[str, tuple[str, ...]]],
    problems: list[str],
    quiet: bool,
    as_json: bool,
) -> None:
    """Say of each repeated episode whether it came out as stored."""
    if as_json:
        told = [{"episode": name, "differences": list(found)} for name, found in episodes]
        print_json({"episodes": told, "problems": problems})
    for name, differences in [] if as_json else episodes:
        verdict = "differs from" if differences else "is identical to"
        print_line(name if quiet else f"{name}: the record {verdict} the stored one")
        for difference in [] if quiet else differences:
            print_line(f"    {difference}")
    if problems or any(differences for _, differences in episodes):
        raise typer.Exit(1)


def score(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run with --traces.")],
    out: Annotated[Path, typer.Option(help="A new folder for the recomputed run.")],
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Another threshold, e.g. --set conflicts.ttc_s=2; needs no traces. Repeatable.",
            metavar="KEY=VALUE",
        ),
    ] = None,
    quiet: QuietOption = False,  # noqa: ARG001  # the path is all it prints anyway
    as_json: JsonOption = False,
) -> None:
    """Recompute measures from kept traces, or count other conflicts."""
    from harness.batch.scoring import score as recompute

    with unwinding():
        folder = str(recompute(run_folder, out, settings_of(settings)))
    if as_json:
        print_json({"folder": folder})
    else:
        print_line(folder)


def compare(
    run_folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN…", help="A finished sweep, or several finished runs of the same people."
        ),
    ],
    mu0: Annotated[
        float | None, typer.Option(help="μ has to lie below; default: limits.mu0 of the scenario.")
    ] = None,
    kappa0: Annotated[
        float | None, typer.Option(help="κ has to lie below; default: limits.kappa0.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Write the comparisons to a new CSV file.", metavar="FILE"),
    ] = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Compare strategies pair by pair, within or between runs.

    With limits, say which values of a parameter keep them.
    """
    from harness.runs.compare import compare as compare_run

    if out is not None:
        if out.exists():
            raise InputError(f"--out {out}", "exists already", "a new file")
        if not out.parent.is_dir():
            raise InputError(f"--out {out}", f"there is no folder {out.parent}", "a new file")
    with progress_bar("comparisons", hidden=quiet or as_json) as advance:
        result = compare_run(*run_folders, mu0=mu0, kappa0=kappa0, progress=advance)
    if out is not None:
        from harness.files import write_csv
        from harness.report.comparison_document import comparison_rows

        write_csv(out, comparison_rows(result))
    if as_json:
        from harness.report.comparison_document import comparison_document

        print_json(comparison_document(result))
    elif quiet:
        if out is not None:
            print_line(str(out))
    else:
        from harness.report.terminal import print_comparison

        print_comparison(result)


def worst(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A finished run folder.")],
    by: Annotated[
        str,
        typer.Option(help="A measure of which one end is bad, e.g. min_ttc_s, delay_s, stops."),
    ] = "pet_s",
    most: Annotated[int, typer.Option("-n", help="How many.", metavar="N")] = 20,
    diff: Annotated[
        Path | None,
        typer.Option(
            help="Another finished run of the same people: those that are worse there than in RUN.",
            metavar="RUN_B",
        ),
    ] = None,
    arm: Annotated[str, typer.Option(help="av or human.")] = "av",
    cell: Annotated[int | None, typer.Option(help="Of that cell alone.")] = None,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print the commands that replay them alone.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """List the worst episodes, with commands that replay them."""
    from harness.report.worst_tables import worst_document, worst_tables
    from harness.runs.worst import got_worse, worst as worst_of

    if diff is None:
        found = worst_of(run_folder, by, most, arm, cell)
    else:
        found = got_worse(diff, run_folder, by, most, arm, cell)
    if as_json:
        print_json(worst_document(found, by))
    elif quiet:
        print_line("\n".join(episode.command for episode in found))
    else:
        from harness.report.console import make_console, print_table

        console = make_console()
        print_table(console, worst_tables(found, by))
        for episode in found:
            console.print(episode.command, soft_wrap=True)


def export(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
    csv: Annotated[bool, typer.Option("--csv", help="Write every table as CSV.")] = False,
    quiet: QuietOption = False,  # noqa: ARG001  # paths are all it prints anyway
    as_json: JsonOption = False,
) -> None:
    """Write the tables of a run folder as CSV, beside the originals."""
    from harness.runs.export import export_csv

    if not csv:
        raise InputError("export", "no format given", "--csv")
    with unwinding():
        files = [str(path) for path in export_csv(run_folder)]
    if as_json:
        print_json({"files": files})
    else:
        print_line("\n".join(files))
