"""A run of hours as a user sees it: tables, bytes on any number of workers, page, refusals."""

import json
from collections import Counter
from contextlib import chdir
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from harness.core.encounter import Arm
from harness.core.errors import InputError, InterruptedRunError
from harness.encounter.traffic.demand import scheduled_vehicle
from harness.old.report.pages.hour_pictures import time_space
from harness.old.report.pages.page import write_report
from harness.old.report.pages.player import run_player
from harness.old.store.schemas import HOUR_TABLES
from harness.old.studies.batch.experiment import resume, run_study
from harness.old.studies.batch.showing import write_shown
from harness.old.studies.replay.rerun import replay
from harness.old.studies.runs.opening import load_run
from harness.old.studies.runs.reported import reported
from harness.old.studies.runs.shown import shown_pairs
from harness.old.studies.workers.pool import LocalPool
from harness.scenario import (
    Options,
    Setting,
    Study,
    read_scenario_file,
    study_of,
)
from tests.batches import Inline, one_process, printed, run_inline, shell, start, wait_for
from tests.sumo.test_watch import PEDESTRIAN, needs_xvfb, pixels, watched

AV = (0, 114, 178)
"""The colour of its type: no ego is followed in an hour."""

SCENARIO = """
arms = {av = "gap_yield", human = "human_yield"}
ego = {initial_speed_mps = 8.0}
pedestrians = {flow_per_hour = 600}
experiment = {pairs = 2}
[traffic]
flow_per_hour = 300
oncoming_per_hour = 200
av_share = 0.5
duration_s = 70
warm_up_s = 20
"""

WARM_UP_S, STEP_S, QUEUED_MPS = 20.0, 0.1, 5 / 3.6

FAULTY = """
class Faulty:
    def __init__(self, *, rng):
        self.number = rng.random()

    def decide(self, observation):
        if self.number < 0.6:
            DOES
        return 0.0
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The same study in this process and on two workers, the second with traces."""
    folder = tmp_path_factory.mktemp("hours")
    (folder / "busy.toml").write_text(SCENARIO, encoding="utf-8")
    file = read_scenario_file(folder / "busy.toml")
    study = study_of(file, [])
    found = []
    for workers, make_executor in ((1, Inline), (2, LocalPool)):
        options = Options(traces=workers == 2, workers=workers)
        out = folder / f"run-{workers}"
        found.append(run_study(study, options, out=out, make_executor=make_executor).path)
    return found


def study_again(runs: list[Path], *changes: Setting, varied: Any = ()) -> Study:
    return study_of(read_scenario_file(runs[0].parent / "busy.toml", changes), varied)


def same_bytes(one: Path, other: Path) -> None:
    for name in (*(f"{table}.parquet" for table in HOUR_TABLES), "summary.csv"):
        assert (one / name).read_bytes() == (other / name).read_bytes()


def test_bytes_do_not_depend_on_workers_nor_on_interruptions(
    runs: list[Path], tmp_path: Path
) -> None:
    same_bytes(*runs)

    def stop(done: int, _planned: int, _what: str) -> None:
        if done == 1:
            raise KeyboardInterrupt

    options: dict[str, Any] = {"progress": stop, "make_executor": Inline}
    with pytest.raises(InterruptedRunError):
        run_study(study_again(runs), Options(), out=tmp_path / "run", **options)
    assert len(list((tmp_path / "run" / "shards").iterdir())) == 1
    resume(tmp_path / "run", make_executor=Inline)
    same_bytes(runs[0], tmp_path / "run")


@pytest.mark.slow
def test_a_killed_run_is_resumed_to_the_same_bytes(runs: list[Path], tmp_path: Path) -> None:
    """SIGKILL as soon as a pair is there; its workers end by themselves."""
    out = tmp_path / "run"
    file = runs[0].parent / "busy.toml"
    running = start("run", file, "--workers", "2", "--quiet", "--out", out)
    wait_for(lambda: list(out.glob("shards/*.arrows")), "a shard", 60.0)
    assert running.poll() is None
    running.kill()
    running.communicate()
    assert shell("resume", out, "--workers", "2", "--quiet").returncode == 0
    same_bytes(runs[0], out)


def test_throughput_is_what_queues_let_through_and_levels_are_of_control_delay(
    runs: list[Path],
) -> None:
    """The last minute is cut short by the hour's end.

    HCM 2010, exhibit 19-1: A to 10 s, B to 15 s, C to 25 s; F where the road is saturated.
    """
    hours = pd.read_parquet(runs[0] / "hours.parquet").set_index(["pair", "arm"])
    queues = pd.read_parquet(runs[0] / "queues.parquet")
    through = queues.groupby(["pair", "arm"])["let_through"].sum()
    assert (queues["minute"].max(), through.sum() > 0) == (1, True)
    # Each passage is one in 70 s.
    expected = through.reindex(hours.index).to_numpy() * 3600 / 70
    assert hours["throughput_per_hour"].to_numpy() == pytest.approx(expected)
    row = pd.read_csv(runs[0] / "summary.csv").iloc[0]
    for end in ("", "_human"):
        longest_s = max(row[f"control_delay_s{end}"], row[f"vehicle_delay_s{end}"])
        level = next(of for of, limit in {"A": 10, "B": 15, "C": 25}.items() if longest_s <= limit)
        assert row[f"los_vehicles{end}"] == ("F" if row[f"saturated{end}"] else level)


def test_what_a_run_says(runs: list[Path], tmp_path: Path) -> None:
    run = load_run(runs[0])
    assert len(run.hours) == 2 * 2
    assert set(run.passages["direction"]) == {"forward", "oncoming"}
    mean_of_hours = run.passages.groupby(["arm", "pair"])["delay_s"].mean().groupby("arm").mean()
    (row,) = run.summary.to_dict("records")
    assert row["vehicle_delay_s"] == pytest.approx(mean_of_hours["av"], rel=1e-9)
    assert row["vehicle_delay_s_human"] == pytest.approx(mean_of_hours["human"], rel=1e-9)
    # Two minutes of two lanes, pairs and arms each; everybody let through is counted once.
    assert len(run.queues) == 2 * 2 * 2 * 2
    through = run.queues[run.queues["arm"] == "av"]["let_through"].sum() / 2
    assert float(through) == pytest.approx(row["throughput_per_hour"] * 70 / 3600)
    # No crash in two hours is no proof of none: a bound of the share, and none of the difference.
    assert (run.passages["ending"] == "crashed").sum() == 0
    assert (row["kappa"], row["crashes_per_1000"]) == (0.0, 0.0)
    assert row["crashes_per_1000_ci_high"] == pytest.approx(1000 * row["kappa_ci_high"])
    assert row["kappa_ci_high"] > 1 - 0.025 ** (1 / run.hours["reached"].sum())
    assert pd.isna(row["crashes_per_1000_difference_ci_high"])
    (cell,) = json.loads(printed("resume", runs[0], "--json"))["cells"]
    assert (cell["varied"], cell["summary"]["pairs"]) == ({}, 2)
    page = tmp_path / "report.html"
    with one_process():
        missing = write_shown(run, page)
    written = write_report(run, page, missing=missing)
    text = written.page.read_text(encoding="utf-8")
    again = "Simulated again for the page; the record is identical to the stored record."
    for words in ("Each hour of traffic is simulated twice", again, 'id="figure-time-space"'):
        assert words in text
    assert written.differing == ()


def test_the_player_shows_every_vehicle_where_it_was(runs: list[Path]) -> None:
    """As it passes: the rear at the crosswalk's far edge, the front its length and 2 m beyond."""
    run = load_run(runs[1])
    (hour,) = shown_pairs(run)
    assert (hour.begin_s, hour.end_s) == (0.0, 70.0)
    (episode,) = json.loads(run_player(run, [hour]).json)["episodes"]
    for arm in episode["arms"]:
        vehicles = {int(of["name"].split()[1].rstrip(",")): of for of in arm["vehicles"]}
        rows = rows_of(runs[1], "passages", arm["arm"], hour.pair)
        through = [row for row in rows if row["passed_s"] < 70.0]
        assert len(through) >= 1
        for row in through:
            vehicle = vehicles[row["vehicle"]]
            x = float(np.interp(row["passed_s"], vehicle["t"], vehicle["x"]))
            assert vehicle["oncoming"] == (row["direction"] == "oncoming")
            assert x == pytest.approx(-7.0 if vehicle["oncoming"] else 7.0, abs=0.3)
        people = rows_of(runs[1], "pedestrians", arm["arm"], hour.pair)
        there = {walker["index"] for walker in arm["walkers"]}
        assert {person["index"] for person in people} <= there


def test_an_hour_without_vehicles_has_a_page(tmp_path: Path) -> None:
    empty = {"traffic.flow_per_hour": 0, "traffic.oncoming_per_hour": 0, "traffic.duration_s": 60}
    study = study_of(read_scenario_file("field_sites", empty | {"experiment.pairs": 1}))
    run = run_study(study, Options(workers=0), out=tmp_path / "run")
    assert write_report(run, tmp_path / "page.html").page.is_file()
    assert Path(json.loads(printed("report", run.path, "--json"))["page"]).is_file()


def test_traces_have_everybody_from_where_they_enter_on(runs: list[Path]) -> None:
    own = load_run(runs[1]).traces.query("cell == 0 and pair == 0")
    first = own[own["object"].str.startswith("vehicle")].groupby(["arm", "object"])["x_m"]
    assert (first.agg(lambda x: abs(x.iloc[0])) > 290.0).all()
    came = own[own["object"].str.startswith("pedestrian")]
    assert came["y_m"].between(0.0, 9.0).all()


@pytest.fixture(scope="module")
def again(runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both arms of the first pair, with SUMO's own outputs, in a folder of a relative name."""
    folder = tmp_path_factory.mktemp("again")
    with chdir(folder), one_process():
        for replayed in replay(runs[0], 0, list(Arm), 0, Path("0")):
            assert replayed.problem is None
            assert replayed.differences == ()
    return folder / "0"


def test_the_diagram_tells_avs_and_lanes_apart(runs: list[Path]) -> None:
    run = load_run(runs[1])
    (hour,) = shown_pairs(run)
    av, human = time_space(run, hour).figure.axes
    labels = [set(panel.get_legend_handles_labels()[1]) for panel in (av, human)]
    # One lane each way: no lane to tell apart.
    assert labels == [{"AVs", "others"}, {"others"}]
    passages = run.passages
    own = passages[(passages["pair"] == hour.pair) & (passages["arm"] == "av")]
    for row in own.to_dict("records"):
        planned = scheduled_vehicle(run.scenario, hour.pair, row["vehicle"])
        automated = planned.uniform < run.scenario.known_traffic.av_share
        assert automated == (row["strategy"] == "gap_yield")
    assert own["strategy"].nunique() == 2


def rows_of(run: Path, table: str, arm: str, pair: int = 0) -> list[dict[str, Any]]:
    rows = getattr(load_run(run), table)
    return [*rows[(rows["arm"] == arm) & (rows["pair"] == pair)].to_dict("records")]


@pytest.mark.parametrize("arm", ["av", "human"])
def test_sumos_trips_agree_with_the_passages_and_its_places_with_the_queues(
    runs: list[Path], again: Path, arm: str
) -> None:
    """Delay to the road's end: timeLoss + inserted − scheduled, each to a step, all to 1 %.

    In the queue is who is slower than 5 km/h and has not passed, at each second of the minute.  E2
    detectors count who enters their lane as often as SUMO's places have somebody new there.
    """
    file = ElementTree.parse(again / arm / "tripinfo.xml")
    trips = {trip.get("id"): trip for trip in file.iter("tripinfo")}
    ours, sumos, passed = [], [], {}
    for row in rows_of(runs[0], "passages", arm):
        passed[f"vehicle-1-{row['vehicle']}"] = row["passed_s"]
        trip = trips[f"vehicle-1-{row['vehicle']}"]
        assert trip.get("vType") == ("av" if row["strategy"] == "gap_yield" else "vehicle")
        delayed_s = row["inserted_s"] - row["scheduled_s"]
        ours.append(row["control_delay_s"])
        sumos.append(float(trip.get("timeLoss")) + delayed_s)
        # Its first state is at the end of the step that SUMO says it departs in.
        assert float(trip.get("depart")) == pytest.approx(row["inserted_s"] + WARM_UP_S)
        assert float(trip.get("departDelay")) == 0.0
    assert len(ours) >= 6
    assert sum(ours) > 10.0
    assert ours == pytest.approx(sumos, abs=STEP_S + 1e-6)
    assert sum(ours) == pytest.approx(sum(sumos), rel=0.01)
    slow, seen = 0, set()
    for step in ElementTree.parse(again / arm / "fcd.xml").iter("timestep"):
        time_s = float(step.get("time", "")) - WARM_UP_S
        for vehicle in step.iter("vehicle"):
            name, lane = vehicle.get("id", ""), vehicle.get("lane", "")
            queued = float(vehicle.get("speed", "")) < QUEUED_MPS
            # Those of the warm-up have no row: SUMO's lane says where they are.
            before = time_s < passed[name] if name in passed else "exit" not in lane
            slow += queued and before and 0.5 < time_s < 60.5
            if "approach" in lane:
                seen.add((lane, name))
    means = [row["mean"] for row in rows_of(runs[0], "queues", arm)]
    assert sum(means) * 60 == pytest.approx(slow)
    assert slow > 0
    entered: Counter[str] = Counter()
    for interval in ElementTree.parse(again / arm / "e2.xml").iter("interval"):
        entered[interval.get("id", "")] += int(interval.get("nVehEntered", ""))
    assert entered == {lane: sum(lane == other for other, _ in seen) for lane in entered}


@pytest.mark.parametrize(
    ("does", "said"),
    [('raise ValueError("a vehicle that fails")', "fails"), ("return None", "returned None")],
)
def test_one_vehicle_that_fails_fails_its_arm(
    runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, does: str, said: str
) -> None:
    """None, too: SUMO drives nobody in an hour."""
    module = f"faulty_{said.partition(' ')[0]}"  # a process imports a module once
    (tmp_path / f"{module}.py").write_text(FAULTY.replace("DOES", does), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    study = study_again(runs, Setting("arms.av", f"{module}:Faulty"))
    run = run_inline(study, tmp_path / "run")
    assert {arm for _, _, arm, _ in run.failures} == {"av"}
    assert all("vehicle " in reason and said in reason for *_, reason in run.failures)
    assert run.summary["failed"].tolist() == [2]
    assert set(run.passages["arm"]) == {"human"}


@pytest.mark.slow
@needs_xvfb
def test_an_hour_in_sumo_gui_is_the_stored_one(runs: list[Path], tmp_path: Path) -> None:
    """A car of 5 x 1.8 m at 7 pixels a metre has some 450, a fifth of it windows.

    At the first picture the road is empty; the first vehicle needs half a minute to come.
    """
    options = ("--pace", "1000", "--screenshots", tmp_path / "shots", "--every", "5")
    text = watched("replay", runs[0], "--pair", "1", "--arm", "av", *options)
    assert text == "pair 1, arm av: the record is identical to the stored record\n"
    pictures = sorted((tmp_path / "shots").glob("*.png"))
    assert len(pictures) >= 16
    assert [picture.name for picture in pictures[:2]] == ["t-00000.100-s.png", "t-00005.100-s.png"]
    assert pixels(pictures[0], AV) == 0
    assert max(pixels(picture, AV) for picture in pictures) > 150
    assert max(pixels(picture, PEDESTRIAN) for picture in pictures) > 10


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("traffic.av_share = 1.5", "traffic.av_share"),
        ("traffic.duration_s = 0", "traffic.duration_s"),
        ("traffic.flow_per_hour = 5000", "5000 vehicles per hour on 1 lane;"),
        ("traffic.flow_per_hour = -1", "bad.toml: traffic.flow_per_hour: -1 is not accepted"),
        (
            "traffic.flow_per_hour = [1, -2]",
            "bad.toml: traffic.flow_per_hour.1: -2 is not accepted",
        ),
        ("traffic.flow_per_hour = []", "bad.toml: traffic.flow_per_hour: [] is not accepted"),
        ("crossing.oncoming_lanes = 0", "600 vehicles per hour, but no lane for them; allowed: 0"),
        ("traffic.flow_per_hour = [1, 2]", "2 values; allowed: 4"),
        ("traffic.tau_s = 0.05", "traffic.tau_s"),
        ("traffic.folowing = 'IDM'", "did you mean 'following'"),
        ("pedestrians.behaviour = 'sumo'", "pedestrians.behaviour"),
        ("pedestrians.first_at_trigger = true", "pedestrians.first_at_trigger"),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, line: str, said: str) -> None:
    (tmp_path / "bad.toml").write_text(f"{line}\ntraffic.occupancy = 1.5\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        study_of(read_scenario_file(tmp_path / "bad.toml"), [])
    assert said in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_crashes_are_said_before_any_delay(runs: list[Path], tmp_path: Path) -> None:
    changes = (Setting("arms.av", "constant_speed"), Setting("experiment.pairs", 1))
    run = run_inline(study_again(runs, *changes), tmp_path / "run")
    hit = int(run.passages[run.passages["arm"] == "av"]["contact"].notna().sum())
    assert hit > 0, "or there is nothing to say"
    (cell,) = reported(run).cells
    assert cell.findings["kappa"].events == hit
    (note,) = [note.text for note in cell.notes if "after a crash" in note.text]
    assert note.startswith("constant_speed's arm: ")
    assert "the delays do not include the cost of a crash" in note
    (calm,) = reported(load_run(runs[0])).cells
    assert not any("after a crash" in note.text for note in calm.notes)
