"""The page of people beside measured people, with tables and a figure."""

import json
from pathlib import Path

from harness.core.files import write_file
from harness.report.drawing import style
from harness.report.drawing.people_figures import pictures_of
from harness.report.pages.template import Page, drawn, write_page
from harness.report.screens.people_tables import people_screen, people_table
from harness.report.screens.screen import screen_lines
from harness.studies.validation.people import PeopleFindings


def write_people(findings: PeopleFindings, folder: Path) -> list[Path]:
    """Write the page and its JSON document into a folder, which is made if missing."""
    screen = people_screen(findings, full=True)
    with style.styled():
        pictures = [drawn(picture) for picture in pictures_of(findings)]
    experiments = {held.experiment.title: held.experiment.source for held in findings.held}
    content = Page(
        kind="validation",
        title=screen.title,
        heading=screen.title,
        where="Measured figures",
        folder="shipped",
        screen=screen_lines(screen)[:-1],
        tables=[people_table(held) for held in findings.held],
        remarks=[f"Source of {title}: {source}." for title, source in experiments.items()],
        no_player="The experiments have no episodes to watch.",
        pictures=pictures,
        facts=[("simulated", screen.scope)],
        maker="harness validate people",
        made_from="the shipped figures of measured people",
    )
    page, document = folder / "people.html", folder / "people.json"
    folder.mkdir(parents=True, exist_ok=True)
    write_file(document, json.dumps(findings.document(), indent=1, ensure_ascii=False).encode())
    write_page(page, content)
    return [page, document]
