"""The page of a run of a user's own simulation: figures, tables, and the passages to watch."""

import json
import shutil
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import harness
from harness.core.encounter import Arm
from harness.old.report.drawing import style
from harness.old.report.pages.page import write_report
from harness.old.report.pages.player import run_player
from harness.old.report.pages.simulation_pictures import simulation_pictures
from harness.old.store.reading import read_table
from harness.old.store.simulations.simulation_traces import has_passages, only_passages
from harness.old.store.walk_rows import stored_walk
from harness.old.studies.batch.showing import write_shown
from harness.old.studies.runs.opening import load_run
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.shown import SHOWN, missing_pairs, shown_pairs
from harness.old.studies.runs.simulation_choice import (
    MOST_PAIRS,
    chosen_pairs,
    chosen_passages,
    most_striking,
    numbers_of,
)
from harness.scenario import parse_variation, read_scenario_file, study_of
from tests.batches import one_process, printed, refusal, run_inline
from tests.own_scenario import CROSSING, own_study, write_scenario

VOID = {"meta", "link", "input", "img", "br", "hr"}


class Page(HTMLParser):
    """What a browser would find: elements with attributes, and the text of each kind of element."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self._open: list[str] = []
        self.source = path.read_text(encoding="utf-8")
        self.feed(self.source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        self.texts.setdefault(self._open[-1] if self._open else "", []).append(data)

    @property
    def words(self) -> str:
        """All text but scripts and styles, spaces made single."""
        kept = (
            text for tag, of in self.texts.items() if tag not in ("script", "style") for text in of
        )
        return " ".join(" ".join(kept).split())

    def attributes(self, name: str) -> list[str]:
        return [str(found[name]) for _, found in self.elements if name in found]

    def has(self, *words: str) -> None:
        assert [text for text in words if text not in self.words] == []


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> RunData:
    """Two pairs, with traces."""
    folder = tmp_path_factory.mktemp("own")
    return run_inline(own_study(folder), folder / "run", traces=True)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> RunData:
    """The same without traces; what its page shows is simulated again."""
    folder = tmp_path_factory.mktemp("own")
    run = run_inline(own_study(folder), folder / "run")
    assert missing_pairs(run) == [(0, 0), (0, 1)]
    with one_process():
        assert write_shown(run) == ""
    return run


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> RunData:
    folder = tmp_path_factory.mktemp("own")
    path = write_scenario(folder)
    varied = [parse_variation("simulation.av_share=0.3,1")]
    return run_inline(study_of(read_scenario_file(str(path)), varied), folder / "run")


def test_traces_have_every_passage_and_everybody_at_it(traced: RunData) -> None:
    traces, scenes = traced.traces, read_table(traced.path, "scenes_over").to_pandas()
    passages = traced.passages_over
    keys = ["cell", "pair", "arm"]
    assert scenes.groupby(keys).size().equals(passages.groupby(keys).size())
    assert scenes["crosswalk"].eq(CROSSING).all()
    assert np.array_equal(scenes["begin_s"], passages["trigger_s"])
    assert scenes["vehicle"].tolist() == passages["vehicle"].tolist()
    for scene, row in zip(scenes.to_dict("records"), passages.to_dict("records"), strict=True):
        mine = traces[(traces["pair"] == row["pair"]) & (traces["arm"] == row["arm"])]
        name = f"passage-{scene['passage']}"
        ego = mine[mine["object"] == name]
        # The record counts the steps of the trace, and its end is that of the passage.
        assert ego["time_s"].iloc[0] == scene["begin_s"]
        if row["passed_s"] is not None and not np.isnan(row["passed_s"]):
            assert ego["time_s"].iloc[-1] == pytest.approx(row["passed_s"], abs=scene["step_s"])
        # Places follow from speeds by the way in which the vehicle moves within a step.
        speed = ego["speed_mps"].to_numpy()
        assert scene["motion"] == "euler"
        assert np.diff(ego["x_m"]) == pytest.approx(speed[1:] * scene["step_s"], abs=1e-6)
        walked = [stored_walk(walk) for walk in scene["walks"]]
        assert len(walked) >= row["pedestrians"]
        people = mine[mine["object"].str.startswith(f"{name}-pedestrian")]
        assert {*people["object"]} <= {f"{name}-pedestrian-{w.arrival.index}" for w in walked}
        assert people["y_m"].between(-1e-6, scene["crossing_length_m"] + 1e-6).all()


def test_driven_passages_that_met_nobody_are_no_trials_of_the_fallback(traced: RunData) -> None:
    """The counts of an arm follow from its passages: driven is what got commands."""
    rows, arms = (
        read_table(traced.path, name).to_pandas() for name in ("passages_over", "simulations")
    )
    driven = rows[(rows["strategy"] == "gap_yield") & (rows["commands"] > 0)]
    met = driven[driven["pedestrians"] > 0]
    assert 0 < len(met) < len(driven)
    for row in arms[arms["arm"] == "av"].to_dict("records"):
        assert row["driven"] == (driven["pair"] == row["pair"]).sum()
        assert row["met_driven"] == (met["pair"] == row["pair"]).sum()


def test_the_most_striking_passages_are_those_of_the_record(traced: RunData) -> None:
    rows, chosen = traced.passages_over, chosen_passages(traced)
    for arm, words in ((Arm.AV, "AV's arm"), (Arm.HUMAN, "reference's arm")):
        mine = rows[(rows["arm"] == arm.value) & rows["automated"]]
        smallest = mine.nsmallest(1, "pet_s").iloc[0]
        first = next(each for each in chosen if f"smallest PET, {words}" in each.reasons)
        assert (first.key[1], first.vehicle) == (smallest["pair"], smallest["vehicle"])
    for each in chosen:
        assert each.arm in each.numbers
        for arm, number in each.numbers.items():
            of_arm = rows[(rows["pair"] == each.key[1]) & (rows["arm"] == arm.value)]
            assert of_arm.iloc[number]["vehicle"] == each.vehicle
    # Lorries are no AVs: without a contact nobody watches them.
    lorries = {*rows.loc[rows["type"] == "lorry", "vehicle"]}
    contacts = {*rows.loc[rows["contact_time_s"].notna(), "vehicle"]}
    assert not {each.vehicle for each in chosen} & (lorries - contacts)


def passages(**columns: Any) -> pd.DataFrame:
    """Rows of ``passages_over`` of one arm, made by hand."""
    count = len(next(iter(columns.values())))
    base: dict[str, Any] = {
        "cell": 0,
        "pair": range(count),
        "arm": "av",
        "crosswalk": "c",
        "vehicle": [f"v{number}" for number in range(count)],
        "automated": True,
        **dict.fromkeys(("contact_time_s", "pet_s", "min_ttc_s", "max_drac_mps2"), np.nan),
        "delay_s": 0.0,
    }
    return pd.DataFrame({**base, **columns})


def test_a_contact_comes_before_a_small_pet_and_a_name_before_both() -> None:
    rows = passages(contact_time_s=[np.nan, 2.0, np.nan], pet_s=[0.1, np.nan, 0.5])
    found = [most_striking(rows, *ask) for ask in ((None, None), ("v2", None), (None, "other"))]
    assert [each and each["vehicle"] for each in found] == ["v1", "v2", None]
    without = most_striking(rows.assign(contact_time_s=np.nan))
    assert without is not None
    assert without["vehicle"] == "v0"
    # If nothing is defined but the delay, the longest delay.
    late = most_striking(passages(delay_s=[1.0, 9.0]))
    assert late is not None
    assert late["vehicle"] == "v1"


def test_few_pairs_are_repeated() -> None:
    class Run:
        kept_traces = False
        passages_over = passages(contact_time_s=[1.0] * 9, pet_s=[1.0] * 9)

    run: Any = Run()
    assert len({each.key for each in chosen_passages(run)}) == MOST_PAIRS
    run.kept_traces = True
    assert len({each.key for each in chosen_passages(run)}) == 5
    assert {*chosen_pairs(run)} >= {"contact, AV's arm"}


def test_a_page_shows_what_was_simulated_again(plain: RunData, traced: RunData) -> None:
    assert missing_pairs(plain) == []
    written = write_report(plain)
    assert written.differing == ()
    page = Page(written.page)
    page.has("All records are identical to the stored ones.", "most striking passages of 2 pairs")
    page.has("PET at the crosswalks")
    assert ":crosswalk_c0, vehicle v" in page.source
    # The same passages, state by state, as of the run that kept them.
    document = json.loads(run_player(plain, shown_pairs(plain)).json)
    kept = json.loads(run_player(traced, shown_pairs(traced)).json)
    assert document["scenes"] == kept["scenes"]
    for again, stored in zip(document["episodes"], kept["episodes"], strict=True):
        assert again["arms"] == stored["arms"]
        assert again["note"].endswith("the record is identical to the stored record.")


def test_an_episode_shows_the_same_vehicle_in_both_arms(traced: RunData) -> None:
    player = run_player(traced, shown_pairs(traced))
    chosen = chosen_passages(traced)
    assert len(player.episodes) == len(chosen)
    rows = traced.passages_over
    for episode, passage in zip(json.loads(player.json)["episodes"], chosen, strict=True):
        assert [arm["arm"] for arm in episode["arms"]] == [
            arm.value for arm in Arm if arm in passage.numbers
        ]
        for arm in episode["arms"]:
            (ego,) = arm["vehicles"]
            assert ego["t"][0] == 0
            assert ego["x"][0] <= -29
            number = passage.numbers[Arm(arm["arm"])]
            of_arm = rows[(rows["pair"] == passage.key[1]) & (rows["arm"] == arm["arm"])]
            pet_s = of_arm.iloc[number]["pet_s"]
            assert (f"PET {pet_s:.2f} s" in arm["words"]) == (not np.isnan(pet_s))
    assert [name.partition(",")[0] for name in player.groups] == sorted(
        (name.partition(",")[0] for name in player.groups),
        key=["contact", "smallest PET", "smallest TTC", "largest DRAC", "longest delay"].index,
    )


def test_who_did_not_pass_in_the_other_arm_is_said(plain: RunData) -> None:
    """As if the reference's arm had other passages: its rows lose the vehicle."""
    run = load_run(plain.path)
    rows = run.passages_over
    gone = chosen_passages(run)[0].vehicle
    changed = rows["vehicle"].where((rows["arm"] == "av") | (rows["vehicle"] != gone), "other")
    vars(run)["passages_over"] = rows.assign(vehicle=changed)
    episodes = json.loads(run_player(run, shown_pairs(run)).json)["episodes"]
    (note,) = {each["note"] for each in episodes if f"vehicle {gone}," in each["name"]}
    assert "In the reference's arm it did not pass straight over this crosswalk." in note


def test_shown_pairs_lack_passages_that_are_chosen_later(plain: RunData) -> None:
    from harness.old.store.shards import Shard, read_shard, shard_name

    tables = read_shard(Shard(0, 0, 1, plain.path / SHOWN / shard_name(0, 0, 1)))
    kept = numbers_of(plain, 0, 0)
    assert has_passages(tables, kept)
    assert not has_passages(tables, {*kept, ("av", 10_000)})
    one = {min(kept)}
    part = only_passages(tables, one)
    assert part["scenes_over"].num_rows == 1
    name = f"passage-{min(kept)[1]}"
    assert all(
        each == name or each.startswith(f"{name}-pedestrian")
        for each in part["traces"]["object"].to_pylist()
    )


def test_figures_of_a_sweep_are_over_its_key(swept: RunData) -> None:
    with style.styled():
        pictures = {picture.name: picture for picture in simulation_pictures(swept)}
    assert {*pictures} >= {"over-av-time-loss", "over-people-time-loss", "over-queue-p95"}
    (axes,) = pictures["over-av-time-loss"].figure.axes
    labels = axes.get_legend_handles_labels()[1]
    assert labels == ["AV's arm: gap_yield", "reference: sumo_driver"]
    drawn = axes.containers[0].lines[0].get_ydata()  # type: ignore[attr-defined]
    assert drawn == pytest.approx(swept.summary["av_time_loss_s"].to_numpy())


def test_a_folder_that_lost_its_scenes_is_refused(traced: RunData, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(traced.path, folder)
    (folder / "scenes_over.parquet").unlink()
    with pytest.raises(harness.InputError, match="scenes_over"):
        load_run(folder)


def test_a_run_is_shown_after_its_scenario_has_changed(traced: RunData, tmp_path: Path) -> None:
    config = traced.path.parent / "town.sumocfg"
    text = config.read_text()
    try:
        config.write_text(text.replace('value="70"', 'value="60"'))
        problem = refusal("replay", traced.path, "--pair", "0", "--out", tmp_path / "again")
        assert "simulation.config: the files of" in problem
        config.unlink()
        assert load_run(traced.path).summary.equals(traced.summary)
        for command in ("report", "worst"):
            printed(command, traced.path)
    finally:
        config.write_text(text)
