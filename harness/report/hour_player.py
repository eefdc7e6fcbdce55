"""A stretch of an hour as the page's player takes it: plain numbers, thinned and rounded."""

from typing import Any

import numpy as np
import pandas as pd
from jinja2.utils import htmlsafe_json_dumps

from harness.encounter import PEDESTRIAN_RADIUS_M, Arm
from harness.report.player_data import rounded, short
from harness.report.shown_hour import ShownHour
from harness.report.tables import ARM_NAMES
from harness.report.words import pair_name
from harness.runs.run_data import RunData
from harness.traffic.lanes import Direction, lanes_of

EVERY_S = 0.5
"""States of one object are at least so far apart."""

BEHIND_M = 140.0
AHEAD_M = 60.0
"""How much of the road is shown, upstream and downstream in the ego's direction."""


def hour_player(run: RunData, hour: ShownHour) -> dict[str, Any]:
    """A sentence about the hour, and its document as text, for the page's template."""
    words = (
        f"All vehicles of {pair_name(run, hour.cell, hour.pair)} around the longest queue of the "
        "AV's arm, from "
        f"{hour.begin_s:g} s to {hour.end_s:g} s after the warm-up; a whole hour is too large for "
        f"a page. {hour.note} {' '.join(hour.differences[:1])}"
    )
    return {"words": words.strip(), "json": htmlsafe_json_dumps(hour_document(run, hour))}


def hour_document(run: RunData, hour: ShownHour) -> dict[str, Any]:
    """Everything the player of an hour draws.

    Returns:
        ``scene`` in metres, ``from`` and ``until`` in s since the end of the warm-up, and for each
        arm its vehicles and pedestrians with ``t`` and where they were then, to the millimetre.
    """
    scenario = run.scenario_of(hour.cell)
    return {
        "scene": {
            "length": scenario.crossing.length_m,
            "width": scenario.crossing.width_m,
            "borders": rounded(scenario.crossing.lane_borders_m()),
            "carLength": scenario.ego.length_m,
            "carWidth": scenario.ego.width_m,
            "radius": PEDESTRIAN_RADIUS_M,
            "left": -BEHIND_M,
            "right": AHEAD_M,
        },
        "from": hour.begin_s,
        "until": hour.end_s,
        "arms": [_arm(run, hour, arm) for arm in Arm],
    }


def _arm(run: RunData, hour: ShownHour, arm: Arm) -> dict[str, Any]:
    scenario = run.scenario_of(hour.cell)
    passages = run.rows_of("passages", hour.cell, hour.pair).to_pandas()
    own = passages[passages["arm"] == arm.value].set_index("vehicle")
    ways = hour.ways[hour.ways["arm"] == arm.value]
    near = ways["time_s"].between(hour.begin_s - 1.0, hour.end_s + 1.0)
    lanes = lanes_of(scenario)
    oncoming = {lane.centre_m for lane in lanes if lane.direction is Direction.ONCOMING}
    traffic = scenario.known_traffic
    unknown = scenario.arms.av if traffic.av_share == 1 else scenario.arms.human
    vehicles = []
    for name, rows in ways[near].groupby("object", sort=False):
        kind, _, number = str(name).rpartition("-")
        if kind != "vehicle":
            continue
        kept = _kept(rows["time_s"].to_numpy())
        strategy = own["strategy"].get(int(number))
        y_m = float(rows["y_m"].iloc[0])
        vehicles.append(
            {
                "number": int(number),
                "y": short(y_m),
                "oncoming": y_m in oncoming,
                "strategy": strategy,
                # Vehicles of the warm-up have no row.
                "automated": arm is Arm.AV and (strategy or unknown) == scenario.arms.av,
                "t": rounded(rows["time_s"].to_numpy()[kept]),
                "x": rounded(rows["x_m"].to_numpy()[kept]),
            }
        )
    return {
        "arm": arm.value,
        "name": ARM_NAMES[arm],
        "strategy": scenario.arms.driver(arm),
        "vehicles": vehicles,
        "walkers": list(_walkers(hour, arm, ways[near])),
    }


def _walkers(hour: ShownHour, arm: Arm, ways: pd.DataFrame) -> list[dict[str, Any]]:
    walks = hour.walks[hour.walks["arm"] == arm.value]
    there = (walks["arrival_s"] < hour.end_s) & ~(walks["cleared_s"] < hour.begin_s)
    found = []
    for row in walks[there].to_dict("records"):
        rows = ways[ways["object"] == f"pedestrian-{row['index']}"]
        kept = _kept(rows["time_s"].to_numpy())
        found.append(
            {
                "index": row["index"],
                "side": row["side"],
                "arrival": short(row["arrival_s"]),
                "start": short(row["start_s"]),
                "t": rounded(rows["time_s"].to_numpy()[kept]),
                "y": rounded(rows["y_m"].to_numpy()[kept]),
            }
        )
    return found


def _kept(times: np.ndarray) -> np.ndarray:
    """Which rows stay: the first, each next one at least ``EVERY_S`` later, and the last."""
    kept: list[int] = []
    for number, time in enumerate(times.tolist()):
        if not kept or number == len(times) - 1 or time >= times[kept[-1]] + EVERY_S - 1e-6:
            kept.append(number)
    return np.array(kept, dtype=int)
