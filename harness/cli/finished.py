"""Commands that read folders of runs: ``show, report, compare, worst, replay, export``."""

import re
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Argument, Option

from harness.cli import options
from harness.cli.interruption import unwinding
from harness.cli.output import say, show as show_result, show_rows
from harness.core.errors import InputError, one_line
from harness.studies.defaults import MOST_EPISODES, RANKED_BY


def show(
    run_folder: options.RunArgument,
    settings: options.ThresholdOption = None,
    full: options.FullOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Print the screen of a run or risk estimate again, or with other thresholds of conflicts."""
    from harness.results.folder import read_manifest

    changes = options.changes_of(settings)
    if read_manifest(run_folder)["kind"] == "risk" and not changes:
        from harness.studies.risk.estimate import read_risk

        result = read_risk(run_folder)
    else:
        from harness.results.loaded_run import load_run

        result = load_run(run_folder, changes).result()
    show_result(result, full=full, as_json=as_json)


def report(
    run_folder: options.RunArgument,
    out: Annotated[Path | None, Option(help="The page; default RUN/report.html.")] = None,
    figures: options.FiguresOption = None,
    mu0: options.Mu0Option = None,
    kappa0: options.Kappa0Option = None,
    settings: options.ThresholdOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Write one HTML page: results, figures, a player of episodes."""
    from harness.report.page import write_report

    changes = options.changes_of(settings)
    with unwinding():
        written = write_report(run_folder, out, figures, changes, mu0=mu0, kappa0=kappa0)
    for warning in written.warnings:
        say(one_line(f"harness: {warning}"))
    files = [{"file": str(path)} for path in (written.page, *written.figures)]
    show_rows("report", files, quiet=True, as_json=as_json)


def compare(
    run_folders: Annotated[list[Path], Argument(metavar="RUN…", help="Runs with the same people.")],
    mu0: options.Mu0Option = None,
    kappa0: options.Kappa0Option = None,
    out: options.TableOption = None,
    settings: options.ThresholdOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Compare strategies pair by pair, within a run or between runs.

    With --mu0 and --kappa0 the values of a swept parameter are judged.
    """
    from harness.core.files import check_target, write_csv
    from harness.results.loaded_run import load_run
    from harness.studies.comparison import compare as compare_cells

    if out is not None:
        check_target(out)
    runs = map(partial(load_run, settings=options.changes_of(settings)), run_folders)
    result = compare_cells(*runs, mu0=mu0, kappa0=kappa0)
    if out is not None:
        from harness.results.result import flat

        write_csv(out, [flat(record) for record in result.records])
    show_result(result, [out] if out else [], full=full, quiet=quiet, as_json=as_json)


def worst(
    run_folder: options.RunArgument,
    by: options.ByOption = RANKED_BY,
    most: Annotated[int, Option("-n", help="Number of episodes.", metavar="N")] = MOST_EPISODES,
    arm: options.ArmOption = "av",
    cell: Annotated[int | None, Option(help="List only this cell.")] = None,
    driver: options.DriverOption = None,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """List the worst episodes or passages, with commands to replay."""
    from harness.results.loaded_run import load_run
    from harness.studies.worst import worst as worst_of

    result = worst_of(load_run(run_folder), by, most, arm=arm, cell=cell, driver=driver)
    replays = dict.fromkeys(record["replay"] for record in result.records)
    show_result(result, replays, quiet=quiet, as_json=as_json)


def replay(
    run_folder: options.RunArgument,
    pair: Annotated[str, Option(help="Number of the pair, or a range: 1-20.")],
    out: options.NewFolderOption = None,
    cell: options.CellOption = 0,
    arm: Annotated[Literal["av", "human", "both"], Option(help="Which arm.")] = "both",
    gui: options.GuiOption = False,
    debug: options.DebugOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Simulate episodes again, with SUMO's outputs or in sumo-gui."""
    if (given := sum((gui, debug, out is not None))) != 1:
        problem = "cannot be combined" if given else "one is missing"
        raise InputError("--out, --gui, --debug", problem, "one of the three")
    from harness.core.vocabulary import Arm
    from harness.results.loaded_run import load_run
    from harness.studies.running import replay as again

    pairs, arms = _range_of(pair), list(Arm) if arm == "both" else [Arm(arm)]
    run = load_run(run_folder)
    with unwinding():
        if gui:
            replayed = again.watch(run, cell, pairs, arms)
        elif out is None:
            replayed = again.debug(run, cell, pairs, arms)
        else:
            replayed = again.replay(run, cell, pairs, arms, out)
    for traceback in filter(None, (each.traceback for each in replayed)):
        say(traceback.rstrip())
    show_rows("replay", [each.row for each in replayed], as_json=as_json)
    if any(each.problem or each.differences for each in replayed):
        raise typer.Exit(1)


def _range_of(text: str) -> range:
    """The pairs of ``7`` or ``1-20``."""
    found = re.fullmatch(r"(\d+)(?:-(\d+))?", text)
    numbers = range(int(found[1]), int(found[2] or found[1]) + 1) if found else range(0)
    if not numbers:
        raise InputError(f"--pair {text}", "is no number or range", "e.g. 7 or 1-20")
    return numbers


def export(
    run_folder: options.RunArgument,
    pair: Annotated[int, Option(help="Number of the pair.")],
    out: Annotated[Path, Option(help="A new folder for the files.")],
    cell: options.CellOption = 0,
    arm: options.ArmOption = "av",
    passage: options.PassageOption = None,
    ego: options.EgoOption = "recorded",
    as_json: options.JsonOption = False,
) -> None:
    """Write an arm of a pair as OpenSCENARIO and OpenDRIVE."""
    from harness.core.vocabulary import Arm
    from harness.results.loaded_run import load_run
    from harness.studies.export import export as write

    run = load_run(run_folder)
    with unwinding():
        files, differences = write(
            run, cell, pair, Arm(arm), out, passage=passage, free=ego == "free"
        )
    for difference in differences:
        say(one_line(f"harness: pair {pair} differs from its record: {difference}"))
    show_rows("export", [{"file": str(path)} for path in files], quiet=True, as_json=as_json)
    if differences:
        raise typer.Exit(1)
