"""``report``: writes a run folder as an HTML page, and its figures as files."""

from pathlib import Path
from typing import Annotated

import typer

from harness.core.errors import InputError, one_line
from harness.old.cli.interruption import unwinding
from harness.old.cli.options import JsonOption, QuietOption
from harness.old.cli.output import emit, print_line, say


def report(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A finished run folder.")],
    out: Annotated[
        Path | None,
        typer.Option(help="File for the page; default RUN/report.html.", metavar="FILE"),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option(help="Folder for the figures, PNG and PDF.", metavar="DIR", file_okay=False),
    ] = None,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write one HTML page for a run or a risk estimate.

    The page contains results, figures and a player for episodes, and needs no network.
    """
    if out is not None and out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {out}", "is not an HTML file", "a file name ending in .html")
    if out is not None and not out.parent.is_dir():
        raise InputError(f"--out {out}", f"there is no folder {out.parent}", "a file to write")
    from harness.old.cli.risk import report_risk
    from harness.old.store.reading import kind_of_folder

    reports = {"run": _report_run, "risk": report_risk}
    page = reports[kind_of_folder(run_folder)](run_folder, out, figures, quiet, as_json)
    if open_page:
        import webbrowser

        if not webbrowser.open(page.resolve().as_uri()):
            say(f"harness: no browser found; open {page} yourself")


def _report_run(
    run_folder: Path, out: Path | None, figures: Path | None, quiet: bool, as_json: bool
) -> Path:
    from harness.old.report.pages.page import write_report
    from harness.old.studies.batch.showing import write_shown
    from harness.old.studies.runs.opening import load_run

    run = load_run(run_folder)
    with unwinding():
        written = write_report(run, out, figures, write_shown(run, out))
    document = {
        "page": str(written.page),
        "figures": [str(path) for path in written.figures],
        "differing": list(written.differing),
    }

    def show() -> None:
        print_line(f"Report: {written.page}")
        if written.figures:
            print_line(f"Figures: {len(written.figures)} files in {figures}")

    emit(quiet, as_json, document, [written.page], show)
    for difference in written.differing:
        say(one_line(f"harness: a repeated episode differs from its record: {difference}"))
    return written.page
