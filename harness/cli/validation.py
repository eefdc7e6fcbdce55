"""``validate``: compares drivers with recorded encounters, and people with measured decisions."""

from pathlib import Path
from typing import Annotated

import typer

from harness.cli import model_options
from harness.cli.interruption import unwinding
from harness.cli.options import (
    FullOption,
    JsonOption,
    QuietOption,
    WorkersOption,
    not_with,
    refuse_without,
)
from harness.cli.output import emit, print_line, progress_bar
from harness.core.errors import InputError

PEOPLE = "people"
"""The word in place of data that stands for the shipped figures; a folder is ``./people``."""


def validate(
    paths: Annotated[
        list[str],
        typer.Argument(
            help="Files or folders of trajectories; or the word people, for the shipped figures "
            "of measured people.",
            metavar="DATA…|people",
        ),
    ],
    format_: Annotated[
        str | None, typer.Option("--format", help="Format of the tracks, e.g. vci.")
    ] = None,
    drivers: Annotated[
        str | None,
        typer.Option(
            help="Strategies to validate, e.g. human_gmm,human_yield,emergency_brake; with people "
            "the default is human_yield.",
            metavar="NAME,…",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the HTML page and its JSON.", metavar="DIR"),
    ] = None,
    folds: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Number of folds of vehicles, default 5. A model that was fitted to the same data "
            "is fitted again without each fold. With 0 the model is used as it is.",
        ),
    ] = None,
    behaviour: Annotated[
        str | None,
        typer.Option(
            help="With people: how pedestrians decide; default threshold.", metavar="NAME"
        ),
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option(min=1, help="With people: simulated trials of each cell; default 1000."),
    ] = None,
    hours: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="With people: simulated hours of each measured site; default 6. With 0 the sites "
            "are left out.",
        ),
    ] = None,
    without_zebra: Annotated[
        bool,
        typer.Option(
            "--without-zebra",
            help="With people: driver and pedestrian meet where no zebra crossing is.",
        ),
    ] = False,
    seed: Annotated[int | None, typer.Option(min=0, help="With people: seed; default 1.")] = None,
    workers: WorkersOption = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Change a scenario key (--set strategies.human_gmm.speed=sampled, --set "
            "model.path=my.json) or, without a dot, an option of `harness extract`. Repeatable.",
            metavar="KEY=VALUE",
        ),
    ] = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
    full: FullOption = False,
) -> None:
    """Compare drivers with recordings, or people with measured ones.

    Each driver replaces the recorded driver.  `harness validate people` needs no data: it simulates
    measured experiments and prints simulated beside measured numbers.
    """
    names = None if drivers is None else [name for name in drivers.split(",") if name]
    output = quiet, as_json, full
    if paths == [PEOPLE]:
        refuse_with_people(**{"format": format_, "folds": folds})
        amounts = {"trials": trials, "hours": hours, "seed": seed, "workers": workers}
        given = {key: value for key, value in amounts.items() if value is not None}
        _people(behaviour, names, settings, given, not without_zebra, out, output)
        return
    needed = {"behaviour": behaviour, "trials": trials, "hours": hours, "seed": seed}
    refuse_without(PEOPLE, False, **needed, workers=workers, **{"without-zebra": without_zebra})
    if format_ is None or names is None:
        from harness.model.trajectories import FORMATS

        missing, allowed = (
            ("--format", " or ".join(name for name, each in FORMATS.items() if each.clips))
            if format_ is None
            else ("--drivers", "e.g. human_gmm,human_yield")
        )
        raise InputError(missing, "is not given", allowed)
    folders = [Path(path) for path in paths]
    _recorded(
        folders,
        format_,
        names,
        out,
        5 if folds is None else folds,
        settings,
        (quiet, as_json, full),
    )


def refuse_with_people(**options: object) -> None:
    """Refuse options that only recorded encounters have."""
    for name, value in options.items():
        if value is not None:
            raise not_with(f"--{name}", PEOPLE, f"--{name} with recorded data (a folder: ./people)")


def _people(
    behaviour: str | None,
    drivers: list[str] | None,
    settings: list[str] | None,
    given: dict[str, int],
    zebra: bool,
    out: Path | None,
    output: tuple[bool, bool, bool],
) -> None:
    """Simulate the experiments with measured people and print the result."""
    model_options.check_folder(out, "--out")
    from harness.report.screens.people_tables import print_people
    from harness.scenario import parse_setting
    from harness.studies.validation.people import validate_people

    quiet, as_json, full = output
    changes = [parse_setting(text) for text in settings or []]
    with progress_bar("cells", quiet or as_json) as advance:
        findings = validate_people(
            behaviour or "threshold",
            ["human_yield"] if drivers is None else drivers,
            changes,
            zebra=zebra,
            progress=advance,
            **given,
        )
    written = list[Path]()
    if out is not None:
        from harness.report.pages.people_page import write_people

        with unwinding():
            written = write_people(findings, out)

    def show() -> None:
        print_people(findings, full)
        for path in written:
            print_line(f"Written: {path}")

    lines = [held.line for held in findings.held]
    emit(quiet, as_json, findings.document, written or lines, show)


def _recorded(
    paths: list[Path],
    format_: str,
    drivers: list[str],
    out: Path | None,
    folds: int,
    settings: list[str] | None,
    output: tuple[bool, bool, bool],
) -> None:
    """Let drivers drive recorded passages and print the result."""
    quiet, as_json, full = output
    model_options.check_folder(out, "--out")
    from harness.report.screens.validation_tables import print_validation
    from harness.scenario import load_scenario, parse_setting
    from harness.studies.validation import validate as run_validation

    changes = [parse_setting(text) for text in settings or []]
    scenario = load_scenario("cctc", [setting for setting in changes if "." in setting.key])
    options = {setting.key: setting.value for setting in changes if "." not in setting.key}
    with progress_bar("reading", quiet or as_json) as advance:
        validation = run_validation(
            paths, format_, drivers, scenario, folds=folds, options=options, progress=advance
        )
    findings, written = validation.findings, list[Path]()
    if out is not None:
        from harness.report.pages.validation_page import write_validation

        with unwinding():
            written = write_validation(validation, out)

    def show() -> None:
        print_validation(findings, full)
        for path in written:
            print_line(f"Written: {path}")

    names = [driver.driver for driver in findings.drivers]
    emit(quiet, as_json, findings.document, written or names, show)
