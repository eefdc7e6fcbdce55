"""The page of a validation, with tables, figures and passages to watch."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from harness.core.documents import JsonObject
from harness.core.encounter import Arm, Walk
from harness.core.files import write_file
from harness.old.report.drawing import style
from harness.old.report.drawing.validation_figures import pictures_of
from harness.old.report.pages.template import Drawn, Page, drawn, write_page
from harness.old.report.pages.trace_rows import ego_rows, walk_rows
from harness.old.report.pages.traces import scene_of, shown_arm
from harness.old.report.screens.screen import screen_lines
from harness.old.report.screens.validation_tables import (
    READING,
    scope,
    validation_screen,
    validation_tables,
)
from harness.old.studies.validation import DriverOutcome, Passage, Validation
from harness.report.player import Player

PAGE, DOCUMENT = "validation.html", "validation.json"
_MOST_PASSAGES = 40


def write_validation(validation: Validation, folder: Path) -> list[Path]:
    """Write a validation's page and its JSON document.

    Args:
        validation: the validation.
        folder: the folder, which is made if missing.
    """
    page, document = folder / PAGE, folder / DOCUMENT
    text = json.dumps(validation.findings.document(), indent=1, ensure_ascii=False)
    with style.styled():
        pictures = [drawn(picture) for picture in pictures_of(validation)]
    content = _content(validation, pictures)
    folder.mkdir(parents=True, exist_ok=True)
    write_file(document, text.encode())
    write_page(page, content)
    return [page, document]


def _content(validation: Validation, pictures: Sequence[Drawn]) -> Page:
    findings = validation.findings
    sources = ", ".join(findings.sources)
    heading = f"Drivers compared with {sources}"
    return Page(
        kind="validation",
        title=f"{heading}, validation",
        heading=heading,
        where="Data",
        folder=sources,
        screen=screen_lines(validation_screen(findings, full=True))[:-1],
        tables=[replace(table, folded=True) for table in validation_tables(findings)],
        remarks=[READING, *findings.remarks],
        player=_player(validation),
        pictures=pictures,
        facts=[
            ("data", sources),
            ("recorded", f"{scope(findings)}, {findings.encounters:,} encounters"),
            ("drivers", ", ".join(driver.driver for driver in findings.drivers)),
        ],
        maker="harness validate",
        made_from="the recordings",
    )


def _player(validation: Validation) -> Player:
    """Return the player with the recorded vehicle and the closest driver of each passage."""
    driver = validation.findings.drivers[0].driver
    used = validation.passages.used[:_MOST_PASSAGES]
    episodes, scenes = [], {}
    for number, passage in enumerate(used):
        simulated, recorded = validation.outcomes[driver][number][0], validation.recorded[number]
        error = f"{simulated.pass_time_s - recorded.pass_time_s:+z.1f} s"
        arms = [
            _arm(passage, simulated, Arm.AV, f"simulated: {driver}"),
            _arm(passage, recorded, Arm.HUMAN, "recorded"),
        ]
        scenes[str(number)] = scene_of(passage.crossing, passage.vehicle)
        marked = sum(passage.extended)
        episodes.append(
            {
                "scene": str(number),
                "name": passage.name,
                "label": passage.name,
                "result": f"{driver}'s pass time differs by {error} from the record",
                "small": error,
                "note": f"{marked} of {len(passage.arrivals)} walks go beyond their recording.",
                "from": 0.0,
                "until": max((arm["vehicles"][0]["t"][-1] for arm in arms), default=0.0),
                "step": simulated.trace.step_s,
                "speed": 1,
                "arms": arms,
            }
        )
    words = (
        f"{len(episodes)} of {len(validation.passages.used)} passages: {driver} and the recorded "
        "vehicle side by side. In both the pedestrians walk as recorded."
    )
    return Player(words, scenes, episodes, {"Passages": range(len(episodes))})


def _arm(passage: Passage, outcome: DriverOutcome, arm: Arm, title: str) -> JsonObject:
    ended = "timed out" if outcome.timed_out else f"passed in {outcome.pass_time_s:.1f} s"
    touched = ", with a contact" if outcome.contact else ""
    trace = outcome.trace
    walks = [
        Walk(arrival, arrival.arrival_s, 1.0, legs=arrival.path) for arrival in passage.arrivals
    ]
    rows = pd.concat([ego_rows(trace), *(walk_rows(walk, trace) for walk in walks)])
    people = pd.DataFrame(
        {
            "index": [walk.arrival.index for walk in walks],
            "side": [walk.arrival.side.value for walk in walks],
            "arrival_s": [walk.arrival.arrival_s for walk in walks],
            "start_s": [walk.start_s for walk in walks],
        }
    )
    there = people["start_s"] <= float(rows["time_s"].max())
    return shown_arm(arm, title, rows, people[there], passage.crossing, ended + touched)
