"""Turns passages over a crosswalk, simulated or recorded, into the player's documents."""

from collections.abc import Iterable, Mapping
from typing import Any

import pandas as pd

from harness.core.documents import JsonObject
from harness.core.encounter import Arm, Crossing, Ending, Vehicle
from harness.old.report.pages.traces import rounded, scene_of, short, shown_arm

_MEASURES = (
    ("PET", "pet_s", "s"),
    ("TTC", "min_ttc_s", "s"),
    ("DRAC", "max_drac_mps2", "m/s²"),
)


def passage_scene(crossing: Crossing, vehicle: Vehicle) -> JsonObject:
    """Return the crosswalk for a vehicle's passage, with the borders of the vehicle's lane."""
    half_m = crossing.lane_width_m / 2
    borders = (crossing.lane_centre_m - half_m, crossing.lane_centre_m + half_m)
    # Vehicles here do not stop at a line of the harness.
    return scene_of(crossing, vehicle) | {"stop": None, "borders": rounded(borders)}


def measures_in_words(record: Mapping[str, Any]) -> str:
    """Return the defined ones of a passage's contact, PET, TTC and DRAC, in words."""
    parts = [
        f"{name} {record[column]:.2f} {unit}"
        for name, column, unit in _MEASURES
        if record[column] is not None
    ]
    if record["contact_time_s"] is not None and record["contact_index"] is not None:
        parts.insert(0, f"contact at {record['contact_speed_mps']:.2f} m/s")
    return ", ".join(parts)


def passage_arm(
    arm: Arm,
    title: str,
    rows: pd.DataFrame,
    people: Iterable[Mapping[str, Any]],
    crossing: Crossing,
    record: Mapping[str, Any],
) -> JsonObject:
    """Return the player's document of one arm of a passage.

    Args:
        arm: the arm, which determines the colours.
        title: name of the driver.
        rows: times from the passage's begin, positions and speeds of ``ego`` and of
            ``pedestrian-<index>``.
        people: ``index, side, arrival_s, start_s`` of each person.
        crossing: the crosswalk.
        record: ending, contact and measures of the passage.
    """
    contact = None
    if record["contact_time_s"] is not None and record["contact_index"] is not None:
        contact = {"time": short(record["contact_time_s"]), "index": record["contact_index"]}
    walkers = pd.DataFrame(
        [
            {
                "index": each["index"],
                "side": each["side"],
                "arrival_s": max(each["arrival_s"], 0.0),
                "start_s": each["start_s"],
            }
            for each in people
        ],
        columns=["index", "side", "arrival_s", "start_s"],
    )
    ending = "crossed"
    if record["ending"] != Ending.CROSSED:
        ending = str(record["ending"]).replace("_", " ")
    words = "; ".join(filter(None, [ending, measures_in_words(record)]))
    return shown_arm(arm, title, rows[rows["time_s"] >= 0], walkers, crossing, words, contact)
