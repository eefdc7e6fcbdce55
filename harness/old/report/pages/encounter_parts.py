"""The parts of the page of encounters."""

from collections.abc import Iterator, Mapping, Sequence

from harness.core.encounter import Arm, Ending
from harness.core.errors import HarnessError, InputError
from harness.engine.network import place_of
from harness.old.report.drawing.style import Picture
from harness.old.report.pages.inputs import models_of, strategies_of
from harness.old.report.pages.parts import PageParts, pair_by_pair
from harness.old.report.pages.pictures import pictures_of
from harness.old.report.pages.traces import Encoded, pair_title, scene_of, short, shown_arm
from harness.old.report.screens.result_tables import statistics_table
from harness.old.report.screens.tables import ARM_NAMES, Table, counted
from harness.old.report.screens.words import pair_name
from harness.old.store.tables import Row
from harness.old.studies.runs.model_use import model_cells
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.shown import ShownPair


def _opening(run: RunData) -> str:
    pairs = counted(len(run.pairs), "pair")
    origin = f"seed {run.manifest['seed']}"
    if names := [str(entry.get("name")) for entry in models_of(run)]:
        origin += f", interaction model {', '.join(names)}"
    if run.varied_keys:
        keys, cells = ", ".join(run.varied_keys), len(run.study.cells)
        return (
            f"A sweep over {keys}: {cells:,} cells, {pairs} in all. In every pair the AV's "
            f"strategy and the reference ({strategies_of(run, Arm.HUMAN)}) meet the same "
            f"pedestrians at the crosswalk; {origin}."
        )
    arms = run.scenario.arms
    return (
        f"The AV's strategy {arms.av} is compared with the reference driver {arms.human}. Both "
        f"meet the same pedestrians at the same crosswalk in {pairs}; {origin}."
    )


def _tables(run: RunData) -> list[Table]:
    return [] if run.varied_keys else [statistics_table(run)]


def _pictures(run: RunData, shown: Sequence[ShownPair]) -> tuple[Iterator[Picture], list[str]]:
    model, place = None, None
    remarks = []
    try:
        model = next((run.model_of(cell.number) for cell in model_cells(run)), None)
    except InputError as error:
        # The model's file may have been removed since the run; the page works without it.
        remarks = [f"Figures of the interaction model are left out: {error}."]
    try:
        place = place_of(run.scenario_of(0))
    except HarnessError as error:
        remarks.append(f"The figure of the site is left out: {error}.")
    return pictures_of(run, model, place, shown), remarks


def _player_words(run: RunData, _shown: Sequence[ShownPair], episodes: int) -> str:
    total = counted(len(run.pairs), "pair")
    return f"{episodes:,} of {total}, both arms of a pair side by side."


def _scene(run: RunData, cell: int) -> Encoded:
    scenario = run.scenario_of(cell)
    borders = scenario.crossing.lane_borders_m()
    return scene_of(scenario.crosswalk(), scenario.vehicle(), borders, scenario.obstacles())


def _episode(run: RunData, pair: ShownPair) -> Encoded:
    rows = run.rows_of("episodes", pair.cell, pair.pair).to_pylist()
    records = {arm: row for arm in Arm for row in rows if row["arm"] == arm}
    scenario = run.scenario_of(pair.cell)
    arms = []
    for arm, record in records.items():
        contact = None
        if record["contact_time_s"] is not None:
            contact = {
                "time": short(record["contact_time_s"]),
                "index": record["contact_index"],
            }
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


def _ending(record: Row) -> str:
    """Return the episode's ending in words."""
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
    """Return an encounter's ending in a few words, for the list of episodes."""
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
    # Lines break only between the parts.
    return [part.replace(" ", "\N{NO-BREAK SPACE}") for part in parts]


ENCOUNTER_PARTS = PageParts(
    opening=_opening,
    tables=_tables,
    pictures=_pictures,
    player_words=_player_words,
    episodes=pair_by_pair(_scene, _episode),
)
