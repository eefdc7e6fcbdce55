"""A validation as one page: tables, figures, passages to watch."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from jinja2.utils import htmlsafe_json_dumps

from harness.encounter import PEDESTRIAN_RADIUS_M, Trace, Walk
from harness.files import write_file
from harness.motion.walking import cleared_s, states_at
from harness.report import style
from harness.report.player_data import ShownArm, ShownScene, ShownWalker, rounded
from harness.report.template import drawn, write_page
from harness.report.validation_figures import pictures_of
from harness.report.validation_tables import validation_document, validation_tables
from harness.validation import DriverOutcome, Passage, Validation

PAGE, DOCUMENT = "validation.html", "validation.json"
_MOST_PASSAGES = 40


def write_validation(validation: Validation, folder: Path) -> list[Path]:
    """Write a validation's page and its JSON document.

    Args:
        validation: to be shown.
        folder: made if missing.
    """
    page, document = folder / PAGE, folder / DOCUMENT
    text = json.dumps(validation_document(validation), indent=1, ensure_ascii=False)
    with style.styled():
        pictures = [drawn(picture) for picture in pictures_of(validation)]
    context = _context(validation) | {"pictures": pictures}
    folder.mkdir(parents=True, exist_ok=True)
    write_file(document, text.encode())
    write_page(page, context)
    return [page, document]


def _context(validation: Validation) -> dict[str, Any]:
    passages, nearest = validation.passages, validation.ranked[0]
    alike = ", ".join(nearest.not_told_apart)
    sources = ", ".join(validation.sources)
    return {
        "kind": "validation",
        "title": f"Drivers held against {sources}, validation",
        "heading": f"Drivers held against {sources}",
        "where": "Data",
        "folder": sources,
        "opening": [
            f"{len(passages.used)} recorded passages of {passages.vehicles} vehicles through "
            f"groups of crossing pedestrians, {passages.encounters} encounters. Nearest to the "
            f"recorded drivers is {nearest.driver}"
            + (f", not told apart from {alike}." if alike else "."),
            *(
                f"{name} was fitted on these very data: its figures flatter it."
                for name in validation.in_sample
            ),
        ],
        "tables": validation_tables(validation),
        "remarks": [
            "Ranked by the mean score of the pass time, without randomness its mean absolute "
            "error; 95 % intervals of a bootstrap over vehicles. Recorded pedestrians do not "
            "react: contacts count against every driver; in brackets those that only this "
            "explains.",
            *validation.remarks,
        ],
        "player": _player(validation),
        "facts": [("data", sources), ("drivers", ", ".join(validation.figures))],
        "maker": "harness validate",
        "made_from": "the recordings",
    }


def _player(validation: Validation) -> dict[str, Any]:
    """Recorded vehicle and nearest driver of each passage, side by side."""
    driver = validation.ranked[0].driver
    used = validation.passages.used[:_MOST_PASSAGES]
    outcomes = validation.outcomes[driver]
    episodes, scenes = [], {}
    for number, (passage, of) in enumerate(zip(used, outcomes, strict=False)):
        scenes[str(number)] = _scene(passage)
        real = validation.recorded[number]
        marked = sum(passage.extended)
        episodes.append(
            {
                "cell": number,
                "pair": number,
                "title": passage.name,
                "varied": "",
                "result": f"{driver} passes {_off(validation, driver, number)} from the record",
                "note": f"{marked} of {len(passage.arrivals)} walks go on beyond their record.",
                "arms": [
                    _arm(passage, of[0], "av", driver),
                    _arm(passage, real, "human", "recorded"),
                ],
            }
        )
    entries = [
        {"index": number, "title": episode["title"], "small": _off(validation, driver, number)}
        for number, episode in enumerate(episodes)
    ]
    document = {"scenes": scenes, "episodes": episodes}
    return {
        "groups": [{"title": "Passages", "entries": entries}],
        "words": f"{len(episodes)} of {len(validation.passages.used)} passages: {driver} and the "
        "recorded vehicle side by side; people walk as recorded in both.",
        "json": htmlsafe_json_dumps(document),
    }


def _off(validation: Validation, driver: str, number: int) -> str:
    one, real = validation.outcomes[driver][number][0], validation.recorded[number]
    return f"{one.pass_time_s - real.pass_time_s:+.1f} s"


def _scene(passage: Passage) -> ShownScene:
    crossing, vehicle = passage.crossing, passage.vehicle
    return {
        "length": crossing.length_m,
        "width": crossing.width_m,
        "borders": [],
        "laneWidth": crossing.lane_width_m,
        "lane": crossing.lane_centre_m,
        "carLength": vehicle.length_m,
        "carWidth": vehicle.width_m,
        "range": vehicle.trigger_range_m,
        "radius": PEDESTRIAN_RADIUS_M,
        "obstacles": [],
    }


def _arm(passage: Passage, outcome: DriverOutcome, arm: str, name: str) -> ShownArm:
    trace = outcome.trace
    times = np.arange(len(trace.x_m)) * trace.step_s
    ended = "timed out" if outcome.timed_out else f"passed in {outcome.pass_time_s:.1f} s"
    touched = ", with a contact" if outcome.contact else ""
    return {
        "arm": arm,
        "name": "simulated" if arm == "av" else "recorded",
        "strategy": name,
        "ending": "crossed",
        "words": ended + touched,
        "lane": passage.crossing.lane_centre_m,
        "t": rounded(times),
        "x": rounded(trace.x_m),
        "v": rounded(trace.speed_mps),
        "gap": [None] * len(times),
        "contact": None,
        "walkers": [
            walker
            for arrival in passage.arrivals
            if (walker := _walker(Walk(arrival, arrival.arrival_s, 1.0, legs=arrival.path), trace))
        ],
        "shown": [],
    }


def _walker(walk: Walk, trace: Trace) -> ShownWalker | None:
    """Places of a pedestrian at the steps at which they are there."""
    start, index = walk.arrival.arrival_s, walk.arrival.index
    cleared = cleared_s(walk, trace.crossing)
    first = int(np.ceil(start / trace.step_s - 1e-9))
    last = len(trace.x_m) - 1
    if cleared is not None:
        last = min(last, int(cleared / trace.step_s))
    if last < first:
        return None
    times_s = np.arange(first, last + 1, dtype=np.float64) * trace.step_s
    x, y, _, _ = states_at(walk, trace.crossing, times_s)
    return {
        "index": index,
        "side": walk.arrival.side.value,
        "arrival": round(start, 3),
        "start": round(start, 3),
        "from": first,
        "y": rounded(y),
        "x": rounded(x),
    }
