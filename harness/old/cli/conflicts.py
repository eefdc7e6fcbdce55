"""``harness conflicts``: measures of conflicts in the FCD output of any SUMO simulation."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from harness.old.cli.interruption import unwinding
from harness.old.cli.options import (
    FullOption,
    JsonOption,
    QuietOption,
    ThresholdsOption,
    settings_of,
)
from harness.old.cli.output import emit, progress_bar


def conflicts(
    fcd: Annotated[
        Path,
        typer.Argument(
            metavar="FCD", help="SUMO's --fcd-output: .xml, .xml.gz, .csv, .csv.gz or .parquet."
        ),
    ],
    net: Annotated[Path, typer.Option(help="The simulation's network (.net.xml).")],
    out: Annotated[Path, typer.Option(help="A new folder for tables and page.", metavar="RUN")],
    person_fcd: Annotated[
        Path | None,
        typer.Option(help="SUMO's --person-fcd-output, if people are not in FCD.", metavar="FILE"),
    ] = None,
    types: Annotated[
        list[Path] | None,
        typer.Option(
            help="A route or additional file with the simulation's vTypes: FCD has no lengths "
            "and widths. Repeatable.",
            metavar="FILE",
        ),
    ] = None,
    edge: Annotated[
        list[str] | None,
        typer.Option(
            help="Only this crossing, as `harness crossings` lists it. Repeatable.",
            metavar="CROSSING",
        ),
    ] = None,
    settings: ThresholdsOption = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
    full: FullOption = False,
) -> None:
    """Measure conflicts of people and vehicles in a SUMO output.

    Nothing is simulated.
    """
    from harness.old.report.pages.conflict_page import PAGE, write_conflict_page
    from harness.old.report.screens.conflict_tables import print_conflicts
    from harness.old.studies.conflicts import (
        check_new,
        document_of,
        find_conflicts,
        whole_folder,
        write_tables,
    )
    from harness.scenario import set_thresholds

    check_new(out)
    thresholds = set_thresholds(settings_of(settings), "conflicts")
    files = [fcd] if person_fcd is None else [fcd, person_fcd]
    hidden = quiet or as_json or not sys.stderr.isatty()
    with progress_bar("bytes", hidden) as advance:
        findings = find_conflicts(
            *(files, net),
            types=types or (),
            edges=edge or (),
            thresholds=thresholds,
            progress=advance,
        )
    with unwinding(), whole_folder(out) as folder:
        written = write_tables(findings, folder)
        write_conflict_page(findings, folder / PAGE, out)
    paths = [out / name for name in (*written, Path(PAGE))]
    emit(
        quiet,
        as_json,
        lambda: document_of(findings),
        paths,
        lambda: print_conflicts(findings, out, full),
    )
