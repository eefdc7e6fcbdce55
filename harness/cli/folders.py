"""Commands that read run folders: ``show, report, compare, worst, replay, export``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from harness.cli import options
from harness.cli.encounters import print_run
from harness.cli.interruption import unwinding
from harness.cli.options import not_with, refuse_without
from harness.cli.output import emit, print_line, say, show as show_result
from harness.core.errors import InputError, one_line


def _is_old(folder: Path) -> bool:
    from harness.results.folder import kind_of_folder

    return kind_of_folder(folder) == "old"


def show(
    run_folder: options.RunArgument,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Show the screen of a run again."""
    from harness.results.run import load_run

    if _is_old(run_folder):
        from harness.old.cli.batch import resume as show_old
        from harness.old.store.reading import read_finished_manifest

        read_finished_manifest(run_folder)
        show_old(run_folder, None, None, full, quiet, as_json)
        return
    print_run(load_run(run_folder), full, quiet, as_json)


def report(
    run_folder: Annotated[
        Path, typer.Argument(metavar="RUN", help="A run folder, finished or not.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="File for the page; default RUN/report.html.", metavar="FILE"),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option(help="Folder for the figures, PNG and PDF.", metavar="DIR", file_okay=False),
    ] = None,
    mu0: options.Mu0Option = None,
    kappa0: options.Kappa0Option = None,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Write one HTML page: results, figures and a player for episodes.  It needs no network."""
    if out is not None and out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {out}", "is not an HTML file", "a file name ending in .html")
    if out is not None and not out.parent.is_dir():
        raise InputError(f"--out {out}", f"there is no folder {out.parent}", "a file to write")
    if _is_old(run_folder):
        from harness.old.cli.reporting import report as report_old

        report_old(run_folder, out, figures, open_page, quiet, as_json)
        return
    from harness.report.page import write_page
    from harness.results.run import load_run
    from harness.studies.compare import compare as compare_cells, groups_of
    from harness.studies.shown import shown_pairs

    run = load_run(run_folder)
    result = run.result()
    several = run.finished and any(len(group) > 1 for group in groups_of([run]))
    with unwinding():
        compared = compare_cells(run, mu0=mu0, kappa0=kappa0) if several else None
        shown = shown_pairs(run, out)
        written = write_page(run, result, out, figures, shown, compared)
    document = {"page": str(written.page), "figures": [str(path) for path in written.figures]}
    emit(quiet, as_json, document, [written.page], lambda: print_line(f"Report: {written.page}"))
    for pair in shown:
        for difference in pair.differences[:1]:
            where = f"cell {pair.cell} pair {pair.pair}"
            say(one_line(f"harness: {where} differs from its record: {difference}"))
    if open_page:
        import webbrowser

        webbrowser.open(written.page.resolve().as_uri())


def compare(
    run_folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN…",
            help="A finished sweep, or several finished runs with the same pedestrians.",
        ),
    ],
    mu0: options.Mu0Option = None,
    kappa0: options.Kappa0Option = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Write the comparisons to a new CSV file.", metavar="FILE"),
    ] = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Compare strategies pair by pair, within or between runs.

    With --mu0 and --kappa0 the values of a swept parameter are judged.
    """
    if out is not None and (out.exists() or not out.parent.is_dir()):
        problem = "exists already" if out.exists() else f"there is no folder {out.parent}"
        raise InputError(f"--out {out}", problem, "a new file")
    if all(map(_is_old, run_folders)):
        from harness.old.cli.review import compare as compare_old

        compare_old(run_folders, None, None, out, full, quiet, as_json)
        return
    from harness.results.run import load_run
    from harness.studies.compare import compare as compare_cells

    result = compare_cells(*map(load_run, run_folders), mu0=mu0, kappa0=kappa0)
    show_result(result, full, quiet, as_json, [out] if out else [], out)


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
    if _is_old(run_folder):
        from harness.old.cli.review import worst as worst_old

        worst_old(run_folder, by, most, None, arm, cell, quiet, as_json)
        return
    from harness.results.run import load_run
    from harness.studies.worst import worst as worst_of

    result = worst_of(load_run(run_folder), by, most, arm, cell)
    show_result(result, False, quiet, as_json, result.closing)


def replay(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A finished run folder.")],
    pair: Annotated[str, typer.Option(help="Number of the pair, or a range: 1-20.")],
    out: Annotated[
        Path | None,
        typer.Option(help="A new folder for SUMO's output files; not with --gui.", metavar="DIR"),
    ] = None,
    cell: options.CellOption = 0,
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
    debug: Annotated[
        bool,
        typer.Option(
            "--debug",
            help="Run in this process without time limits, so that breakpoint() works in decide.",
        ),
    ] = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Repeat episodes: with SUMO's outputs, or in sumo-gui."""
    pairs = _range_of(pair)
    if sum((gui, debug, out is not None)) > 1:
        raise not_with("--out", "--gui or --debug", "one of the three")
    refuse_without("--gui", gui, pace=pace, screenshots=screenshots)
    refuse_without("--screenshots DIR", screenshots is not None, every=every)
    if _is_old(run_folder):
        from harness.old.cli.review import replay as replay_old

        if len(pairs) > 1:
            raise InputError(f"--pair {pair}", "is a range", "one pair of this kind of run")
        replay_old(
            *(run_folder, pairs[0], out, cell, arm, gui, pace, screenshots, every),
            *(vehicle, crosswalk, debug, quiet, as_json),
        )
        return
    refuse_without("a run of [simulation]", False, vehicle=vehicle, crosswalk=crosswalk)
    from harness.core.encounter import Arm
    from harness.results.run import load_run
    from harness.studies import replay as again

    run, arms = load_run(run_folder), list(Arm) if arm == "both" else [Arm(arm)]
    with unwinding():
        if gui:
            from harness.studies.watch import watch

            look = (1.0 if pace is None else pace, screenshots, 0.5 if every is None else every)
            replayed = watch(run, cell, pairs, arms, *look)
        elif debug:
            replayed = again.debug(run, cell, pairs, arms)
        elif out is not None:
            replayed = again.replay(run, cell, pairs, arms, out)
        else:
            allowed = "a new folder for SUMO's files, --gui or --debug"
            raise InputError("--out", "is missing", allowed)
    _print_replayed(replayed, quiet, as_json)


def _range_of(text: str) -> range:
    """The pairs of ``7`` or ``1-20``."""
    first, dash, last = text.partition("-")
    try:
        numbers = range(int(first), int(last if dash else first) + 1)
    except ValueError:
        numbers = range(0)
    if not numbers:
        raise InputError(f"--pair {text}", "is no number or range", "e.g. 7 or 1-20")
    return numbers


def _print_replayed(replayed: "Sequence[object]", quiet: bool, as_json: bool) -> None:
    """Print for each repeated episode whether its record is identical to the stored one."""
    from harness.studies.replay import Replayed

    items = [item for item in replayed if isinstance(item, Replayed)]
    for item in items:
        if item.traceback:
            say(item.traceback.rstrip())
        if item.problem:
            say(one_line(f"harness: {item.name}: {item.problem}; SUMO's files are incomplete"))

    def listed() -> None:
        for item in items:
            if item.problem is None:
                verdict = "differs from" if item.differences else "is identical to"
                print_line(f"{item.name}: the record {verdict} the stored record")
                for difference in item.differences:
                    print_line(f"    {difference}")

    document = [
        {"episode": each.name, "differences": [*each.differences], "problem": each.problem}
        for each in items
    ]
    emit(quiet, as_json, {"episodes": document}, [each.name for each in items], listed)
    if any(item.problem or item.differences for item in items):
        raise typer.Exit(1)


def export(
    run_folder: options.RunArgument,
    csv: Annotated[bool, typer.Option("--csv", help="Write every table as CSV.")] = False,
    form: Annotated[
        Literal["openscenario", "trajectories"] | None,
        typer.Option(
            "--format",
            help="Write one arm of a pair: as OpenSCENARIO XML with its road as OpenDRIVE (pip "
            "install crosswalk-harness[export]), or as one CSV table of trajectories.",
        ),
    ] = None,
    pair: Annotated[int | None, typer.Option(help="With --format: number of the pair.")] = None,
    cell: options.CellOption = 0,
    arm: options.ArmOption = "av",
    ego: Annotated[
        Literal["recorded", "free"],
        typer.Option(
            help="With --format openscenario: the ego's recorded trajectory, or an ego without one "
            "at R0 and v0, for another driver.",
        ),
    ] = "recorded",
    vehicle: Annotated[
        str | None,
        typer.Option(help="The vehicle whose passage is written, of hours and [simulation]."),
    ] = None,
    crosswalk: Annotated[
        str | None,
        typer.Option(help="For [simulation]: the crosswalk of that passage.", metavar="ID"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="With --format: a new folder.", metavar="DIR")
    ] = None,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Write tables as CSV, or a pair for another simulator."""
    if csv and not _is_old(run_folder):
        refuse_without("--format", form is not None, pair=pair, out=out)
        from harness.results.run import load_run

        with unwinding():
            files = [str(path) for path in load_run(run_folder).write_csv()]
        emit(quiet, as_json, {"files": files}, files)
        return
    from harness.old.cli.export import export as export_old

    export_old(
        *(run_folder, csv, form, pair, cell, arm, ego, vehicle, crosswalk, out, quiet, as_json)
    )
