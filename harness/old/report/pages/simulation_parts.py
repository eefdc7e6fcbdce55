"""The parts of the page of a user's own simulation."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from harness.core.documents import JsonObject
from harness.core.encounter import Arm
from harness.old.report.drawing.style import Picture
from harness.old.report.pages.inputs import strategies_of
from harness.old.report.pages.parts import PageParts, ShownEpisode
from harness.old.report.pages.passages import measures_in_words, passage_arm, passage_scene
from harness.old.report.pages.simulation_pictures import simulation_pictures
from harness.old.report.pages.simulation_tables import crosswalk_tables
from harness.old.report.pages.traces import Encoded, pair_title, short
from harness.old.report.screens.tables import ARM_NAMES, counted
from harness.old.store.simulations.simulation_traces import scene_parts
from harness.old.store.tables import Row
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.shown import ShownPair
from harness.old.studies.runs.simulation_choice import ChosenPassage, chosen_passages

_ARM_WORDS = {Arm.AV: "the AV's arm", Arm.HUMAN: "the reference's arm"}


def _opening(run: RunData) -> str:
    av, human = (strategies_of(run, arm) for arm in Arm)
    config = Path(run.scenario.known_simulation.config).name
    return (
        f"Each pair simulates {config} twice with one seed: once {av} drives the AVs from R0 until "
        f"they have left the chosen crosswalks, once {human} drives there. SUMO keeps everything "
        "else: vehicles, people, lights and right of way."
    )


def _pictures(run: RunData, _shown: Sequence[ShownPair]) -> tuple[Iterator[Picture], list[str]]:
    return simulation_pictures(run), []


def _player_words(_run: RunData, shown: Sequence[ShownPair], episodes: int) -> str:
    return (
        f"The {counted(episodes, 'most striking passage')} of {counted(len(shown), 'pair')}: the "
        "passage of a vehicle over a crosswalk in the AV's arm, beside the same vehicle's over the "
        "same crosswalk in the reference's arm. Each is seen from the vehicle's own lane; time is "
        "counted from its R0. Other vehicles are not shown."
    )


def _groups(run: RunData) -> Mapping[str, Sequence[Hashable]]:
    groups: dict[str, list[Hashable]] = {}
    for number, passage in enumerate(chosen_passages(run)):
        for reason in passage.reasons:
            groups.setdefault(reason, []).append(number)
    # Reasons are sorted by importance and not by passage, with contacts in both arms first.
    return {reason: groups[reason] for reason in sorted(groups, key=_rank)}


def _rank(reason: str) -> int:
    order = ("contact", "smallest PET", "smallest TTC", "largest DRAC", "longest delay")
    return next(place for place, words in enumerate(order) if reason.startswith(words))


def _episodes(run: RunData, shown: Sequence[ShownPair]) -> Iterator[ShownEpisode]:
    pairs = {(pair.cell, pair.pair): pair for pair in shown}
    for number, passage in enumerate(chosen_passages(run)):
        pair = pairs.get(passage.key)
        if pair is not None:
            yield _episode(run, pair, passage, number)


def _episode(run: RunData, pair: ShownPair, passage: ChosenPassage, number: int) -> ShownEpisode:
    """Return the player's episode of a passage in both arms."""
    rows: list[Row] = [
        {str(key): row[key] for key in row} for row in pair.people.to_dict("records")
    ]
    scenes = {(row["arm"], row["passage"]): row for row in rows}
    stored = run.rows_of("passages_over", pair.cell, pair.pair).to_pylist()
    records = {arm: [row for row in stored if row["arm"] == arm.value] for arm in Arm}
    arms: list[JsonObject] = []
    places: dict[Arm, Row] = {}
    length_s = 0.0
    for arm, index in sorted(passage.numbers.items(), key=lambda item: [*Arm].index(item[0])):
        scene = places[arm] = scenes[arm.value, index]
        record = records[arm][index]
        states = _rows(pair.traces, arm, index, scene["begin_s"])
        length_s = max(length_s, float(states["time_s"].max()))
        crossing, _ = scene_parts(scene)
        title = f"{ARM_NAMES[arm]}: {record['strategy']}, from {scene['begin_s']:.1f} s"
        arms.append(passage_arm(arm, title, states, scene["walks"], crossing, record))
    first = places[passage.arm]
    missing = [_ARM_WORDS[arm] for arm in Arm if arm not in places]
    notes = [
        f"Type {records[passage.arm][passage.numbers[passage.arm]]['type']}, approach: lane "
        f"{first['approach']}.",
        *(f"In {arm} it did not pass straight over this crosswalk." for arm in missing),
        pair.note,
        *pair.differences[:1],
    ]
    where = f"{passage.crosswalk}, vehicle {passage.vehicle}"
    words = measures_in_words(records[passage.arm][passage.numbers[passage.arm]])
    document = {
        "scene": str(number),
        "name": f"{where}, {pair_title(run, pair.cell, pair.pair)}",
        "label": f"{where}, pair {pair.pair}",
        "result": f"{words} ({_ARM_WORDS[passage.arm]})" if words else "",
        "small": words,
        "note": " ".join(filter(None, notes)),
        "from": 0.0,
        "until": short(length_s),
        "step": first["step_s"],
        "speed": 1,
        "arms": arms,
    }
    scene_document: Encoded = passage_scene(*scene_parts(first))
    return ShownEpisode(number, str(number), scene_document, document)


def _rows(traces: pd.DataFrame, arm: Arm, number: int, begin_s: float) -> pd.DataFrame:
    """Return a passage's rows of ``traces``, as ``ego`` and in time since the passage's begin."""
    name = f"passage-{number}"
    objects = traces["object"]
    mine = (traces["arm"] == arm.value) & ((objects == name) | objects.str.startswith(f"{name}-"))
    rows = traces[mine]
    names: Any = rows["object"].str.removeprefix(f"{name}-").replace(name, "ego")
    return rows.assign(object=names, time_s=(rows["time_s"] - begin_s).round(9))


SIMULATION_PARTS = PageParts(
    opening=_opening,
    tables=crosswalk_tables,
    pictures=_pictures,
    player_words=_player_words,
    episodes=_episodes,
    groups=_groups,
    shown_noun="passages",
)
