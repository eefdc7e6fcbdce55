"""The command ``export``: tables, and pairs for other tools."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from harness.core.errors import InputError
from harness.old.cli import options
from harness.old.cli.interruption import unwinding
from harness.old.cli.options import not_with, refuse_without
from harness.old.cli.output import emit, print_line


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
    cell: Annotated[int, typer.Option(help="Number of the cell in a sweep.")] = 0,
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
        typer.Option(
            help="The vehicle whose passage is written: in an hour of traffic its number; in "
            "[simulation] its id, by default the most striking passage.",
            metavar="ID",
        ),
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
    """Write tables as CSV, or a pair for another simulator.

    A pair has the trajectories of one arm, and for OpenSCENARIO its road.
    """
    if csv and form is not None:
        raise not_with("--csv", "--format", "one of the two")
    given = {"pair": pair, "vehicle": vehicle, "crosswalk": crosswalk, "out": out}
    refuse_without("--format", form is not None, **given)
    free = ego == "free"
    refuse_without("--format openscenario", form == "openscenario", ego=free)
    if form is not None:
        if pair is None or out is None:
            missing = "--pair" if pair is None else "--out"
            raise InputError(missing, "is missing", f"{missing} with --format {form}")
        from harness.core.encounter import Arm
        from harness.old.studies.export.exporting import export_pair
        from harness.old.studies.export.scenes import Wanted

        with unwinding():
            wanted = Wanted(Arm(arm), vehicle, crosswalk, free)
            exported = export_pair(run_folder, cell, pair, wanted, form, out)
        _report(exported.files, exported.differences, quiet, as_json)
    elif csv:
        from harness.old.studies.runs.export import export_csv

        with unwinding():
            files = [str(path) for path in export_csv(run_folder)]
        emit(quiet, as_json, {"files": files}, files)
    else:
        raise InputError("export", "no format given", "--csv or --format")


def _report(
    paths: tuple[Path, ...], differences: tuple[str, ...] | None, quiet: bool, as_json: bool
) -> None:
    """Print the files, and whether a pair that was simulated again has its stored record."""
    files = [str(path) for path in paths]

    def show() -> None:
        for file in files:
            print_line(file)
        if differences is not None:
            verdict = "differs from" if differences else "is identical to"
            print_line(f"The pair was simulated again; the record {verdict} the stored record.")
            for difference in differences:
                print_line(f"    {difference}")

    document = {
        "files": files,
        "simulated_again": differences is not None,
        "differences": [*(differences or ())],
    }
    emit(quiet, as_json, document, files, show)
    if differences:
        raise typer.Exit(1)
