"""``validate``: compares drivers with recorded encounters."""

from pathlib import Path
from typing import Annotated

import typer

from harness.core.errors import InputError
from harness.old.cli.interruption import unwinding
from harness.old.cli.options import FullOption, JsonOption, QuietOption
from harness.old.cli.output import emit, print_line, progress_bar


def validate(
    paths: Annotated[
        list[Path],
        typer.Argument(help="Files or folders of trajectories.", metavar="DATA…"),
    ],
    format_: Annotated[
        str | None, typer.Option("--format", help="Format of the tracks, e.g. vci.")
    ] = None,
    drivers: Annotated[
        str | None,
        typer.Option(
            help="Strategies to validate, e.g. human_gmm,human_yield,emergency_brake.",
            metavar="NAME,…",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the HTML page and its JSON.", metavar="DIR"),
    ] = None,
    folds: Annotated[
        int,
        typer.Option(
            min=0,
            help="Number of folds of vehicles. A model that was fitted to the same data is fitted "
            "again without each fold. With 0 the model is used as it is.",
        ),
    ] = 5,
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
    """Compare drivers with recordings.

    Each driver replaces the recorded driver.
    """
    if format_ is None or drivers is None:
        from harness.model.trajectories import FORMATS

        missing, allowed = (
            ("--format", " or ".join(name for name, each in FORMATS.items() if each.clips))
            if format_ is None
            else ("--drivers", "e.g. human_gmm,human_yield")
        )
        raise InputError(missing, "is not given", allowed)
    from harness.old.report.screens.validation_tables import print_validation
    from harness.old.studies.validation import validate as run_validation
    from harness.scenario import load_scenario, parse_setting

    chosen = [name for name in drivers.split(",") if name]
    changes = [parse_setting(text) for text in settings or []]
    scenario = load_scenario("cctc", [setting for setting in changes if "." in setting.key])
    options = {setting.key: setting.value for setting in changes if "." not in setting.key}
    with progress_bar("reading", quiet or as_json) as advance:
        validation = run_validation(
            paths, format_, chosen, scenario, folds=folds, options=options, progress=advance
        )
    findings, written = validation.findings, list[Path]()
    if out is not None:
        from harness.old.report.pages.validation_page import write_validation

        with unwinding():
            written = write_validation(validation, out)

    def show() -> None:
        print_validation(findings, full)
        for path in written:
            print_line(f"Written: {path}")

    names = [driver.driver for driver in findings.drivers]
    emit(quiet, as_json, findings.document, written or names, show)
