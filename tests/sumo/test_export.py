"""What ``harness export`` writes of encounters, read back as another tool would.

Positions are compared with the run's own traces, and lanes with the exported road.
"""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.core.encounter import Arm
from harness.engine.network import place_of
from harness.results.run import load_run
from harness.scenario import Scenario, ScenarioFile, study_of
from harness.site import read_site
from harness.studies.run import run
from tests.batches import printed, refusal
from tests.exported import Read, checked, front, lanes_in, off_centre_m, places, read

pytest.importorskip("scenariogeneration")


def ran(tree: dict[str, object], folder: Path, *, traces: bool = True) -> Path:
    study = study_of(ScenarioFile("flow", "test", tree, None, (), folder.parent))
    return run(study, traces=traces, workers=0, out=folder).path


def exported(run: Path, out: Path, *words: object, form: str = "openscenario") -> Path:
    printed("export", run, "--format", form, "--out", out, *words)
    return out / "scenario.xosc"


def stored(run: Path, pair: int, arm: Arm = Arm.AV) -> dict[str, pd.DataFrame]:
    """The states of everybody in a pair, from the run's own table."""
    rows = load_run(run).traces_of(0, pair)
    kept = (rows["arm"] == arm.value) & ~rows["object"].str.startswith("shown-")
    return dict([*rows[kept].groupby("object")])


def assert_as_stored(back: Read, scenario: Scenario, rows: dict[str, pd.DataFrame]) -> int:
    """Every stored state is in the file, within 1 cm and 1 ms; returns how many people are."""
    frame = read_site(place_of(scenario)).frame
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
    ego, frame = scenario.vehicle(), read_site(place_of(scenario)).frame
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
    again = ran(
        {"experiment": {"pairs": 3}, "pedestrians": PEOPLE},
        tmp_path / "run",
        traces=False,
    )
    one, other = tmp_path / "one", tmp_path / "other"
    exported(flow, one, "--pair", 1)
    text = printed("export", again, "--format", "openscenario", "--out", other, "--pair", 1)
    assert "simulated again; the record is identical to the stored record" in text
    names = sorted(path.name for path in one.iterdir())
    assert names == ["road.xodr", "scenario.xosc"]
    for name in names:
        assert (one / name).read_bytes() == (other / name).read_bytes()


def test_trajectories_as_a_table(flow: Path, tmp_path: Path) -> None:
    exported(flow, tmp_path / "out", "--pair", 1, "--arm", "human", form="trajectories")
    table = pd.read_csv(tmp_path / "out" / "trajectories.csv")
    frame = read_site(place_of(load_run(flow).scenario_of(0))).frame
    for name, rows in stored(flow, 1, Arm.HUMAN).items():
        kept = table[table["object"] == name].merge(
            rows.assign(time_s=rows["time_s"].round(6)), on="time_s"
        )
        assert len(kept) == len(rows)
        assert kept["road_x_m"].to_numpy() == pytest.approx(kept["x_m"], abs=1e-6)
        assert kept["road_y_m"].to_numpy() == pytest.approx(kept["y_m"], abs=1e-6)
        assert kept["speed_mps_x"].to_numpy() == pytest.approx(kept["speed_mps_y"], abs=1e-6)
        x, y = frame.to_network(kept["x_m"].to_numpy(), kept["y_m"].to_numpy())
        assert kept["network_x_m"].to_numpy() == pytest.approx(x, abs=1e-6)
        assert kept["network_y_m"].to_numpy() == pytest.approx(y, abs=1e-6)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--format openscenario --out new", "--pair"),
        ("--format openscenario --pair 1", "--out"),
        ("--format openscenario --pair 9 --out new", "0 to 2"),
        ("--format openscenario --pair 1 --cell 4 --out new", "0 to 0"),
        ("--format openscenario --pair 1 --vehicle 3 --out new", "--vehicle 3"),
        ("--format commonroad --pair 1 --out new", "openscenario"),
        ("--format trajectories --pair 1 --ego free --out new", "openscenario"),
        ("--format trajectories --csv", "No such option"),
        ("--pair 1", "--format"),
    ],
)
def test_refusals_write_nothing(
    flow: Path, tmp_path: Path, monkeypatch, words: str, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    text = refusal("export", flow, *words.split())
    assert said in text
    assert [*tmp_path.iterdir()] == []
