"""Drivers in place of those of made-up recordings, who are ours, so the truth is known."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from harness.model.interaction import load_model
from harness.model.trajectories.rules import ExtractionRules
from harness.model.trajectories.tracks import Clip, Track, VehicleTrack
from harness.results.estimators import Sampling
from harness.results.result import Result
from harness.scenario import load_scenario
from harness.strategies.gap_yield import GapYield
from harness.strategies.hard_yield import HardYield
from harness.strategies.human_recorded import HumanRecorded
from harness.studies.models.recorded_passages import find_passages
from harness.studies.models.validation import DRIVES, models_without, pass_time_score, scores_of
from tests.batches import printed
from tests.recordings import DRIVERS, LENGTH_M, RATE_HZ, SCENES, held, write_set
from tests.scenes import refusal_of

NUMBERS = (
    *("pass_time_score_s", "pass_time_error_mean_s", "pass_time_error_median_s", "order_right"),
    *("contacts", "timed_out"),
)


def values(record: Mapping[str, Any]) -> list[float]:
    return [record[key].value for key in NUMBERS]


def notes(result: Result) -> dict[str, str]:
    return {note.key: note.text for note in result.notes}


@pytest.mark.parametrize("driver", DRIVERS)
def test_the_strategy_that_drove_is_the_nearest(tmp_path: Path, driver: str) -> None:
    nearest, *others = held(write_set(tmp_path, DRIVERS[driver])).records
    assert nearest["driver"] == driver
    assert nearest["pass_time_score_s"].value < 0.05
    assert nearest["order_right"].value == 1.0
    assert min(other["pass_time_score_s"].value for other in others) > 0.05


def test_a_recording_mirrored_turned_or_shifted_in_time_has_the_same_numbers(
    tmp_path: Path,
) -> None:
    plain = held(write_set(tmp_path / "plain", HardYield))
    for name, change in ("mirrored", True), ("shift_frames", 1234), ("turn", 2.0):
        other = held(write_set(tmp_path / name, HardYield, **{name: change}))
        for one, same in zip(plain.records, other.records, strict=True):
            assert values(same) == pytest.approx(values(one), abs=1e-6), (name, one["driver"])


Positions = tuple[np.ndarray, np.ndarray]


def passages_of(vehicle: Positions, *people: Positions):
    clip = Clip(
        "made up",
        "clip",
        {"0": VehicleTrack(*vehicle, LENGTH_M, LENGTH_M / 2)},
        {str(number): Track(*one) for number, one in enumerate(people)},
    )
    return find_passages([clip], load_scenario("cctc").vehicle(), 0.1, ExtractionRules())


def straight(
    speed_mps: float,
    until_s: float = 14.0,
    start_m: float = -30.0,
    gap: tuple[float, float] = (99, 0),
) -> Positions:
    time_s = np.arange(0, until_s, 0.1)
    time_s = time_s[(time_s < gap[0]) | (time_s > gap[1])]
    return time_s, np.column_stack([start_m + speed_mps * time_s, 0 * time_s])


def walking(x_m: float, start_m: float, speed_mps: float, until_s: float = 14.0) -> Positions:
    time_s = np.arange(0, until_s, 0.1)
    return time_s, np.column_stack([x_m + 0 * time_s, start_m + speed_mps * time_s])


@pytest.mark.parametrize(
    ("reason", "vehicle", "people"),
    [
        ("parked vehicle", straight(0.0), [walking(0.0, -8.0, 1.3)]),
        ("nobody crosses", straight(4.0), []),
        ("nobody crosses", straight(4.0), [walking(0.0, -3.0, 0.0)]),
        ("nobody crosses", straight(4.0), [walking(0.0, -9.0, -1.0)]),
        ("record begins too near", straight(2.0, start_m=-6.0), [walking(0.0, -8.0, 1.3)]),
        ("gap in a record", straight(4.0, gap=(3.0, 4.0)), [walking(0.0, -8.0, 1.3)]),
        ("pass not recorded", straight(4.0, until_s=6.0), [walking(0.0, -8.0, 1.3)]),
        ("nobody left at the start", straight(4.0, 22.0, -60.0), [walking(0.0, -8.0, 1.4)]),
    ],
)
def test_what_is_no_passage_is_counted_and_left_out(
    reason: str, vehicle: Positions, people: list[Positions]
) -> None:
    assert passages_of(vehicle, *people) == ([], {reason: 1})


def test_the_frame_of_a_passage_is_its_groups() -> None:
    # Three cross at x = -3, 0 and 1 after the car has come from far; a fourth crosses 20 m later.
    people = [walking(x, -20.0, 1.3, 30.0) for x in (-3.0, 0.0, 1.0, 21.0)]
    (one, other), _ = passages_of(straight(4.0, 25.0, -60.0), *people)
    assert one.crossing.width_m == pytest.approx(4.0)
    assert sorted(each.conflict_x_m for each in one.people) == pytest.approx([-3.0, 0.0, 1.0])
    assert [each.conflict_x_m for each in other.people] == pytest.approx([0.0])
    # The front bumper, 2.25 m ahead of the recorded centre, is first at most 30.05 m away here:
    # -60 + 2.25 + 4 t, t = 7.0 s.
    assert one.vehicle.trigger_range_m == pytest.approx(29.75)
    # They pass the path at y = 0 after 20/1.3 s, 7 s of which lie before the start.
    passing_s = [each.passing_s for each in one.people]
    assert passing_s == pytest.approx([20 / 1.3 - 7.0] * 3)
    assert (one.start_speed_mps, one.vehicle.initial_speed_mps) == pytest.approx((4.0, 4.0))
    # Rear over the far edge: 29.75 + 2 + 4.5 m at 4 m/s.
    assert (len(one.x_m) - 1) * 0.1 == pytest.approx(36.25 / 4, abs=0.1)


def test_walks_go_on_before_and_after_their_records() -> None:
    # Seen only from y = -2 to 2: on the path at y = 0 when the whole walk would be.
    time_s, place = walking(0.0, -6.0, 1.0, 12.0)
    seen = (time_s >= 4.0) & (time_s <= 8.0)
    (cut,), _ = passages_of(straight(4.0), (time_s[seen], place[seen]))
    (full,), _ = passages_of(straight(4.0), (time_s, place))
    for one, other in zip(cut.people, full.people, strict=True):
        assert one.passing_s == pytest.approx(other.passing_s)
        assert one.arrival.arrival_s == pytest.approx(other.arrival.arrival_s)
        for path in (one.arrival.path, other.arrival.path):
            assert path is not None
            assert path[-1].y_mps == pytest.approx(1.0)


def test_the_command_shows_the_result_and_writes_its_page(tmp_path: Path) -> None:
    # A name says nothing: human_recorded was fitted on other recordings of that name.
    folder, page = write_set(tmp_path / "dut", HardYield), tmp_path / "page.html"
    drivers = "emergency_brake,hard_yield,human_recorded,tests.planner:Planner"
    words = ["validate", folder, "--format", "vci", "--set", f"frame_rate_hz={RATE_HZ:g}"]
    words += ["--set", f"vehicle_length_m={LENGTH_M}", "--drivers", drivers]
    told = json.loads(printed(*words, "--json", "--out", page))
    assert {record["driver"] for record in told["records"]} == {*drivers.split(",")}
    assert {record["fitted_on_these_data"] for record in told["records"]} == {False}
    assert told["records"][0]["driver"] == "hard_yield"
    assert told["records"][0]["pass_time_score_s"]["value"] < 0.05
    assert (told["facts"]["data"], told["facts"]["passages"]) == ("dut", len(SCENES))
    text = page.read_text("utf-8")
    assert "Drivers in place of those recorded in dut" in text
    assert (text.count("<svg"), text.count('href="#episodes"')) == (2, 0)
    assert printed(*words, "--quiet").split()[0] == "hard_yield"


def test_one_vehicle_has_no_intervals_however_often_it_is_copied(tmp_path: Path) -> None:
    clips = write_set(tmp_path, HardYield) / "trajectories_filtered"
    for file in clips.glob("clip_*"):
        file.write_text((clips / f"clip_00{file.name[7:]}").read_text())
    found = held(tmp_path)
    assert {record["pass_time_score_s"].low for record in found.records} == {None}
    assert next(note.key for note in found.notes) == "few_vehicles"
    assert "1 vehicle" in notes(found)["few_vehicles"]


def test_the_score_of_a_random_driver() -> None:
    # CRPS = integral of (F(x) - 1{x >= y})²; F of the draws themselves is the biased version, so
    # many draws are held against the closed form for the uniform distribution on 0 … 1, y = 0.3:
    # y³/3 + (1 - y)³/3.
    draws = (np.arange(1000) + 0.5) / 1000
    assert pass_time_score(draws - 0.3) == pytest.approx(0.3**3 / 3 + 0.7**3 / 3, abs=1e-3)


def test_draws_and_passages_have_the_weight_of_their_passage_and_vehicle() -> None:
    """Two vehicles: one with a passage of two draws, one with two passages of two equal draws."""
    rows = [
        {"vehicle": "a", "passage": 0, "error_s": 1.0, "right": 2.0, "people": 4.0},
        {"vehicle": "a", "passage": 0, "error_s": 3.0, "right": 4.0, "people": 4.0},
        *2 * [{"vehicle": "b", "passage": 1, "error_s": -1.0, "right": 1.0, "people": 1.0}],
        *2 * [{"vehicle": "b", "passage": 2, "error_s": 5.0, "right": 0.0, "people": 1.0}],
    ]
    counts = {"contacts": [0, 1] + [0] * 4, "timed_out": [0] * 6, "uses": [2] * 6}
    found = scores_of(pd.DataFrame(rows).assign(**counts, clamped=[1] + [0] * 5), Sampling(None))
    # Scores: E|e| − ½ E|e − e'| = 2 − 1, 1 and 5; errors 2, −1, 5; order (3 + 1 + 0) of 6.
    assert found["pass_time_score_s"].value == pytest.approx((1 + 1 + 5) / 3)
    assert found["pass_time_error_mean_s"].value == pytest.approx((2 - 1 + 5) / 3)
    assert found["order_right"].value == pytest.approx(4 / 6)
    assert (found["contacts"].value, found["clamped_share"].value) == (0.5, 1 / 12)
    assert str(found["pass_time_score_s"].reason).startswith("2 vehicles")


@pytest.mark.parametrize(
    ("words", "drivers", "options"),
    [
        (("driver hard_yeild", "hard_yield"), ["hard_yeild"], {}),
        (("driver ",), ["hard_yield", ""], {}),
        (("driver sumo_driver", "[simulation]"), ["sumo_driver"], {}),
        (("no passage", "begins too near 4"), ["hard_yield"], {"vehicle_length_m": 60.0}),
        (("strategies.hard_yield", "p1"), ["hard_yield"], {"strategies.hard_yield.p1": 1.0}),
        (("unknown key", "vehicle_lenth_m"), ["hard_yield"], {"vehicle_lenth_m": 4.0}),
        (("ego.lane: has no effect", "ego.width_m"), ["hard_yield"], {"ego.lane": 0}),
        (("soft_yield.p1: has no effect",), ["hard_yield"], {"strategies.soft_yield.p1": 1.0}),
    ],
)
def test_what_is_refused(
    tmp_path: Path, words: tuple[str, ...], drivers: list[str], options: dict[str, Any]
) -> None:
    folder = write_set(tmp_path, HardYield)
    refusal_of(lambda: held(folder, drivers, **options), *words)


def test_a_driver_that_draws_is_driven_often(tmp_path: Path) -> None:
    """Contacts and time-outs of random drivers are means over draws."""
    folder = write_set(tmp_path, HardYield)
    once = held(folder, ["hard_yield", "human_gmm"], **{"strategies.human_gmm.speed": "mode"})
    often = held(folder, ["human_yield"], **{"strategies.human_yield.yield_rate": 0.5})
    people = sum(len(people) for _, people in SCENES)
    for record in once.records:
        assert float(record["order_right"].value * people).is_integer()
    share = often.records[0]["order_right"].value * people
    assert share * DRIVES == pytest.approx(round(share * DRIVES))
    assert not float(share).is_integer()
    # 2.5 times as fast, so beyond the 8 m/s of the model's data.
    fast = held(folder, ["human_gmm"], frame_rate_hz=2.5 * RATE_HZ)
    assert fast.records[0]["clamped_share"].value > 0.1
    assert "human_gmm" in notes(fast)["outside_model"]


def optimistic(result: Result) -> set[str]:
    return {str(record["driver"]) for record in result.records if record["fitted_on_these_data"]}


def renamed(folder: Path, copy: Path, noise_m: float) -> Path:
    """The recordings under other names, their records in another order, each a little off."""
    rng = np.random.default_rng(8)
    copy.mkdir()
    for file in sorted((folder / "trajectories_filtered").glob("clip_0[12]*.csv")):
        table = pd.read_csv(file).sample(frac=1.0, random_state=3)
        for name in ("x_est", "y_est"):
            table[name] += rng.uniform(-noise_m, noise_m, len(table))
        table["id"], table["frame"] = table["id"] + 70, table["frame"] + 1234
        table.to_csv(copy / file.name.replace("clip_0", "camera_5"), index=False)
    return copy


def model_of(folder: Path, path: Path) -> str:
    """A model fitted on recordings, by ``harness extract`` and ``harness fit``."""
    rows, reader = path.with_suffix(".parquet"), f"frame_rate_hz={RATE_HZ:g}"
    printed("extract", "--format", "vci", folder, "--set", reader, "--out", rows)
    printed("fit", rows, "--components", 1, "--starts", 1, "--folds", 0, "--out", path)
    return str(path)


def test_recordings_that_a_model_was_fitted_on_are_known_whatever_they_are_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recordings = write_set(tmp_path / "made", HardYield)
    own = {"model.path": model_of(recordings, tmp_path / "own.json")}
    card = load_model("own", own["model.path"]).provenance
    assert len(card["tracks"]) == card["vehicles"] == len(SCENES)
    drivers = ("human_gmm", "human_recorded", "hard_yield")
    other = renamed(recordings, tmp_path / "elsewhere", noise_m=9e-4)
    cases = (recordings, {"source": "x"}, len(SCENES)), (other, {"frame_rate_hz": 12.0}, 2)
    for folder, options, known in (*cases, (other, {}, 2)):
        found = held(folder, drivers, **own, **options)
        folds = {record["driver"]: record["folds"] for record in found.records}
        assert folds == {"human_gmm": known, "human_recorded": 0, "hard_yield": 0}, folder
        assert optimistic(found) == set()
    strangers = write_set(tmp_path / "strangers" / "made", GapYield)
    strange = held(strangers, drivers, **own)
    assert {record["folds"] for record in strange.records} == {0}
    assert optimistic(strange) == set()
    # A strategy names the shipped model whose data it was fitted on.
    assert HumanRecorded.FITTED_ON == "dut"
    model = load_model("own", own["model.path"])
    monkeypatch.setattr("harness.studies.models.validation.load_model", lambda *_: model)
    found = held(other, drivers)
    assert optimistic(found) == {"human_recorded"}
    assert "human_recorded: fitted on these" in notes(found)["fitted_on_these_data"]
    # Of one vehicle nothing is left to fit a model without it.
    for file in other.glob("camera_52*"):
        file.unlink()
    assert optimistic(held(other, drivers)) == {"human_gmm", "human_recorded"}


def test_a_vehicle_is_driven_by_a_model_that_has_not_seen_it(tmp_path: Path) -> None:
    """Whatever one vehicle does: the models of its passages stay, those of all others change."""
    folder = write_set(tmp_path / "made", HardYield)
    model = load_model("own", model_of(folder, tmp_path / "own.json"))
    rows = pd.read_parquet(tmp_path / "own.parquet")
    vehicles = sorted(set(zip(rows["source"], rows["clip"], rows["vehicle"], strict=True)))
    changed = rows.copy()
    changed.loc[changed["clip"] == vehicles[0][1], "vehicle_speed_mps"] *= 0.9
    before, after = (models_without(model, of, len(vehicles), 1) for of in (rows, changed))
    places = ([of[name].mixture.locations for name in vehicles] for of in (before, after))
    kept = [np.array_equal(*pair) for pair in zip(*places, strict=True)]
    assert kept == [True] + [False] * (len(vehicles) - 1)


def test_a_card_without_tracks_leaves_it_open_and_says_so(tmp_path: Path) -> None:
    recordings = write_set(tmp_path, HardYield)
    path = Path(model_of(recordings, tmp_path / "own.json"))
    document = json.loads(path.read_text())
    del document["provenance"]["tracks"]
    path.write_text(json.dumps(document))
    found = held(recordings, ("human_gmm",), **{"model.path": str(path)})
    assert [record["fitted_on_these_data"] for record in found.records] == [None]
    assert "unknown whether the model was fitted" in notes(found)["fitted_on_unknown_data"]
