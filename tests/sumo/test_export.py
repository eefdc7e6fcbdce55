"""What ``harness export`` writes, read back as another tool would.

Positions are compared with a run's own traces, or with its passages over the network's crosswalks,
and lanes with the exported road.
"""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import shapely

from harness.core.vocabulary import Arm
from harness.engine.town_reader import read_town
from harness.results.loaded_run import load_run
from harness.scenario import Scenario, study_of
from harness.scenario.file import ScenarioFile
from harness.studies.running.run import run
from tests import towns
from tests.batches import content, printed, refusal
from tests.exported import Read, checked, entity_of, front, lanes_in, off_centre_m, places, read
from tests.sites import frame_of


def ran(tree: dict, folder: Path, *, traces: bool = True) -> Path:
    study = study_of(ScenarioFile("flow", "test", tree, None, (), folder.parent))
    return run(study, traces=traces, workers=0, out=folder).path


def exported(run: Path, out: Path, *words: object) -> Path:
    printed("export", run, "--out", out, *words)
    return out / "scenario.xosc"


def stored(run: Path, pair: int, arm: Arm = Arm.AV) -> dict[str, pd.DataFrame]:
    """The states of everybody in a pair, from the run's own table."""
    rows = pd.read_parquet(run / "traces")
    of_arm = (rows["pair"] == pair) & (rows["arm"] == arm.value)
    kept = of_arm & ~rows["object"].str.startswith("shown-")
    return dict([*rows[kept].groupby("object")])


def assert_as_stored(back: Read, scenario: Scenario, rows: dict[str, pd.DataFrame]) -> int:
    """Every stored state is in the file, within 1 cm and 1 ms; returns how many people are."""
    frame = frame_of(scenario.crossing)
    moved = {name: front(back) if name == "ego" else back.states[name][:, :3] for name in rows}
    for name, states in rows.items():
        t, x, y = (states[key].to_numpy() for key in ("time_s", "x_m", "y_m"))
        wanted = np.column_stack(frame.to_network(x, y))
        times = moved[name][:, 0]
        nearest = np.abs(times[:, None] - t[None]).argmin(axis=0)
        assert np.abs(times[nearest] - t).max() < 1e-3
        assert np.abs(moved[name][nearest, 1:] - wanted).max() < 0.01
    return sum(name.startswith("pedestrian") for name in rows)


PEOPLE = {"flow_per_hour": 900.0, "first_at_trigger": True}


@pytest.fixture(scope="module")
def flow(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ran(
        {"experiment": {"pairs": 3}, "pedestrians": PEOPLE},
        tmp_path_factory.mktemp("export") / "flow",
    )


def test_a_pair_as_openscenario(flow: Path, tmp_path: Path) -> None:
    path = exported(flow, tmp_path / "out", "--pair", 1)
    back, rows = read(path), stored(flow, 1)
    assert assert_as_stored(back, load_run(flow).scenario_of(0), rows) > 1
    lanes = lanes_in(path.parent / "road.xodr")
    for _, x, y, h in back.states["ego"]:
        assert off_centre_m(lanes, complex(x, y), h) < 0.001
    # 17 rules of version 1.2 and before; a road that cannot be read makes one of them skipped.
    assert "17 checker(s) are completed. 0 checker(s) are skipped" in checked(path)
    # People walk across: at right angles to the road here.
    along = back.states["ego"][0, 3]
    for name, states in back.states.items():
        if name.startswith("pedestrian") and len(states) > 1:
            assert abs(math.cos(states[0, 3] - along)) < 1e-6


def test_people_are_there_from_their_arrival_to_the_other_kerb(flow: Path, tmp_path: Path) -> None:
    back = read(exported(flow, tmp_path / "out", "--pair", 1))
    people = load_run(flow).pedestrians
    people = people[(people["pair"] == 1) & (people["arm"] == "av")]
    assert {f"pedestrian-{index}" for index in people["index"]} == {*back.states} - {"ego"}
    for row in people.to_dict("records"):
        name = f"pedestrian-{row['index']}"
        assert back.appears[name] == pytest.approx(row["arrival_s"], abs=1e-6)
        if not math.isnan(row["start_s"]):
            assert back.states[name][0, 0] == pytest.approx(row["start_s"], abs=1e-6)
        if not math.isnan(row["cleared_s"]):
            assert back.leaves[name] == pytest.approx(row["cleared_s"], abs=1e-6)


def test_a_free_ego_starts_at_r0_and_everybody_waits_for_it(flow: Path, tmp_path: Path) -> None:
    path = exported(flow, tmp_path / "free", "--pair", 1, "--ego", "free")
    back, scenario = read(path), load_run(flow).scenario_of(0)
    ego, frame = scenario.vehicle(), frame_of(scenario.crossing)
    assert len(back.states["ego"]) == 1
    lane_m = scenario.crosswalk().lane_centre_m
    start = frame.to_network(-ego.trigger_range_m, lane_m)
    assert front(back)[0, 1:] == pytest.approx(start, abs=1e-5)
    (speed,) = (
        each.get("value")
        for private in back.root.iter("Private")
        if private.get("entityRef") == "ego"
        for each in private.iter("AbsoluteTargetSpeed")
    )
    assert float(speed) == ego.initial_speed_mps
    # The act begins where the rear axle of an ego at R0 is; not a centimetre earlier.
    (act,) = back.root.iter("Act")
    (near,) = act.iter("DistanceCondition")
    (place,) = places(near)
    away = math.dist(place[:2], back.states["ego"][0, 1:3])
    assert 0 < float(near.get("value", "nan")) - away < 0.01
    # People are as recorded, and they walk on to the other kerb.
    whole = read(exported(flow, tmp_path / "recorded", "--pair", 1))
    for name in {*whole.states} - {"ego"}:
        count = len(whole.states[name]) - (name not in whole.leaves)
        assert back.states[name][:count] == pytest.approx(whole.states[name][:count], abs=1e-6)
        assert name in back.leaves or len(back.states[name]) == 1
    assert "0 checker(s) are skipped" in checked(path)


def test_the_same_pair_gives_the_same_bytes_simulated_again_or_not(
    flow: Path, tmp_path: Path
) -> None:
    again = ran({"experiment": {"pairs": 3}, "pedestrians": PEOPLE}, tmp_path / "run", traces=False)
    one, other = tmp_path / "one", tmp_path / "other"
    exported(flow, one, "--pair", 1)
    exported(again, other, "--pair", 1)
    assert content(one) == content(other)
    assert content(one).keys() == {"road.xodr", "scenario.xosc"}


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of a left-hand town in which all cars and trucks are AVs."""
    folder = tmp_path_factory.mktemp("town")
    config = towns.town(folder, seed=3, end_s=110, kind="left")
    # Crosswalks of this town at which people walk when vehicles come.
    crossings = [":17_c1", ":35_c1", ":246_c1"]
    simulated = {"file": str(config), "crossings": crossings, "av_share": 1.0}
    simulated["av_types"] = ["passenger", "truck"]
    arms = {"av": "gap_yield", "human": "human_yield"}
    tree = {"simulation": simulated, "arms": arms, "experiment": {"pairs": 1}}
    return ran(tree, folder / "run", traces=False)


CAN = {"car": [1.8, 5.0, 1.5, 200 / 3.6, 2.6, 4.5], "truck": [2.5, 12.0, 1.5, 130 / 3.6, 1.3, 4.0]}
"""Width, length, height, greatest speed, acceleration and deceleration: those that the town gives,
and those of SUMO's documentation of vehicle classes."""


@pytest.mark.parametrize("kind", CAN)
def test_a_passage_of_a_simulation(town: Path, tmp_path: Path, kind: str) -> None:
    """The exported body is on the crosswalk when the table of passages says so; people too."""
    ran = load_run(town)
    rows, people = (ran.table(name).query("arm == 'av'") for name in ("passages", "people"))
    found = rows[(rows["type"] == "lorry") == (kind == "truck")].dropna(subset="rear_s")
    walked = people.dropna(subset=["start_s", "cleared_s"])

    def seen_s(of) -> float:
        """For how long people walk there from the trigger until its rear has left."""
        there = walked[walked["crosswalk"] == of["crosswalk"]]
        until_s = there["cleared_s"].clip(upper=of["rear_s"])
        return float((until_s - there["start_s"].clip(lower=of["trigger_s"])).clip(lower=0).sum())

    row = found.iloc[found.apply(seen_s, axis=1).to_numpy().argmax()]
    passage = row["vehicle"], row["crosswalk"]
    path = exported(town, tmp_path / "out", "--pair", 0, "--passage", *passage)
    back = read(path)
    crosswalk = read_town(town.parent / "net.net.xml").crosswalks[row["crosswalk"]]
    # Corners of the bounding box; the clock begins with the first step within R0.
    begin_s = math.ceil(row["trigger_s"] * 10 - 1e-6) / 10
    told = (next(entity_of(back, "ego").iter(tag)) for tag in ("Dimensions", "Performance"))
    width_m, length_m, *_ = found = [float(of) for each in told for of in each.attrib.values()]
    assert found == pytest.approx(CAN[kind])
    at, h = front(back), back.states["ego"][:, 3]
    ahead, left = np.exp(1j * h), 0.5j * width_m * np.exp(1j * h)
    nose = at[:, 1] + 1j * at[:, 2]
    corners = np.stack([nose - left, nose + left, nose + left - length_m * ahead,
                        nose - left - length_m * ahead], axis=1)  # fmt: skip
    bodies = shapely.polygons(np.stack([corners.real, corners.imag], axis=2))
    on = begin_s + at[shapely.intersects(bodies, crosswalk.area), 0]
    # Places are rounded to 1 cm, and states are a step of 0.1 s apart.
    assert row["front_s"] - 0.02 <= on[0] <= row["front_s"] + 0.12
    assert row["rear_s"] - 0.12 <= on[-1] <= row["rear_s"] + 0.02
    compared = 0
    for person in walked[walked["crosswalk"] == row["crosswalk"]].to_dict("records"):
        states = back.states.get(f"pedestrian-{person['person']}")
        if states is None or len(states) == 1:
            continue
        time_s = begin_s + states[:, 0]
        between = (time_s > person["start_s"] + 0.1) & (time_s < person["cleared_s"] - 0.1)
        points = shapely.points(states[between, 1:3])
        assert (shapely.distance(points, crosswalk.area) < 0.02).all()
        compared += between.any()
    assert compared > 0
    # Roads that bend are left out, and some vehicles change lane.
    lanes, places = lanes_in(path.parent / "road.xodr"), zip(nose, h, strict=True)
    off_m = np.array([off_centre_m(lanes, point, heading) for point, heading in places])
    assert np.isfinite(off_m).sum() > 10
    assert np.median(off_m[np.isfinite(off_m)]) < 0.02
    assert "0 checker(s) are skipped" in checked(path)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--out new", "--pair"),
        ("--pair 1", "--out"),
        ("--pair 9 --out new", "0 to 2"),
        ("--pair 1 --cell 4 --out new", "0 to 0"),
        ("--pair 1 --passage 3 a --out new", "--passage: is of simulations"),
    ],
)
def test_refusals_write_nothing(
    flow: Path, tmp_path: Path, monkeypatch, words: str, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in refusal("export", flow, *words.split())
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("", "--passage: is missing"),
        ("--passage 3 :none", "--passage: 3 does not pass :none in this arm"),
        ("--passage 3 :none --ego free", "--ego free: is of encounters"),
    ],
)
def test_a_passage_has_to_be_named(town: Path, tmp_path: Path, words: str, said: str) -> None:
    new = tmp_path / "new"
    assert said in refusal("export", town, "--pair", 0, "--out", new, *words.split())
    assert not new.exists()
