"""``risk``: how rare an event is, down to one in a hundred million episodes."""

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.interruption import unwinding
from harness.cli.options import (
    FullOption,
    JsonOption,
    OutOption,
    QuietOption,
    ScenarioArgument,
    SeedOption,
    SetOption,
    WorkersOption,
    settings_of,
)
from harness.cli.output import print_json, print_line, progress_bar, say
from harness.errors import InputError, unknown_name


def risk(
    scenario: ScenarioArgument,
    arm: Annotated[str, typer.Option(help="Whose episodes: av or human.")] = "av",
    event: Annotated[
        str,
        typer.Option(
            help="crashed, or a measure below or above a limit: 'min_ttc_s<0.5', "
            "'contact_speed_mps>5'.",
        ),
    ] = "crashed",
    target_cv: Annotated[
        float, typer.Option(help="Wanted standard error over the probability.")
    ] = 0.1,
    engine: Annotated[
        str,
        typer.Option(
            help="plain: fast, one episode in a hundred and every event of the estimate are "
            "checked in SUMO; sumo: all in SUMO."
        ),
    ] = "plain",
    most_episodes: Annotated[
        int, typer.Option(help="At most so many independent episodes of the estimate.")
    ] = 200_000,
    out: OutOption = None,
    seed: SeedOption = None,
    settings: SetOption = None,
    workers: WorkersOption = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
    full: FullOption = False,
) -> None:
    """Estimate the probability of a rare event of an episode."""
    from harness.encounter import Arm
    from harness.scenario import engine_named, read_scenario_file, study_of

    arms = [member.value for member in Arm]
    if arm not in arms:
        raise unknown_name("--arm", "arm", arm, arms)
    in_sumo = engine_named(engine, "--engine") == "sumo"
    study = study_of(read_scenario_file(scenario, settings_of(settings, None, seed)))
    if len(study.cells) > 1:
        allowed = (
            f"one cell: --set {' --set '.join(f'{key}=…' for key in sorted(study.varied_keys))}"
        )
        raise InputError(scenario, f"has {len(study.cells)} cells", allowed)
    if study.remark is not None:
        say(f"harness: {study.remark}")
    chosen = study.cells[0].scenario
    from harness.risk.asking import Settings
    from harness.risk.folder import estimate_risk

    question = Settings(study.name, chosen, Arm(arm), event, target_cv, most_episodes, in_sumo)
    with progress_bar("exploring", quiet or as_json) as advance, unwinding():
        folder = estimate_risk(question, out=out, workers=workers, progress=advance)
    show(folder, quiet, as_json, full)


def is_risk(folder: Path) -> bool:
    """Whether a folder holds a risk, not a run."""
    from harness.risk.folder import ASKED

    return (folder / ASKED).is_file()


def go_on_with_risk(
    folder: Path, workers: int | None, dask: str | None, quiet: bool, as_json: bool, full: bool
) -> None:
    """Go on with a risk that was interrupted; a finished one is only shown."""
    from harness.risk.folder import resume_risk

    if dask is not None:
        raise InputError("--dask", "cannot go on with a risk", "this machine's workers")
    with progress_bar("exploring", quiet or as_json) as advance, unwinding():
        resume_risk(folder, workers=workers, progress=advance)
    show(folder, quiet, as_json, full)


def report_risk(
    folder: Path, out: Path | None, figures: Path | None, quiet: bool, as_json: bool
) -> Path:
    """Write the page of a finished risk."""
    from harness.report.risk_page import write_risk_page

    if figures is not None:
        raise InputError(f"--figures {figures}", "a risk has no figures", "no --figures")
    page = write_risk_page(folder, out)
    if as_json:
        print_json({"page": str(page)})
    else:
        print_line(str(page) if quiet else f"Report: {page}")
    return page


def show(folder: Path, quiet: bool, as_json: bool, full: bool) -> None:
    """Print the findings of a finished risk.

    Raises:
        typer.Exit: with code 1 where episodes failed, or differed between the engines.
    """
    from harness.report.risk_terminal import print_risk
    from harness.risk.folder import read_risk
    from harness.risk.writing import risk_document

    findings = read_risk(folder)
    if as_json:
        print_json(risk_document(findings))
    elif quiet:
        print_line(str(folder))
    else:
        print_risk(findings, folder, full)
    if findings.failed or findings.differing:
        raise typer.Exit(1)
