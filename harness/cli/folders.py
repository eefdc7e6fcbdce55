"""Commands that read folders of runs: ``show, report, compare, worst, replay, export``."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from typer import Argument, Option

from harness.cli import options
from harness.cli.interruption import unwinding
from harness.cli.output import say, show as show_result, show_rows
from harness.core.errors import HarnessError, InputError, one_line

if TYPE_CHECKING:
    from harness.results.result import Result

_MOST_DIFFERENCES = 3
"""Differences of a replay from its record that are printed."""


def show(
    run_folder: options.RunArgument,
    full: options.FullOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Print the screen of a run or risk estimate again."""
    show_result(_result_of(run_folder), full, False, as_json)


def _result_of(folder: Path) -> "Result":
    """The result of a run or a risk."""
    if _is_risk(folder):
        from harness.studies.risk import read_risk

        return read_risk(folder)
    from harness.results.run import load_run

    return load_run(folder).result()


def _is_risk(folder: Path) -> bool:
    from harness.results.folder import read_manifest

    return bool(read_manifest(folder)["kind"] == "risk")


def report(
    run_folder: options.RunArgument,
    out: Annotated[Path | None, Option(help="The page; default RUN/report.html.")] = None,
    figures: options.FiguresOption = None,
    mu0: options.Mu0Option = None,
    kappa0: options.Kappa0Option = None,
    as_json: options.JsonOption = False,
) -> None:
    """Write one HTML page: results, figures, a player of episodes."""
    from harness.report.page import write_page
    from harness.results.run import load_run
    from harness.results.tables import EVENTS
    from harness.studies.allowed import allowed_in
    from harness.studies.candidates import groups_of
    from harness.studies.compare import compare as compare_cells
    from harness.studies.shown import shown_pairs

    result, out = _result_of(run_folder), out or run_folder / "report.html"
    if (risk := _is_risk(run_folder)) and not result.closing:
        allowed = "a risk with events; `harness show` has the numbers of this one"
        raise InputError(str(run_folder), "no episode ended in the event", allowed)
    run = load_run(run_folder / EVENTS if risk else run_folder)
    with unwinding():
        groups = groups_of([run]) if run.finished else []
        several = any(len(group) > 1 for group in groups)
        compared = compare_cells(run, mu0=mu0, kappa0=kappa0) if several else None
        judged = allowed_in(groups, mu0, kappa0, run.confidence)
        try:
            shown = shown_pairs(run) if run.kind == "encounters" else []
        except HarnessError as error:
            shown = []
            say(one_line(f"harness: the page shows no episodes: {error}"))
        written = write_page(run, result, out, figures, shown, compared, judged)
    for pair in shown:
        for difference in pair.differences[:1]:
            where = f"cell {pair.cell} pair {pair.pair}"
            say(one_line(f"harness: {where} differs from its record: {difference}"))
    files = [{"file": str(path)} for path in (written.page, *written.figures)]
    show_rows("report", files, True, as_json)


def compare(
    run_folders: Annotated[list[Path], Argument(metavar="RUN…", help="Runs with the same people.")],
    mu0: options.Mu0Option = None,
    kappa0: options.Kappa0Option = None,
    out: options.TableOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Compare strategies pair by pair, within a run or between runs.

    With --mu0 and --kappa0 the values of a swept parameter are judged.
    """
    from harness.results.run import load_run
    from harness.studies.compare import compare as compare_cells

    result = compare_cells(*map(load_run, run_folders), mu0=mu0, kappa0=kappa0)
    if out is not None:
        from harness.core.files import write_csv
        from harness.results.result import flat

        write_csv(out, [flat(record) for record in result.records])
    show_result(result, full, quiet, as_json, [out] if out else [])


def worst(
    run_folder: options.RunArgument,
    by: options.ByOption = "pet_s",
    most: Annotated[int, Option("-n", help="Number of episodes.", metavar="N")] = 20,
    arm: options.ArmOption = "av",
    cell: Annotated[int | None, Option(help="List only this cell.")] = None,
    driver: options.DriverOption = None,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """List the worst episodes or passages, with commands to replay."""
    from harness.results.run import load_run
    from harness.studies.worst import worst as worst_of

    result = worst_of(load_run(run_folder), by, most, arm, cell, driver)
    show_result(result, False, quiet, as_json, result.closing)


def replay(
    run_folder: options.RunArgument,
    pair: Annotated[str, Option(help="Number of the pair, or a range: 1-20.")],
    out: options.NewFolderOption = None,
    cell: options.CellOption = 0,
    arm: Annotated[Literal["av", "human", "both"], Option(help="Which arm.")] = "both",
    gui: options.GuiOption = False,
    screenshots: Annotated[Path | None, Option(help="With --gui: a new folder for PNGs.")] = None,
    debug: options.DebugOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Simulate episodes again, with SUMO's outputs or in sumo-gui."""
    if sum((gui, debug, out is not None)) > 1:
        raise InputError("--out, --gui, --debug", "cannot be combined", "one of the three")
    if screenshots is not None and not gui:
        raise InputError("--screenshots", "needs --gui", "--gui")
    from harness.core.encounter import Arm
    from harness.results.run import load_run
    from harness.studies import replay as again

    chosen = cell, _range_of(pair), list(Arm) if arm == "both" else [Arm(arm)]
    run = load_run(run_folder)
    with unwinding():
        if gui:
            from harness.studies.watch import watch

            replayed = watch(run, *chosen, screenshots=screenshots)
        elif debug:
            replayed = again.debug(run, *chosen)
        elif out is not None:
            replayed = again.replay(run, *chosen, out)
        else:
            allowed = "a new folder for SUMO's files, --gui or --debug"
            raise InputError("--out", "is missing", allowed)
    for traceback in filter(None, (each.traceback for each in replayed)):
        say(traceback.rstrip())
    rows = [
        {
            "episode": each.name,
            "record": each.problem or ("differs" if each.differences else "is the stored one"),
            "differences": "; ".join(each.differences[:_MOST_DIFFERENCES]),
        }
        for each in replayed
    ]
    show_rows("replay", rows, False, as_json)
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
    from harness.core.encounter import Arm
    from harness.results.run import load_run
    from harness.studies.export import export as write

    run = load_run(run_folder)
    with unwinding():
        files, differences = write(run, cell, pair, Arm(arm), out, passage, ego == "free")
    for difference in differences:
        say(one_line(f"harness: pair {pair} differs from its record: {difference}"))
    show_rows("export", [{"file": str(path)} for path in files], True, as_json)
    if differences:
        raise typer.Exit(1)
