"""The player's part of a page: shown pairs as a document of thinned and rounded numbers."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from jinja2.utils import htmlsafe_json_dumps

from harness.core.documents import JsonObject
from harness.core.vocabulary import PEDESTRIAN_RADIUS_M, Arm, Crossing, Ending, FloatArray
from harness.measures.conflicts import time_advantage_s
from harness.report.words import counted_noun, plain_text
from harness.results.folder import read_cell
from harness.results.loaded_run import Run
from harness.results.tables import Row
from harness.scenario import Scenario
from harness.studies.page_content import ShownPair

MOST_STATES = 1_500
"""Most states of one arm of a pair; longer traces are thinned evenly."""

MOST_BYTES = 3_000_000
"""Most bytes of all episodes; further ones are left out."""

_FURTHEST_M = 48.0
_BEYOND_M = 14.0
"""Limits in m of the stretch of road that is shown."""

_ARMS = {Arm.AV: "AV", Arm.HUMAN: "reference"}

Rounded = list[float | None]


class Player(NamedTuple):
    """The player of a page.

    Attributes:
        words: what it shows.
        scenes: the crosswalk of each cell by the cell's number.
        episodes: the pairs.
        groups: the indices of pairs by the reason why they are shown.
    """

    words: str
    scenes: Mapping[str, JsonObject]
    episodes: Sequence[JsonObject]
    groups: Mapping[str, Sequence[int]]

    @property
    def json(self) -> str:
        """Scenes and episodes as JSON that is safe inside a page."""
        return htmlsafe_json_dumps({"scenes": self.scenes, "episodes": self.episodes})


def player_of(run: Run, shown: Sequence[ShownPair]) -> Player:
    """The player of a run's shown pairs, of which there is at least one."""
    scenes: dict[str, JsonObject] = {}
    episodes: list[JsonObject] = []
    groups: dict[str, list[int]] = {}
    size = 0
    for pair in shown:
        document = _episode(run, pair)
        size += len(json.dumps(document))
        if size > MOST_BYTES and episodes:
            break
        for reason in pair.reasons:
            groups.setdefault(reason, []).append(len(episodes))
        scenes[document["scene"]] = _scene(run.scenario_of(pair.cell))
        episodes.append(document)
    return Player(" ".join(_words(run, shown, len(episodes))), scenes, episodes, groups)


def pair_name(pair: ShownPair, several: bool) -> str:
    """The name of a pair of a run of one or several cells."""
    return f"cell {pair.cell}, pair {pair.pair}" if several else f"pair {pair.pair}"


def _time_advantage_s(objects: Mapping[str, pd.DataFrame], crossing: Crossing) -> FloatArray:
    """The least ``time_advantage_s`` over pedestrians at each of the ego's rows.

    Args:
        objects: the rows of ``traces`` of one arm of one pair by object, the ego's among them.
        crossing: the crosswalk from the ego's lane.
    """
    ego = objects["ego"]
    times, x_m, speed = (ego[name].to_numpy() for name in ("time_s", "x_m", "speed_mps"))
    smallest = np.full(len(times), np.inf)
    for name, walker in objects.items():
        if not name.startswith("pedestrian-"):
            continue  # the ego, or a pedestrian as the strategy perceives them
        y, walking = walker["y_m"].to_numpy(), np.abs(walker["speed_mps"].to_numpy())
        # Without movement they walk away from the nearer kerb.
        direction = np.sign(y[-1] - y[0]) or (1.0 if y[0] < crossing.length_m / 2 else -1.0)
        lateral = (crossing.lane_centre_m - y) * direction
        at = np.searchsorted(times, walker["time_s"].to_numpy()).clip(max=len(times) - 1)
        found = time_advantage_s(-x_m[at], speed[at], lateral, walking)
        np.minimum.at(smallest, at, found)
    return smallest


def _words(run: Run, shown: Sequence[ShownPair], kept: int) -> Iterator[str]:
    total = sum(cell["pairs"].count for cell in run.cells)
    yield f"{kept:,} of {counted_noun(total, 'pair')}, both arms side by side."
    if any(pair.repeated for pair in shown):
        yield "The run kept no traces, so these were simulated again for the page."
        different = sum(bool(pair.differences) for pair in shown)
        yield f"{different or 'None'} of them differ from the stored record."
    if left := len(shown) - kept:
        yield f"{counted_noun(left, 'chosen pair')} left out to keep the page small."


def _scene(scenario: Scenario) -> JsonObject:
    """The crosswalk of a cell, in metres."""
    crossing, vehicle = scenario.crosswalk(), scenario.vehicle()
    half_lane = crossing.lane_width_m / 2
    ends = (crossing.lane_centre_m - half_lane, crossing.lane_centre_m + half_lane)
    return {
        "length": crossing.length_m,
        "width": crossing.width_m,
        "borders": _rounded(scenario.crossing.lane_borders_m()),
        "stop": _rounded((-crossing.stop_line_m, *ends)),
        "carLength": vehicle.length_m,
        "carWidth": vehicle.width_m,
        "radius": PEDESTRIAN_RADIUS_M,
        "left": -min(vehicle.trigger_range_m + vehicle.length_m, _FURTHEST_M) - 1,
        "right": _BEYOND_M,
        "obstacles": [_rounded((*at.x_bounds_m, *at.y_bounds_m)) for at in scenario.obstacles()],
    }


def _episode(run: Run, pair: ShownPair) -> JsonObject:
    """One pair as the player needs it, with both arms."""
    table = read_cell(run.path, "episodes", pair.cell, run.manifest, pair.pair)
    records: dict[Arm, Row] = {Arm(row["arm"]): row for row in table.to_pylist()}
    cell = next(cell for cell in run.study.cells if cell.number == pair.cell)
    traces, everybody = pair.traces.to_pandas(), pair.people.to_pylist()
    arms = []
    for arm, record in records.items():
        rows, people = traces[traces["arm"] == arm], [of for of in everybody if of["arm"] == arm]
        arms.append(_arm(arm, record, rows, people, cell.scenario.crosswalk()))
    times_s = [record["pass_time_s"] for record in records.values()]
    result = "τ undefined" if None in times_s else f"τ = {times_s[0] / times_s[1]:.3f}"
    varied = ", ".join(
        f"{key} = {plain_text(value)}" for key, value in cell.varied.items() if value is not None
    )
    name = f"pair {pair.pair}" + (f" of cell {pair.cell} ({varied})" if varied else "")
    verdict = "differs from" if pair.differences else "is identical to"
    note = f"Simulated again for the page; the record {verdict} the stored one."
    return {
        "scene": str(pair.cell),
        "name": name,
        "label": pair_name(pair, bool(varied)),
        "result": result,
        "small": ", ".join([result, *_small(records)]),
        "note": " ".join([*([note] if pair.repeated else []), *pair.differences]),
        "until": 0.0 if traces.empty else _short(traces["time_s"].max()),
        "step": cell.scenario.experiment.step_s,
        "arms": arms,
    }


def _arm(
    arm: Arm, record: Row, rows: pd.DataFrame, people: Sequence[Row], crossing: Crossing
) -> JsonObject:
    """One arm of a pair."""
    rows = rows.sort_values("time_s", kind="stable")
    times = rows["time_s"].unique()
    kept = times[:: max(1, math.ceil(len(times) / MOST_STATES))]
    rows = rows[rows["time_s"].isin([*kept, *times[-1:]])]
    objects = {str(name): states for name, states in rows.groupby("object", sort=False)}
    tracks = {name: _track(states) for name, states in objects.items()}
    ego = tracks.get("ego", {"t": [], "x": [], "y": []})
    if "ego" in objects:
        ego |= {"v": _rounded(objects["ego"]["speed_mps"])}
        ego |= {"gap": _rounded(_time_advantage_s(objects, crossing))}
    walkers = [
        {
            "index": person["index"],
            "side": person["side"],
            "arrival": _short(person["arrival_s"]),
            "start": _short(person["start_s"]),
            **tracks.get(f"pedestrian-{person['index']}", {"t": [], "x": 0, "y": 0}),
        }
        for person in people
    ]
    seen = [
        {"index": int(name.removeprefix("shown-")), **track}
        for name, track in tracks.items()
        if name.startswith("shown-")
    ]
    contact = None
    if record["contact_time_s"] is not None:
        contact = {"time": _short(record["contact_time_s"]), "index": record["contact_index"]}
    return {
        "arm": arm,
        "title": f"{_ARMS[arm]}: {record['strategy']}",
        "words": _ending(record),
        "contact": contact,
        "ego": ego,
        "walkers": walkers,
        "shown": seen,
    }


def _ending(record: Row) -> str:
    """How an episode ended."""
    ending = record["ending"]
    if ending == Ending.CROSSED:
        words = f"crossed in {record['pass_time_s']:.2f} s"
    elif ending == Ending.CRASHED:
        words = f"crashed at {record['contact_time_s']:.2f} s with "
        words += f"{record['contact_speed_mps']:.2f} m/s, {record['contact']}"
    else:
        words = "timed out" if ending == Ending.TIMED_OUT else "failed"
        words += f" ({record['reason']})" if record["reason"] else ""
    words += ", fell back on another strategy" if record["fallback"] else ""
    for name, column in (("time advantage", "min_time_advantage_s"), ("TTC", "min_ttc_s")):
        if record[column] is not None:
            words += f"; smallest {name} {record[column]:.2f} s"
    return words


def _small(records: Mapping[Arm, Row]) -> list[str]:
    """A pair's endings in a few words, for the list of pairs."""
    parts = [
        f"{_ARMS[arm]} {(record['failed_in'] or record['ending']).replace('_', ' ')}"
        f"{' failed' if record['failed_in'] else ''}"
        for arm, record in records.items()
        if record["ending"] != Ending.CROSSED
    ]
    pet_s = records[Arm.AV]["pet_s"]
    return parts if pet_s is None else [*parts, f"PET {pet_s:.2f} s"]


def _track(rows: pd.DataFrame) -> JsonObject:
    """An object's times and coordinates; a constant coordinate is one number."""
    t, *places = (_rounded(rows[name]) for name in ("time_s", "x_m", "y_m"))
    x, y = (values[0] if len({*values}) == 1 else values for values in places)
    return {"t": t, "x": x, "y": y}


def _rounded(values: Iterable[float]) -> Rounded:
    return [_short(value) for value in values]


def _short(value: float | None) -> float | None:
    """A value with three decimals; None if undefined."""
    if value is None or not math.isfinite(value):
        return None
    thousandths = round(float(value), 3)
    return int(thousandths) if thousandths == int(thousandths) else thousandths
