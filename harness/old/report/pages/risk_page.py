"""The page of a finished risk estimate: the first screen, then all numbers."""

import shlex
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from harness.old.report.pages.template import Page, flat, page_in, write_page
from harness.old.report.screens.risk_terminal import heading, risk_screen, risk_tables
from harness.old.report.screens.screen import screen_lines
from harness.old.studies.risk.asking import SettingsDocument
from harness.old.studies.risk.folder import read_risk, read_settings
from harness.old.studies.risk.writing import CRITICAL
from harness.scenario import as_written

_BY_BRUTE_FORCE = (
    "The estimate is by brute force: the share of events among independent nominal draws, which "
    "covers every way to the event."
)
_BY_WEIGHTS = (
    "The estimate is the mean weight of independent draws around the events that the explorations "
    "found. It covers the ways that were found; only the nominal draws bound the probability of "
    "all other ways."
)


def write_risk_page(folder: Path, out: Path | None = None) -> Path:
    """Write the page of a risk estimate.

    Args:
        folder: folder of the finished estimate.
        out: the file; default ``report.html`` in the folder.

    Raises:
        InputError: the folder has no finished risk estimate, or ``out`` is a folder.
    """
    settings, findings = read_settings(folder), read_risk(folder)
    page = page_in(folder, out)
    critical = shlex.quote(str(folder / CRITICAL))
    to_run = f"To run strategies on the likeliest events: harness run {critical}."
    content = Page(
        kind="risk",
        title=f"{heading(findings)}, risk",
        heading=heading(findings),
        where="Folder",
        folder=str(folder),
        screen=screen_lines(risk_screen(findings, folder, settings, full=True))[:-1],
        tables=[replace(table, folded=True) for table in risk_tables(findings)],
        remarks=[
            _BY_BRUTE_FORCE if findings.by_brute_force else _BY_WEIGHTS,
            *([to_run] if findings.ways else []),
        ],
        no_player="The likeliest events have not been simulated again.",
        figure_remarks=["A risk has no figures."],
        facts=list(_facts(settings)),
        scenario=list(flat(settings.scenario)),
        maker="harness report",
        made_from="the folder of harness risk alone",
    )
    write_page(page, content)
    return page


def _facts(settings: SettingsDocument) -> Iterator[tuple[str, str]]:
    yield "scenario", settings.name
    yield "arm", settings.arm.value
    yield "event", settings.event
    yield "engine", "SUMO" if settings.in_sumo else "plain"
    yield "wanted coefficient of variation", as_written(settings.target_cv)
    yield "seed", str(settings.seed)
    yield "interaction model", f"{settings.model['name']}, sha256 {settings.model['sha256'][:16]}…"
    yield "versions", ", ".join(f"{name} {version}" for name, version in settings.versions.items())
