"""``report`` and ``resume`` of risk estimates."""

from pathlib import Path
from typing import Annotated

import typer

from harness.core.errors import InputError
from harness.old.cli import options
from harness.old.cli.options import JsonOption, QuietOption
from harness.old.cli.output import say


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
    """Write one HTML page for a risk estimate.

    The page contains results, figures and a player for episodes, and needs no network.
    """
    if out is not None and out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {out}", "is not an HTML file", "a file name ending in .html")
    if out is not None and not out.parent.is_dir():
        raise InputError(f"--out {out}", f"there is no folder {out.parent}", "a file to write")
    from harness.old.cli.risk import report_risk

    page = report_risk(run_folder, out, figures, quiet, as_json)
    if open_page:
        import webbrowser

        if not webbrowser.open(page.resolve().as_uri()):
            say(f"harness: no browser found; open {page} yourself")


def resume(
    run_folder: options.RunArgument,
    workers: options.WorkersOption = None,
    dask: options.DaskOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Continue an interrupted risk estimate."""
    from harness.old.cli.risk import resume_risk

    resume_risk(run_folder, workers, dask, full, quiet, as_json)
