"""The page of a recording's conflicts, with tables, histograms and the worst passages."""

from dataclasses import replace
from pathlib import Path

import pandas as pd

from harness.core.documents import JsonObject
from harness.core.encounter import Arm
from harness.old.report.drawing import style
from harness.old.report.drawing.conflict_figures import conflict_pictures
from harness.old.report.pages.passages import measures_in_words, passage_arm, passage_scene
from harness.old.report.pages.player import Player
from harness.old.report.pages.template import Page, drawn, write_page
from harness.old.report.pages.trace_rows import ego_rows, walk_rows
from harness.old.report.pages.traces import short
from harness.old.report.screens.conflict_tables import conflict_screen, conflict_tables
from harness.old.report.screens.screen import screen_lines
from harness.old.store.hour_tables import record_row
from harness.old.studies.conflicts import ConflictFindings, ConflictPassage, worst_rows

PAGE = "report.html"
_MOST_PASSAGES = 30


def write_conflict_page(findings: ConflictFindings, path: Path, folder: Path) -> None:
    """Write the page of conflicts.

    Args:
        findings: the conflicts.
        path: path of the page.
        folder: the page's final folder, which its text names.
    """
    with style.styled():
        pictures = [drawn(picture) for picture in conflict_pictures(findings)]
    files = ", ".join(map(str, findings.files))
    player = _player(findings)
    write_page(
        path,
        Page(
            kind="conflicts",
            title=f"Conflicts in {findings.files[0].name}",
            heading="Conflicts of people and vehicles",
            where="Recording",
            folder=files,
            screen=screen_lines(conflict_screen(findings, folder, full=True)),
            tables=[replace(table, folded=True) for table in conflict_tables(findings)],
            remarks=[
                "FCD output has no length or width of a vehicle, and no driver's own speed. They "
                "are those of its type and the lane's speed limit: a delay is against the limit.",
            ],
            player=player,
            no_player="No passage met anybody closely enough to have a PET or a TTC.",
            pictures=pictures,
            facts=[
                ("recording", files),
                ("network", str(findings.net)),
                ("records of vehicles", f"{findings.vehicle_records:,}"),
                ("records of people", f"{findings.person_records:,}"),
                ("step", f"{findings.step_s:g} s"),
                ("places may be off by", f"{findings.rounding_m:.2g} m"),
            ],
            maker="harness conflicts",
            made_from="SUMO's outputs",
        ),
    )


def _player(findings: ConflictFindings) -> Player | None:
    """Return the player of the worst passages by PET and by TTC."""
    passages = {(each.crosswalk, each.vehicle, each.begin_s): each for each in findings.passages}
    rows = [each.row() for each in findings.passages]
    numbers: dict[tuple[str, str, float], int] = {}
    groups = {}
    for by, title in (("pet_s", "Smallest PET"), ("min_ttc_s", "Smallest TTC")):
        keys = [
            (row["crosswalk"], row["vehicle"], row["begin_s"])
            for row in worst_rows(rows, by, _MOST_PASSAGES // 2)
        ]
        groups[title] = [numbers.setdefault(key, len(numbers)) for key in keys]
    if not numbers:
        return None
    episodes, scenes = [], {}
    for key, number in numbers.items():
        each = passages[key]
        scenes[str(number)] = passage_scene(each.trace.crossing, each.trace.vehicle)
        episodes.append(_episode(each, str(number)))
    words = (
        f"The worst {len(episodes)} passages, each from its vehicle's own lane. Time is counted "
        "from the beginning of the passage; its name has the simulation's time."
    )
    return Player(words, scenes, episodes, {k: v for k, v in groups.items() if v})


def _episode(each: ConflictPassage, scene: str) -> JsonObject:
    trace, record = each.trace, record_row(each.record)
    words = measures_in_words(record)
    people = [
        {
            "index": walk.arrival.index,
            "side": walk.arrival.side.value,
            "arrival_s": walk.arrival.arrival_s,
            "start_s": walk.start_s,
        }
        for walk in trace.walks
    ]
    rows = pd.concat([ego_rows(trace), *(walk_rows(walk, trace) for walk in trace.walks)])
    name = f"{each.crosswalk}, vehicle {each.vehicle}, {each.begin_s:g} s"
    title = f"{each.vehicle}, {each.type}" if each.type else each.vehicle
    return {
        "scene": scene,
        "name": name,
        "label": name,
        "result": words,
        "small": words,
        "note": f"Approach: lane {each.approach}.",
        "from": 0.0,
        "until": short((len(trace.x_m) - 1) * trace.step_s),
        "step": trace.step_s,
        "speed": 1,
        "arms": [passage_arm(Arm.AV, title, rows, people, trace.crossing, record)],
    }
