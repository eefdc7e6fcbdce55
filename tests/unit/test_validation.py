"""Drivers held against made-up recordings whose driver is one of ours, so the truth is known."""

import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.model.interaction import load_model
from harness.model.trajectories import Clip, Track, VehicleTrack
from harness.old.report.screens.validation_tables import print_validation
from harness.old.statistics.entries import Finding
from harness.old.statistics.findings import Note, Rank
from harness.old.studies.validation import (
    ENTRIES,
    LEFT_OUT,
    DriverFindings,
    Validation,
    ValidationFindings,
    bootstrap,
    find_passages,
)
from harness.old.studies.validation.bootstrap import few_vehicles
from harness.old.studies.validation.drivers import DRAWS, FoldModels, outcomes_of
from harness.old.studies.validation.figures import Drives, findings_of, pass_time_score
from harness.scenario import load_scenario
from harness.strategies.gap_yield import GapYield
from harness.strategies.hard_yield import HardYield
from tests.batches import printed
from tests.recordings import DRIVERS, LENGTH_M, RATE_HZ, SCENES, held, write_set
from tests.scenes import refuses

SCREEN = Path(__file__).parents[1] / "data" / "validation" / "full.txt"


@pytest.fixture(autouse=True)
def _few_resamples(monkeypatch) -> None:
    monkeypatch.setattr(bootstrap, "RESAMPLES", 50)


@pytest.mark.parametrize("driver", DRIVERS)
def test_the_strategy_that_drove_is_ranked_first(tmp_path, driver) -> None:
    found = held(write_set(tmp_path, DRIVERS[driver]))
    assert len(found.passages.used) == len(SCENES)
    nearest, *others = found.findings.drivers
    assert nearest.driver == driver
    errors = [
        one.pass_time_s - real.pass_time_s
        for (one,), real in zip(found.outcomes[driver], found.recorded, strict=True)
    ]
    assert np.abs(errors).max() < 0.05
    assert nearest.findings["order_right"].value == 1.0
    assert nearest.findings["position_rmse_4s_m"].value < 0.05
    assert min(other.findings["pass_time_score_s"].value for other in others) > 0.05


def test_a_recording_mirrored_turned_or_shifted_in_time_gives_the_same_figures(tmp_path) -> None:
    plain = held(write_set(tmp_path / "plain", HardYield))
    for name, change in ("mirrored", True), ("shift_frames", 1234), ("turn", 2.0):
        other = held(write_set(tmp_path / name, HardYield, **{name: change}))
        for driver, same in zip(plain.findings.drivers, other.findings.drivers, strict=True):
            for key, finding in driver.findings.items():
                value = pytest.approx(finding.value, abs=1e-6)
                assert same.findings[key].value == value, (name, driver.driver, key)


def clip_of(vehicles, pedestrians):
    return Clip(
        "made up",
        "clip",
        {key: VehicleTrack(t, xy, LENGTH_M, LENGTH_M / 2) for key, (t, xy) in vehicles.items()},
        {key: Track(t, xy) for key, (t, xy) in pedestrians.items()},
    )


def straight(speed_mps, until_s=14.0, start_m=-30.0, *, y_m=0.0, gap=None):
    time_s = np.arange(0, until_s, 0.1)
    if gap is not None:
        time_s = time_s[(time_s < gap[0]) | (time_s > gap[1])]
    return time_s, np.column_stack([start_m + speed_mps * time_s, y_m + 0 * time_s])


def walking(x_m, start_m, speed_mps, until_s=14.0):
    time_s = np.arange(0, until_s, 0.1)
    return time_s, np.column_stack([x_m + 0 * time_s, start_m + speed_mps * time_s])


@pytest.mark.parametrize(
    ("reason", "vehicle", "people"),
    [
        ("parked_vehicle", straight(0.0), [walking(0.0, -8.0, 1.3)]),
        ("no_pedestrian", straight(4.0), []),
        ("only_standing_pedestrians", straight(4.0), [walking(0.0, -3.0, 0.0)]),
        ("nobody_crosses", straight(4.0), [walking(0.0, -9.0, -1.0)]),
        ("begins_too_near", straight(2.0, start_m=-6.0), [walking(0.0, -8.0, 1.3)]),
        ("gap", straight(4.0, gap=(3.0, 4.0)), [walking(0.0, -8.0, 1.3)]),
        ("pass_not_recorded", straight(4.0, until_s=6.0), [walking(0.0, -8.0, 1.3)]),
        ("nobody_left", straight(4.0, 22.0, -60.0), [walking(0.0, -8.0, 1.4)]),
    ],
)
def test_what_is_no_passage_is_counted_and_left_out(reason, vehicle, people) -> None:
    clip = clip_of({"0": vehicle}, {str(number): one for number, one in enumerate(people)})
    found = find_passages([clip], load_scenario("cctc").vehicle(), 0.1)
    assert found.used == ()
    assert {name: count for name, count in found.left_out.items() if count} == {reason: 1}
    assert set(found.left_out) == set(LEFT_OUT)


def test_the_frame_of_a_passage_is_its_groups() -> None:
    # Three cross at x = -3, 0 and 1 after the car has come from far; a fourth crosses 20 m later.
    people = [walking(x, -20.0, 1.3, 30.0) for x in (-3.0, 0.0, 1.0, 21.0)]
    clip = clip_of({"0": straight(4.0, 25.0, -60.0)}, dict(zip("abcd", people, strict=True)))
    one, other = find_passages([clip], load_scenario("cctc").vehicle(), 0.1).used
    assert one.crossing.width_m == pytest.approx(4.0)
    assert sorted(one.conflict_x_m) == pytest.approx([-3.0, 0.0, 1.0])
    assert other.conflict_x_m == pytest.approx([0.0])
    # The front bumper, 2.25 m ahead of the recorded centre, is first at most 30.05 m away here:
    # -60 + 2.25 + 4 t, t = 7.0 s.
    assert one.vehicle.trigger_range_m == pytest.approx(29.75)
    assert one.start_speed_mps == pytest.approx(4.0)
    # They pass the path at y = 0 after 20/1.3 s, 7 s of which lie before the start.
    assert one.passing_s == pytest.approx(20 / 1.3 - 7.0)
    assert one.vehicle.initial_speed_mps == pytest.approx(4.0)
    # Rear over the far edge: 29.75 + 2 + 4.5 m at 4 m/s.
    assert (len(one.x_m) - 1) * 0.1 == pytest.approx(36.25 / 4, abs=0.1)


def test_walks_go_on_before_and_after_their_records() -> None:
    # Seen only from y = -2 to 2: on the path at y = 0 when the whole walk would be.
    time_s, place = walking(0.0, -6.0, 1.0, 12.0)
    seen = (time_s >= 4.0) & (time_s <= 8.0)
    clip = clip_of({"0": straight(4.0, 14.0, -30.0)}, {"p": (time_s[seen], place[seen])})
    whole = clip_of({"0": straight(4.0, 14.0, -30.0)}, {"p": (time_s, place)})
    limits = load_scenario("cctc").vehicle()
    (cut,), (full,) = (find_passages([one], limits, 0.1).used for one in (clip, whole))
    assert cut.passing_s == pytest.approx(full.passing_s)
    assert cut.arrivals[0].arrival_s == pytest.approx(full.arrivals[0].arrival_s)
    assert cut.extended == (True,)
    assert full.extended == (False,)


def test_the_command_prints_an_object_for_each_driver_and_writes_a_page(tmp_path) -> None:
    # A name says nothing: human_recorded was fitted on other recordings of that name.
    folder = write_set(tmp_path / "dut", HardYield)
    drivers = "emergency_brake,hard_yield,human_recorded"
    words = ["validate", str(folder), "--format", "vci", "--set", f"frame_rate_hz={RATE_HZ:g}"]
    words += ["--set", f"vehicle_length_m={LENGTH_M}", "--drivers", drivers]
    told = json.loads(printed(*words, "--json", "--out", tmp_path / "out"))
    first = told[0]
    assert {one["driver"] for one in told} == set(drivers.split(","))
    assert [one["driver"] for one in told if one["fitted_on_these_data"]] == []
    assert first["driver"] == "hard_yield"
    assert (first["rank"], first["passages"], first["contacts"]) == (1, len(SCENES), 0)
    assert first["pass_time_error_median_s"] < 0.05
    assert {"pass_time_error_mean_s", "pass_time_error_p90_s", "order_right"} <= first.keys()
    page = (tmp_path / "out" / "validation.html").read_text(encoding="utf-8")
    assert "Drivers compared with recordings of dut, nearest first" in page
    assert "was fitted on these passages" not in page
    assert page.count("<svg") == 2
    assert json.loads((tmp_path / "out" / "validation.json").read_text()) == told


def test_one_vehicle_has_no_intervals_and_tells_nobody_apart(tmp_path) -> None:
    target = write_set(tmp_path, HardYield) / "trajectories_filtered"
    for file in target.glob("clip_*"):
        if not file.name.startswith("clip_00"):
            file.unlink()
    found = held(tmp_path)
    assert found.passages.vehicles == 1
    # The differences are there, but one vehicle does not say how others differ from it.
    assert found.findings.drivers[-1].score_difference_s > 0.05
    for driver in found.findings.drivers:
        assert set(driver.not_told_apart) == set(DRIVERS) - {driver.driver}
        assert driver.score_difference_interval_s is None
        assert {finding.low for finding in driver.findings.values()} == {None}
    doubt = "One vehicle gives no intervals, so no difference between drivers is significant."
    assert doubt in found.findings.remarks
    score = found.findings.drivers[0].findings["pass_time_score_s"]
    assert (score.reliable, score.reason) == (False, doubt)


def test_what_was_left_out_of_the_records_and_assumed_of_them_is_said(tmp_path) -> None:
    target = write_set(tmp_path, HardYield) / "trajectories_filtered"
    with (target / "clip_01_traj_ped_filtered.csv").open("a") as file:
        file.write("7,1,ped,here,0.0\n")
    (target / "clip_00_traj_ped_filtered.csv").write_text("id,frame,label,x_est,y_est\n")
    arguments = ["validate", str(tmp_path), "--format", "vci", "--drivers", "hard_yield"]
    shown = " ".join(printed(*arguments, "--set", "vehicle_length_m=4.5").split())
    assert "1 records left out: a needed cell has text instead of a number" in shown
    assert "Clip clip_00 not used: clip_00_traj_ped_filtered.csv" in shown
    assert "frame_rate_hz = 23.976 frames per second (assumed" in shown


def test_what_few_vehicles_mean_for_an_interval_and_the_score_of_a_random_model() -> None:
    # The middle 95 % of the bootstrap means of five normal values, 2,000 times.
    rng = np.random.default_rng(1)
    values = rng.normal(size=(2_000, 5))
    means = values[:, rng.integers(0, 5, (400, 5))].mean(axis=-1)
    low, high = np.quantile(means, [0.025, 0.975], axis=1)
    held_0 = float(np.mean((low <= 0) & (high >= 0)))
    words = "Intervals from 5 vehicles are unreliable: they cover a mean in at most 85 %, not 95 %."
    assert few_vehicles(5) == words
    assert held_0 == pytest.approx(0.83, abs=0.03)
    # CRPS = integral of (F(x) - 1{x >= y})²; F of the draws themselves is the biased version, so
    # many draws are held against the closed form for the uniform distribution on 0 … 1, y = 0.3:
    # y³/3 + (1 - y)³/3.
    draws = (np.arange(1000) + 0.5) / 1000
    assert pass_time_score(draws, 0.3) == pytest.approx(0.3**3 / 3 + 0.7**3 / 3, abs=1e-3)


def test_passages_without_a_pet_are_counted_and_so_are_the_contacts_among_them() -> None:
    # Five passages of two draws.  Passage 0 has contacts in both draws, passage 1 in one; passage 2
    # has no PET without a contact.  In passages 3 and 4 the PET is 2 s; the recorded one is 3 s.
    ones, nan = np.ones(5), np.nan
    pet_s = np.array([[nan, nan, 3], [nan, 2, 3], [nan, nan, 3], [2, 2, 3], [2, 2, 3]])
    columns = dict.fromkeys(Drives.__dataclass_fields__, ones)
    columns |= {name: np.ones((5, 3)) for name in ("least_speed_mps", "time_advantage_s")}
    columns |= {"error_s": np.ones((5, 2)), "squared_m2": np.ones((5, 3)), "pet_s": pet_s}
    columns |= {"contact": np.array([1, 0.5, 0, 0, 0])}
    found = findings_of(Drives(**columns), [], None)
    assert (found["pet_distance_s"].value, found["pet_distance_s"].n) == (1.0, 2)
    assert found["pet_contacts"].value == 2
    assert found["position_rmse_4s_m"].n == 5


def test_every_number_of_a_validation_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    values = dict.fromkeys((entry.key for entry in ENTRIES), Finding(0.5, 0.25, 0.75))
    first = values | {"pass_time_score_s": Finding(2.51, 1.68, 3.41), "contacts": Finding(11.6)}
    # 12 of 34 passages are contacts and have no PET.
    first |= {"pet_distance_s": Finding(0.5, 0.25, 0.75, n=22), "pet_contacts": Finding(12.0)}
    second = values | {"pass_time_score_s": Finding(None)}
    told = ("human_gmm", "human_recorded")
    counts = {"passages": 34, "vehicles": 26, "encounters": 497, "contacts_recorded": 2}
    note = Note(Rank.REFERENCE, "human_gmm was fitted on these passages, which flatters it.")
    drivers = (
        DriverFindings("human_gmm", 1, (), 0.0, None, 1, True, 0, first),
        DriverFindings("human_yield", 2, told, 1.0, (0.5, 1.5), 20, False, 5, second),
    )
    left_out = dict.fromkeys(LEFT_OUT, 3)
    findings = ValidationFindings(
        sources=("dut",), left_out=left_out, remarks=(), notes=(note,), drivers=drivers, **counts
    )
    print_validation(findings, full=True)
    assert capsys.readouterr().out == SCREEN.read_text(encoding="utf-8")


def test_unknown_drivers_and_sets_without_passages_are_refused(tmp_path) -> None:
    folder = write_set(tmp_path, HardYield)
    refuses("hard_yield", lambda: held(folder, ["hard_yeild"]))
    refuses("twice", lambda: held(folder, ["hard_yield", "hard_yield"]))
    refuses("sumo_driver", lambda: held(folder, ["sumo_driver"]))
    refuses("begins_too_near: 4", lambda: held(folder, ["hard_yield"], vehicle_length_m=60.0))


def test_a_driver_that_draws_is_driven_often(tmp_path) -> None:
    passages = held(write_set(tmp_path, HardYield), ["hard_yield"]).passages.used[:1]
    model = load_model("dut")
    counts = {}
    for name, settings in (
        # One in a thousand yields: two equal drives are no sign of a driver who draws nothing.
        ("human_yield", {"strategies.human_yield.yield_rate": 0.001}),
        ("human_yield", {"strategies.human_yield.yield_rate": 0.5}),
        ("human_gmm", {"strategies.human_gmm.speed": "sampled"}),
        ("human_gmm", {}),
        ("hard_yield", {}),
    ):
        found = outcomes_of(name, passages, load_scenario("cctc", settings), lambda _: model)
        assert len(found) == len(passages)
        counts[name, *settings.values()] = {len(of) for of in found}
    assert counts == {
        ("human_yield", 0.001): {DRAWS},
        ("human_yield", 0.5): {DRAWS},
        ("human_gmm", "sampled"): {DRAWS},
        ("human_gmm",): {1},
        ("hard_yield",): {1},
    }


def test_a_passage_is_driven_by_the_model_that_has_not_seen_its_vehicle(tmp_path) -> None:
    passages = held(write_set(tmp_path, HardYield), ["hard_yield"]).passages.used
    whole, *folds = (load_model("dut") for _ in range(3))
    fold_of = {passage.vehicle_id: n for n, passage in enumerate(passages[:2])}
    models = FoldModels(whole, folds, fold_of)
    assert [models(passage) for passage in passages[:3]] == [*folds, whole]


def in_sample(validation: Validation) -> set[str]:
    drivers = validation.findings.drivers
    return {driver.driver for driver in drivers if driver.fitted_on_these_data}


def renamed(folder: Path, copy: Path, noise_m: float = 0.0) -> Path:
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


def model_of(folder: Path, path: Path) -> dict[str, str]:
    """A model fitted on recordings, by ``harness extract`` and ``harness fit``."""
    rows, reader = path.with_suffix(".parquet"), f"frame_rate_hz={RATE_HZ:g}"
    printed("extract", "--format", "vci", folder, "--set", reader, "--out", rows)
    printed("fit", rows, "--components", "1", "--starts", "1", "--out", path)
    return {"model.path": str(path)}


def test_recordings_that_a_model_was_fitted_on_are_known_whatever_they_are_called(
    tmp_path, monkeypatch
) -> None:
    recordings = write_set(tmp_path / "made", HardYield)
    own = model_of(recordings, tmp_path / "own.json")
    card = load_model("own", own["model.path"]).provenance
    assert len(card["tracks"]) == card["vehicles"] == len(SCENES)
    drivers = ("human_gmm", "human_recorded", "hard_yield")
    model = load_model("own", own["model.path"])
    module = import_module("harness.old.studies.validation.validate")
    monkeypatch.setattr(module, "load_model", lambda *_: model)
    other = renamed(recordings, tmp_path / "elsewhere", noise_m=9e-4)
    for folder, options in (
        (recordings, {"source": "x"}),
        (other, {}),
        (other, {"frame_rate_hz": 12.0}),
    ):
        found = held(folder, drivers, settings=own, **options)
        assert in_sample(found) == {"human_gmm", "human_recorded"}, folder
    refitted = held(other, drivers, folds=2, settings=own)
    folds = {driver.driver: driver.folds for driver in refitted.findings.drivers}
    assert folds == {"human_gmm": 2, "human_recorded": 0, "hard_yield": 0}
    strangers = write_set(tmp_path / "strangers" / "made", GapYield)
    assert in_sample(held(strangers, drivers, settings=own)) == set()


def test_a_card_without_tracks_leaves_it_open_and_says_so(tmp_path) -> None:
    recordings = write_set(tmp_path, HardYield)
    own = model_of(recordings, tmp_path / "own.json")
    path = Path(own["model.path"])
    document = json.loads(path.read_text())
    del document["provenance"]["tracks"]
    path.write_text(json.dumps(document))
    found = held(recordings, ("human_gmm",), settings=own)
    assert in_sample(found) == set()
    assert "unknown whether the model was fitted to these data" in " ".join(found.findings.remarks)
