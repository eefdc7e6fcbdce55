"""``risk``: estimates event probabilities down to one in a hundred million episodes."""

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from harness.core.errors import InputError
from harness.old.cli import options
from harness.old.cli.interruption import unwinding
from harness.old.cli.output import emit, progress_bar, say


def risk(
    scenario: options.ScenarioArgument,
    arm: options.ArmOption = "av",
    event: Annotated[
        str,
        typer.Option(
            help="The event: crashed, or a measure below or above a limit: 'min_ttc_s<0.5', "
            "'contact_speed_mps>5'.",
        ),
    ] = "crashed",
    target_cv: Annotated[
        float, typer.Option(help="Target of the standard error divided by the probability.")
    ] = 0.1,
    engine: Annotated[
        Literal["sumo", "plain"],
        typer.Option(help="plain: the same kinematics, faster. sumo: every episode runs in SUMO."),
    ] = "plain",
    most_episodes: Annotated[
        int, typer.Option(help="Maximum number of independent episodes in the estimate.")
    ] = 200_000,
    out: options.OutOption = None,
    seed: options.SeedOption = None,
    settings: options.SetOption = None,
    workers: options.WorkersOption = None,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
    full: options.FullOption = False,
) -> None:
    """Estimate how probable a rare event is in an episode."""
    from harness.core.encounter import Arm
    from harness.scenario import read_scenario_file, study_of

    study = study_of(read_scenario_file(scenario, options.settings_of(settings, None, seed)))
    if len(study.cells) > 1:
        settled = "".join(f" --set {key}=…" for key in sorted(study.varied_keys))
        raise InputError(scenario, f"has {len(study.cells)} cells", f"one cell:{settled}")
    if study.remark is not None:
        say(f"harness: {study.remark}")
    from harness.old.studies.risk.asking import Settings
    from harness.old.studies.risk.folder import estimate_risk

    scope = target_cv, most_episodes, engine == "sumo"
    question = Settings(study.name, study.cells[0].scenario, Arm(arm), event, *scope)
    with progress_bar("exploring", quiet or as_json) as advance, unwinding():
        folder = estimate_risk(question, out=out, workers=workers, progress=advance)
    show(folder, full, quiet, as_json)


def resume_risk(
    folder: Path, workers: int | None, dask: str | None, full: bool, quiet: bool, as_json: bool
) -> None:
    """Continue an interrupted risk estimate; a finished one is only printed."""
    from harness.old.studies.risk.folder import resume_risk as resume

    if dask is not None:
        problem = "is not supported with a risk estimate"
        raise InputError("--dask", problem, "this machine's workers")
    with progress_bar("exploring", quiet or as_json) as advance, unwinding():
        resume(folder, workers=workers, progress=advance)
    show(folder, full, quiet, as_json)


def report_risk(
    folder: Path, out: Path | None, figures: Path | None, quiet: bool, as_json: bool
) -> Path:
    """Write the page of a finished risk estimate."""
    from harness.old.report.pages.risk_page import write_risk_page
    from harness.old.studies.risk.folder import read_risk

    if figures is not None:
        raise InputError(f"--figures {figures}", "a risk estimate has no figures", "no --figures")
    read_risk(folder)
    with unwinding():
        page = write_risk_page(folder, out)
    emit(quiet, as_json, {"page": str(page)}, [page if quiet else f"Report: {page}"])
    return page


def show(folder: Path, full: bool, quiet: bool, as_json: bool) -> None:
    """Print a finished estimate; exit with 1 if episodes failed."""
    from harness.old.report.screens.risk_terminal import print_risk
    from harness.old.studies.risk.folder import read_risk
    from harness.old.studies.risk.writing import risk_document

    findings = read_risk(folder)
    screen = partial(print_risk, findings, folder, full)
    emit(quiet, as_json, partial(risk_document, findings), [folder], screen)
    if findings.failed:
        raise typer.Exit(1)
