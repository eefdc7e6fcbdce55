"""``report``: a run folder as one page, and its figures as files."""

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.interruption import unwinding
from harness.cli.options import JsonOption, QuietOption
from harness.cli.output import print_json, print_line, say
from harness.errors import InputError, one_line


def report(
    run_folder: Annotated[
        Path, typer.Argument(metavar="RUN", help="A run folder; a run still going on, too.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="The page; default RUN/report.html.", metavar="FILE"),
    ] = None,
    figures: Annotated[
        Path | None, typer.Option(help="Folder for the figures, PNG and PDF.", metavar="DIR")
    ] = None,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write a run or a risk as one page that opens anywhere.

    It holds results, figures and a player of episodes.
    """
    if out is not None and out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {out}", "is no page", "a file that ends in .html")
    if out is not None and not out.parent.is_dir():
        raise InputError(f"--out {out}", f"there is no folder {out.parent}", "a file to write")
    if figures is not None and figures.exists() and not figures.is_dir():
        raise InputError(f"--figures {figures}", "is a file", "a folder")
    from harness.cli.risk import is_risk, report_risk

    if is_risk(run_folder):
        page = report_risk(run_folder, out, figures, quiet, as_json)
        if open_page:
            _open(page)
        return
    from harness.batch.showing import write_shown
    from harness.report.page import write_report
    from harness.report.tables import counted
    from harness.runs.opening import load_run

    run = load_run(run_folder)
    with unwinding():
        written = write_report(run, out, figures, write_shown(run, out))
    if as_json:
        print_json(
            {
                "page": str(written.page),
                "figures": [str(path) for path in written.figures],
                "finished": run.finished,
                "pairs": len(run.pairs),
                "differing": list(written.differing),
            }
        )
    else:
        print_line(str(written.page) if quiet else f"Report: {written.page}")
    if not quiet and not as_json:
        if not run.finished:
            planned = counted(run.planned_pairs, "pair")
            print_line(f"The run is not finished: {len(run.pairs)} of {planned}.")
        if written.figures:
            print_line(f"Figures: {len(written.figures)} files in {figures}")
    for difference in written.differing:
        say(one_line(f"harness: an episode run again is not as stored: {difference}"))
    if open_page:
        _open(written.page)


def _open(page: Path) -> None:
    import webbrowser

    if not webbrowser.open(page.resolve().as_uri()):
        say(f"harness: no browser found; open {page} yourself")
