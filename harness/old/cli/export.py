"""The command ``export``: tables, and pairs for other tools."""

from pathlib import Path
from typing import Literal

import typer

from harness.core.errors import InputError
from harness.old.cli.interruption import unwinding
from harness.old.cli.options import not_with, refuse_without
from harness.old.cli.output import emit, print_line


def export(
    run_folder: Path,
    csv: bool,
    form: Literal["openscenario", "trajectories"] | None,
    pair: int | None,
    cell: int,
    arm: str,
    ego: str,
    vehicle: str | None,
    crosswalk: str | None,
    out: Path | None,
    quiet: bool,
    as_json: bool,
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
