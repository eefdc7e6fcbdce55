"""The data of the page's player for every kind of run: plain numbers, thinned and rounded."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from jinja2.utils import htmlsafe_json_dumps

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Arm, Crossing, Ending, FloatArray, Vehicle
from harness.episode.traffic.lanes import Direction, lanes_of
from harness.report.drawing.episode_figures import time_advantage
from harness.report.screens.tables import ARM_NAMES, counted, named_values
from harness.report.screens.words import pair_name
from harness.studies.runs.run_data import RunData
from harness.studies.runs.shown import Key, ShownPair, choose_pairs

MOST_STATES = 1_500
"""Most states of one arm of an encounter; longer traces are thinned evenly."""

HOUR_STEP_S = 0.5
"""Time between two states of an object of an hour."""

MOST_BYTES = 3_000_000
"""Largest size of all episodes together; further episodes are left out."""

_FURTHEST_M = 48.0
_BEYOND_M = 14.0
_HOUR_VIEW_M = (-140.0, 60.0)
"""The stretch of road that is shown of an hour; above, the limits of an encounter's."""

Numbers = list[float | None]
Row = Mapping[str, Any]
Encoded = Mapping[str, object]
"""A part of the document that ``templates/player.js`` reads."""


@dataclass(frozen=True)
class Player:
    """The player's part of a page.

    ``words`` describe what it plays.  ``groups`` lists the numbers of ``episodes`` under each
    heading.  Each episode names one of ``scenes``.
    """

    words: str
    scenes: Mapping[str, Encoded]
    episodes: Sequence[Encoded]
    groups: Mapping[str, Sequence[int]]

    @property
    def json(self) -> str:
        """Scenes and episodes as JSON that is safe inside a page."""
        return htmlsafe_json_dumps({"scenes": self.scenes, "episodes": self.episodes})


def run_player(run: RunData, shown: Sequence[ShownPair]) -> Player:
    """The player of a run's encounters, or of a stretch of an hour.

    Args:
        run: provides records and scenes.
        shown: the pairs with their traces, at least one.
    """
    encode = _hour if run.in_traffic else _encounter
    episodes: list[Encoded] = []
    numbers: dict[Key, int] = {}
    size = 0
    for pair in shown:
        episode = encode(run, pair)
        size += len(json.dumps(episode))
        if size > MOST_BYTES and episodes:
            break
        numbers[pair.cell, pair.pair] = len(episodes)
        episodes.append(episode)
    scenes = {str(cell): _scene(run, cell) for cell, _ in numbers}
    groups = {
        reason: [numbers[key] for key in keys if key in numbers]
        for reason, keys in choose_pairs(run).items()
    }
    groups = {reason: members for reason, members in groups.items() if members}
    return Player(_words(run, shown, len(episodes)), scenes, episodes, groups)


def pair_title(run: RunData, cell: int, pair: int) -> str:
    """The name of a pair, with the values of its cell's varied keys."""
    varied = run.study.cells[cell].varied
    keys = named_values({key: value for key, value in varied.items() if value is not None})
    return f"pair {pair} of cell {cell} ({keys})" if keys else f"pair {pair}"


def _words(run: RunData, shown: Sequence[ShownPair], episodes: int) -> str:
    if run.in_traffic:
        words = (
            f"All vehicles from {shown[0].begin_s:g} s to {shown[0].end_s:g} s after the warm-up, "
            "around the longest queue of the AV's arm; a whole hour is too large for a page. AVs "
            "are filled, vehicles of other drivers are outlined."
        )
    else:
        total = counted(len(run.pairs), "pair")
        words = f"{episodes:,} of {total}, both arms of a pair side by side."
    if shown[0].repeated:
        words += " The run stored no traces, so these episodes were simulated again for the page."
        different = sum(bool(pair.differences) for pair in shown)
        words += (
            f" {different:,} of them differ from the stored record: see their notes."
            if different
            else " All records are identical to the stored ones."
        )
    if episodes < len(shown):
        words += f" {len(shown) - episodes:,} chosen pairs are left out to keep the page small."
    return words


def scene_of(
    crossing: Crossing, vehicle: Vehicle, borders: Iterable[float] = (), obstacles: Any = ()
) -> dict[str, object]:
    """The crosswalk of an encounter, in metres."""
    half_lane = crossing.lane_width_m / 2
    ends = (crossing.lane_centre_m - half_lane, crossing.lane_centre_m + half_lane)
    return {
        "length": crossing.length_m,
        "width": crossing.width_m,
        "borders": rounded(borders),
        "stop": rounded((-crossing.stop_line_m, *ends)),
        "carLength": vehicle.length_m,
        "carWidth": vehicle.width_m,
        "radius": PEDESTRIAN_RADIUS_M,
        "left": -min(vehicle.trigger_range_m + vehicle.length_m, _FURTHEST_M) - 1,
        "right": _BEYOND_M,
        "obstacles": [rounded((*each.x_bounds_m, *each.y_bounds_m)) for each in obstacles],
    }


def _scene(run: RunData, cell: int) -> Encoded:
    scenario = run.scenario_of(cell)
    borders = scenario.crossing.lane_borders_m()
    scene = scene_of(scenario.crosswalk(), scenario.vehicle(), borders, scenario.obstacles())
    if run.in_traffic:
        scene |= {"stop": None, "left": _HOUR_VIEW_M[0], "right": _HOUR_VIEW_M[1]}
    return scene


def _encounter(run: RunData, pair: ShownPair) -> Encoded:
    rows = run.rows_of("episodes", pair.cell, pair.pair).to_pylist()
    records = {arm: row for arm in Arm for row in rows if row["arm"] == arm}
    scenario = run.scenario_of(pair.cell)
    arms = []
    for arm, record in records.items():
        contact = None
        if record["contact_time_s"] is not None:
            contact = {"time": short(record["contact_time_s"]), "index": record["contact_index"]}
        title = f"{ARM_NAMES[arm]}: {record['strategy']}"
        rows, people = (frame[frame["arm"] == arm.value] for frame in (pair.traces, pair.people))
        document = shown_arm(
            arm, title, rows, people, scenario.crosswalk(), _ending(record), contact
        )
        arms.append(document)
    times_s = [records.get(arm, {}).get("pass_time_s") for arm in Arm]
    result = "τ undefined" if None in times_s else f"τ = {times_s[0] / times_s[1]:.3f}"
    small = [] if None in times_s else [result]
    return {
        "scene": str(pair.cell),
        "name": pair_title(run, pair.cell, pair.pair),
        "label": pair_name(run, pair.cell, pair.pair),
        "result": result,
        "small": ", ".join([*small, *_small(records)]),
        "note": " ".join([pair.note, *pair.differences]).strip(),
        "from": 0.0,
        "until": short(pair.end_s),
        "step": scenario.experiment.step_s,
        "speed": 1,
        "arms": arms,
    }


def _hour(run: RunData, pair: ShownPair) -> Encoded:
    scenario = run.scenario_of(pair.cell)
    passages = run.rows_of("passages", pair.cell, pair.pair).to_pylist()
    lanes = [lane for lane in lanes_of(scenario) if lane.direction is Direction.ONCOMING]
    # Vehicles of the warm-up have no row, so their driver is inferred.
    unknown = scenario.arms.av if scenario.known_traffic.av_share == 1 else scenario.arms.human
    arms = []
    for arm in Arm:
        drivers = {
            f"vehicle-{row['vehicle']}": row["strategy"] for row in passages if row["arm"] == arm
        }
        rows, walks = (frame[frame["arm"] == arm.value] for frame in (pair.traces, pair.people))
        there = (walks["arrival_s"] < pair.end_s) & ~(walks["cleared_s"] < pair.begin_s)
        title = f"{ARM_NAMES[arm]}: {scenario.arms.driver(arm)}"
        document = shown_arm(arm, title, rows, walks[there])
        for vehicle in document["vehicles"]:
            driver = drivers.get(vehicle["name"], unknown)
            vehicle["filled"] = arm is Arm.HUMAN or driver == scenario.arms.av
            vehicle["oncoming"] = vehicle["y"] in [short(lane.centre_m) for lane in lanes]
            vehicle["name"] = f"{vehicle['name'].replace('-', ' ')}, {driver}"
        arms.append(document)
    return {
        "scene": str(pair.cell),
        "name": pair_title(run, pair.cell, pair.pair),
        "result": "",
        "note": " ".join([pair.note, *pair.differences[:1]]).strip(),
        "from": pair.begin_s,
        "until": pair.end_s,
        "step": 1,
        "speed": 4,
        "arms": arms,
    }


def shown_arm(
    arm: Arm,
    title: str,
    rows: pd.DataFrame,
    people: pd.DataFrame,
    crossing: Crossing | None = None,
    words: str = "",
    contact: Encoded | None = None,
) -> dict[str, Any]:
    """One arm of an episode.

    Args:
        arm: gives the colours.
        title: who drives.
        rows: of ``traces``.
        people: ``index, side, arrival_s, start_s`` of each pedestrian.
        crossing: the crosswalk of an encounter, for its curves over time; None for an hour.
        words: how the episode ended.
        contact: the ``time`` of a contact, and the ``index`` of the pedestrian.
    """
    step_s = HOUR_STEP_S
    if crossing is not None:
        times_s = rows["time_s"].unique()
        step_s = np.ptp(times_s) / MOST_STATES if len(times_s) > MOST_STATES else 0.0
    objects = {str(name): states for name, states in rows.groupby("object", sort=False)}
    vehicles, beliefs = [], []
    for name, states in objects.items():
        kept = _kept(states["time_s"].to_numpy(), step_s)
        if name.startswith("shown-"):
            beliefs.append({"index": int(name.removeprefix("shown-")), **_track(states, kept)})
        elif not name.startswith("pedestrian-"):
            vehicle = {"name": name, "filled": True, "oncoming": False, **_track(states, kept)}
            if crossing is not None:
                vehicle["v"] = rounded(states["speed_mps"].to_numpy()[kept])
                vehicle["gap"] = rounded(time_advantage(rows, crossing)[kept])
            vehicles.append(vehicle)
    walkers = []
    for person in people.to_dict("records"):
        states = objects.get(f"pedestrian-{person['index']}", rows.iloc[:0])
        start = {"arrival": short(person["arrival_s"]), "start": short(person["start_s"])}
        track = _track(states, _kept(states["time_s"].to_numpy(), step_s))
        walkers.append({"index": person["index"], "side": person["side"], **start, **track})
    return {
        "arm": arm.value,
        "title": title,
        "words": words,
        "contact": contact,
        "vehicles": vehicles,
        "walkers": walkers,
        "shown": beliefs,
    }


def _kept(times_s: FloatArray, step_s: float) -> "np.ndarray":
    """The states that are shown: the first in each interval of ``step_s``, and the last."""
    if not step_s or not len(times_s):
        return np.arange(len(times_s))
    intervals = np.floor(times_s / step_s + 1e-6)
    return np.union1d(np.unique(intervals, return_index=True)[1], len(times_s) - 1)


def _track(rows: pd.DataFrame, kept: "np.ndarray") -> Encoded:
    """Times and coordinates of an object; a coordinate that never changes is one number."""
    t, x, y = (rounded(rows[name].to_numpy()[kept]) for name in ("time_s", "x_m", "y_m"))
    return {"t": t, "x": _constant(x), "y": _constant(y)}


def _constant(values: Numbers) -> Numbers | float | None:
    return values[0] if len({*values}) == 1 else values


def _ending(record: Row) -> str:
    """How the episode ended, in words."""
    ending = record["ending"]
    if ending == Ending.CROSSED:
        words = f"crossed in {record['pass_time_s']:.2f} s"
    elif ending == Ending.CRASHED:
        words = (
            f"crashed at {record['contact_time_s']:.2f} s with {record['contact_speed_mps']:.2f} "
            f"m/s, {record['contact']}"
        )
    else:
        words = {Ending.TIMED_OUT: "timed out", Ending.ENGINE_FAILED: "failed"}[ending]
        words += f" ({record['reason']})" if record["reason"] else ""
    words += ", fell back on another strategy" if record["fallback"] else ""
    if record["min_time_advantage_s"] is not None:
        words += f"; smallest time advantage {record['min_time_advantage_s']:.2f} s"
    if record["min_ttc_s"] is not None:
        words += f", smallest TTC {record['min_ttc_s']:.2f} s"
    return words


def _small(records: Mapping[Arm, Row]) -> list[str]:
    """How an encounter ended, in a few words for the list of episodes."""
    parts = [
        f"{ARM_NAMES[arm]} {record['ending'].replace('_', ' ')}"
        for arm, record in records.items()
        if record["ending"] != Ending.CROSSED
    ]
    av = records.get(Arm.AV, {})
    measures = (("PET", "pet_s", "s"), ("TTC", "min_ttc_s", "s"), ("DRAC", "max_drac_mps2", "m/s²"))
    parts += [
        f"{name} {av[column]:.2f} {unit}"
        for name, column, unit in measures
        if av.get(column) is not None
    ]
    # Lines break between the parts alone.
    return [part.replace(" ", "\N{NO-BREAK SPACE}") for part in parts]


def rounded(values: Iterable[float]) -> Numbers:
    """The values to three decimals; None if undefined."""
    return [short(value) for value in values]


def short(value: float | None) -> float | None:
    """The value to three decimals; None if undefined."""
    if value is None or not math.isfinite(value):
        return None
    thousandths = round(float(value), 3)
    return int(thousandths) if thousandths == int(thousandths) else thousandths
