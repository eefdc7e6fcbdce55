"""Episodes as the page's player takes them: plain numbers, thinned and rounded to stay small."""

import json
import math
from collections.abc import Iterable, Sequence
from typing import Any, NotRequired, TypedDict

import numpy as np
import pandas as pd

from harness.encounter import PEDESTRIAN_RADIUS_M, Arm, Ending, FloatArray
from harness.report.episode_figures import time_advantage
from harness.report.episode_traces import Key, ShownPair
from harness.report.tables import ARM_NAMES, named_values
from harness.report.words import pair_name
from harness.runs.run_data import RunData

MOST_STATES = 1_500
"""States of one arm; longer episodes are thinned evenly, first and last kept."""

MOST_BYTES = 3_000_000
"""Size of all episodes together; the rest is left out."""


Numbers = list[float | None]


class ShownScene(TypedDict):
    """A scene: templates/player.js needs every key."""

    length: float
    width: float
    borders: Numbers
    laneWidth: float
    lane: float
    carLength: float
    carWidth: float
    range: float
    radius: float
    obstacles: list[Numbers]


# "from" is a name that a class cannot have.
ShownWalker = TypedDict(
    "ShownWalker",
    {
        "index": int,
        "side": str,
        "arrival": float | None,
        "start": float | None,
        "from": int | None,
        "y": Numbers,
        "x": NotRequired[Numbers],
    },
)


class ShownArm(TypedDict):
    """One arm of an episode: the player needs all but the last three, which the list has."""

    arm: str
    name: str
    strategy: str
    ending: str
    words: str
    lane: float
    t: Numbers
    x: Numbers
    v: Numbers
    gap: Numbers
    contact: dict[str, Any] | None
    walkers: list[ShownWalker]
    shown: list[dict[str, Any]]
    pet: NotRequired[float | None]
    ttc: NotRequired[float | None]
    drac: NotRequired[float | None]


def player_document(
    run: RunData, chosen: dict[str, list[Key]], shown: Sequence[ShownPair]
) -> dict[str, Any]:
    """Everything the player draws.

    Args:
        run: gives records and scenes.
        chosen: the pairs by reason.
        shown: the same pairs with their traces.

    Returns:
        ``scenes`` by cell, ``episodes`` in order, ``groups`` of indices into them with a heading,
        ``left_out``: how many did not fit.  Positions to the millimetre, undefined is None.
    """
    episodes: list[dict[str, Any]] = []
    numbers: dict[Key, int] = {}
    size = 0
    for pair in shown:
        document = _episode(run, pair)
        size += len(json.dumps(document))
        if size > MOST_BYTES and episodes:
            break
        numbers[pair.cell, pair.pair] = len(episodes)
        episodes.append(document)
    groups = [
        {"title": reason, "episodes": [numbers[key] for key in keys if key in numbers]}
        for reason, keys in chosen.items()
    ]
    return {
        "scenes": {str(cell): _scene(run, cell) for cell in dict.fromkeys(c for c, _ in numbers)},
        "episodes": episodes,
        "groups": [group for group in groups if group["episodes"]],
        "left_out": len(shown) - len(episodes),
    }


def _scene(run: RunData, cell: int) -> ShownScene:
    scenario = run.scenario_of(cell)
    return {
        "length": scenario.crossing.length_m,
        "width": scenario.crossing.width_m,
        "borders": rounded(scenario.crossing.lane_borders_m()),
        "laneWidth": scenario.crossing.width_of_lane_m,
        "lane": scenario.crosswalk().lane_centre_m,
        "carLength": scenario.ego.length_m,
        "carWidth": scenario.ego.width_m,
        "range": scenario.ego.trigger_range_m,
        "radius": PEDESTRIAN_RADIUS_M,
        "obstacles": [
            rounded((*obstacle.x_bounds_m, *obstacle.y_bounds_m))
            for obstacle in scenario.obstacles()
        ],
    }


def _episode(run: RunData, pair: ShownPair) -> dict[str, Any]:
    records = {row["arm"]: row for row in run.rows_of("episodes", pair.cell, pair.pair).to_pylist()}
    walkers = run.rows_of("pedestrians", pair.cell, pair.pair).to_pylist()
    tau = _tau(records)
    varied = run.study.cells[pair.cell].varied
    return {
        "cell": pair.cell,
        "pair": pair.pair,
        "title": pair_name(run, pair.cell, pair.pair),
        "varied": named_values({key: of for key, of in varied.items() if of is not None}),
        "result": "τ undefined" if tau is None else f"τ = {tau:.3f}",
        "note": " ".join([pair.note or "", *pair.differences]).strip(),
        "arms": [
            _arm(run, pair, arm, records[arm.value], [w for w in walkers if w["arm"] == arm])
            for arm in Arm
            if arm.value in records
        ],
    }


def _tau(records: dict[str, Any]) -> float | None:
    times = [records.get(arm.value, {}).get("pass_time_s") for arm in Arm]
    return None if None in times else times[0] / times[1]


def _arm(
    run: RunData, pair: ShownPair, arm: Arm, record: dict[str, Any], walkers: list[dict[str, Any]]
) -> ShownArm:
    rows = pair.rows[pair.rows["arm"] == arm.value]
    crossing = run.scenario_of(pair.cell).crosswalk()
    objects = {str(name): own for name, own in rows.groupby("object", sort=False)}
    ego = objects.get("ego", rows)
    kept = _kept(len(ego))
    times = ego["time_s"].to_numpy()[kept]
    return {
        "arm": arm.value,
        "name": ARM_NAMES[arm],
        "strategy": record["strategy"],
        "ending": record["ending"],
        "words": _words(record),
        "pet": short(record.get("pet_s")),
        "ttc": short(record.get("min_ttc_s")),
        "drac": short(record.get("max_drac_mps2")),
        "lane": crossing.lane_centre_m,
        "t": rounded(times),
        "x": rounded(ego["x_m"].to_numpy()[kept]),
        "v": rounded(ego["speed_mps"].to_numpy()[kept]),
        "gap": rounded(time_advantage(rows, crossing)[kept]),
        "contact": _contact(record),
        "walkers": [
            _walker(walker, objects.get(f"pedestrian-{walker['index']}", rows.iloc[:0]), times)
            for walker in walkers
        ],
        "shown": [
            _shown(int(name.removeprefix("shown-")), own, times)
            for name, own in objects.items()
            if name.startswith("shown-")
        ],
    }


def _kept(states: int) -> np.ndarray:
    """Which states stay: all, or evenly spread ones."""
    return np.unique(np.linspace(0, states - 1, min(states, MOST_STATES)).astype(int))


def _walker(walker: dict[str, Any], rows: pd.DataFrame, times: FloatArray) -> ShownWalker:
    """A pedestrian's places at the states kept, from number ``from`` on, and their times.

    ``x`` is left out where they keep to the crosswalk's centre line.
    """
    seen, y = rows["time_s"].to_numpy(), rows["y_m"].to_numpy()
    on = np.flatnonzero(np.isin(times, seen))
    x = rounded(rows["x_m"].to_numpy()[np.searchsorted(seen, times[on])])
    shown: ShownWalker = {
        "index": walker["index"],
        "side": walker["side"],
        "arrival": short(walker["arrival_s"]),
        "start": short(walker["start_s"]),
        "from": int(on[0]) if len(on) else None,
        "y": rounded(y[np.searchsorted(seen, times[on])]),
    }
    if any(x):
        shown["x"] = x
    return shown


def _shown(index: int, rows: pd.DataFrame, times: FloatArray) -> dict[str, Any]:
    """Where the strategy was shown a pedestrian: y at the states kept whose numbers are ``at``."""
    on = np.flatnonzero(np.isin(times, rows["time_s"].to_numpy()))
    y = rows["y_m"].to_numpy()[np.searchsorted(rows["time_s"].to_numpy(), times[on])]
    return {"index": index, "at": on.tolist(), "y": rounded(y)}


def _words(record: dict[str, Any]) -> str:
    """How the episode ended, in a sentence."""
    ending = record["ending"]
    if ending == Ending.CROSSED:
        said = f"crossed in {record['pass_time_s']:.2f} s"
    elif ending == Ending.CRASHED:
        said = (
            f"crashed at {record['contact_time_s']:.2f} s with {record['contact_speed_mps']:.2f} "
            f"m/s, {record['contact']}"
        )
    else:
        said = {Ending.TIMED_OUT: "timed out", Ending.ENGINE_FAILED: "failed"}[ending]
        said += f" ({record['reason']})" if record["reason"] else ""
    said += ", fell back on another strategy" if record["fallback"] else ""
    if record["min_time_advantage_s"] is not None:
        said += f"; smallest time advantage {record['min_time_advantage_s']:.2f} s"
    if record["min_ttc_s"] is not None:
        said += f", smallest TTC {record['min_ttc_s']:.2f} s"
    return said


def _contact(record: dict[str, Any]) -> dict[str, Any] | None:
    if record["contact_time_s"] is None:
        return None
    return {"time": short(record["contact_time_s"]), "index": record["contact_index"]}


def rounded(values: Iterable[float]) -> list[float | None]:
    """Each to three decimals; None where it is undefined."""
    return [short(value) for value in values]


def short(value: float | None) -> float | None:
    """To three decimals; None where it is undefined."""
    if value is None or not math.isfinite(value):
        return None
    rounded = round(float(value), 3)
    return int(rounded) if rounded == int(rounded) else rounded
