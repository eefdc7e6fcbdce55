"""``tune``: searches a strategy's parameters under limits."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from harness.cli import options
from harness.cli.interruption import unwinding
from harness.cli.output import emit, print_line, progress_bar
from harness.core.errors import InputError

if TYPE_CHECKING:
    from harness.studies.tuning.folder import Judged, Search


def tune(
    scenario: options.ScenarioArgument,
    parameter: Annotated[
        list[str],
        typer.Option(
            help="A key to search and its range, e.g. strategies.gap_yield.critical_gap_s=0:4; "
            "with :int whole numbers, with :log on a logarithmic scale. Repeatable.",
            metavar="KEY=LOW:HIGH",
        ),
    ],
    minimise: Annotated[
        str | None, typer.Option(help="The number to minimise, e.g. delay_s.", metavar="NUMBER")
    ] = None,
    maximise: Annotated[
        str | None, typer.Option(help="The number to maximise instead.", metavar="NUMBER")
    ] = None,
    subject_to: Annotated[
        list[str] | None,
        typer.Option(help="A limit on a number, e.g. 'kappa<1e-3'. Repeatable.", metavar="LIMIT"),
    ] = None,
    trials: Annotated[int, typer.Option(min=1, help="Number of candidates to try.")] = 100,
    fresh: Annotated[
        int, typer.Option(min=1, help="Number of pairs that judge the best candidate.")
    ] = 3000,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for trials.jsonl, result.json, report.html and best.toml, the best "
            "candidate's scenario; default runs/<scenario>-tune-<next number>.",
            metavar="DIR",
        ),
    ] = None,
    pairs: options.PairsOption = None,
    seed: options.SeedOption = None,
    settings: options.SetOption = None,
    engine: Annotated[
        Literal["sumo", "plain"],
        typer.Option(help="plain: the same kinematics, faster; nothing is repeated in SUMO."),
    ] = "sumo",
    workers: options.WorkersOption = None,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Search parameters that minimise a number under limits.

    The best candidate is judged on fresh pairs.  The limits are those of --subject-to and of the
    scenario's limits.subject_to.
    """
    from harness.scenario import Setting, read_scenario_file, study_of
    from harness.statistics.limits import named, parse_limit
    from harness.store.kinds import limits_of
    from harness.studies.tuning.folder import NAMES, Search
    from harness.studies.tuning.search import Goal, import_optuna, parse_parameter
    from harness.studies.tuning.tune import tune as search_for

    import_optuna()
    if (minimise is None) == (maximise is None):
        raise InputError("--minimise", "one number is searched", "--minimise or --maximise")
    objective = named(minimise or maximise or "", NAMES, "--minimise" if minimise else "--maximise")
    limits = [parse_limit(text, NAMES, "--subject-to") for text in subject_to or []]
    searched = tuple(map(parse_parameter, parameter))
    if len({each.key for each in searched}) < len(searched):
        raise InputError("--parameter", "a key is searched twice", "each key once")
    file = read_scenario_file(scenario, options.settings_of(settings, pairs, seed))
    limits += limits_of(file.scenario())
    goal = Goal(objective, "minimize" if minimise else "maximize", tuple(dict.fromkeys(limits)))
    middle = [
        Setting(each.key, each.low if not each.whole else int(each.low), "--parameter")
        for each in searched
    ]
    # Refuses parameters of strategies that do not drive, and scenarios with a sweep.
    study = study_of(replace(file, settings=(*file.settings, *middle)))
    if len(study.cells) > 1:
        raise InputError(scenario, f"has {len(study.cells)} cells", "one cell")
    planned = file.scenario().experiment.pairs
    search = Search(file, searched, goal, trials, planned, fresh, engine)
    with progress_bar("trials", quiet or as_json) as advance, unwinding():
        judged = search_for(search, out=out, workers=workers, progress=advance)

    _show(search, judged, quiet, as_json)


def resume_search(
    folder: Path, workers: int | None, dask: str | None, full: bool, quiet: bool, as_json: bool
) -> None:
    """Continue an interrupted search to the same trials; a finished one is only printed."""
    from harness.studies.tuning.tune import resume_tune

    for option, given in (("--dask", dask is not None), ("--full", full)):
        if given:
            raise InputError(option, "is not supported with a search", f"no {option}")
    with progress_bar("trials", quiet or as_json) as advance, unwinding():
        search, judged = resume_tune(folder, workers=workers, progress=advance)
    _show(search, judged, quiet, as_json)


def report_search(
    folder: Path, out: Path | None, figures: Path | None, quiet: bool, as_json: bool
) -> Path:
    """Write the page of a finished search."""
    from harness.report.pages.tune_page import write_tune_page
    from harness.studies.tuning.folder import read_judged, read_search

    search = read_search(folder)
    page = write_tune_page(search, read_judged(folder, search), out, figures)
    emit(quiet, as_json, {"page": str(page)}, [page if quiet else f"Report: {page}"])
    return page


def _show(search: "Search", judged: "Judged", quiet: bool, as_json: bool) -> None:
    """Write the page of a search and print its result; exit with 1 if an episode failed."""
    from harness.report.pages.tune_page import write_tune_page
    from harness.studies.tuning.folder import result_document

    page = write_tune_page(search, judged)

    def show() -> None:
        from harness.report.screens.console import make_console
        from harness.report.screens.tune_screen import tune_lines

        for line in tune_lines(search, judged, make_console().width):
            print_line(line)
        print_line(f"Page: {page}")

    emit(quiet, as_json, lambda: result_document(judged), [judged.folder], show)
    if judged.any_failed:
        raise typer.Exit(1)
