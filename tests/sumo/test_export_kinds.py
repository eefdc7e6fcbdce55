"""What ``harness export`` writes of each kind of run, against SUMO's own output of the same pair.

``fcd.xml`` of ``harness replay --out`` has the front bumper of every vehicle and the centre of
every person, with their headings, as SUMO moved them on its network.
"""

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from harness.old.studies.batch.experiment import run_study
from harness.old.studies.runs.opening import load_run
from harness.scenario import Options, ScenarioFile, Setting, read_scenario_file, study_of
from tests import towns
from tests.batches import Inline, printed
from tests.exported import Read, checked, front, lanes_in, off_centre_m, read
from tests.sumo.test_simulation_unseen import usable

pytest.importorskip("scenariogeneration")

FROM_SUMO = tuple[str, str]
NODE_M = 0.12
"""SUMO's length of a lane on a node of two straight roads is 0.1 m, whatever its shape is."""
R0_M = 30.0


def ran(tree: dict[str, object], folder: Path) -> Path:
    study = study_of(ScenarioFile("kind", "test", tree, None, (), folder.parent))
    return run_study(study, Options(traces=True, workers=1), out=folder, make_executor=Inline).path


def exported(run: Path, out: Path, *words: object) -> Read:
    printed("export", run, "--pair", 0, "--format", "openscenario", "--out", out, *words)
    return read(out / "scenario.xosc")


def fcd_of(run: Path, out: Path) -> dict[FROM_SUMO, np.ndarray]:
    """Time, x, y, heading and speed of everybody of the AV's arm of pair 0, as SUMO says."""
    printed("replay", run, "--pair", 0, "--arm", "av", "--out", out)
    found: dict[FROM_SUMO, list[list[float]]] = {}
    for step in ElementTree.parse(out / "fcd.xml").getroot().iter("timestep"):
        for each in step:
            x, y, angle, speed = (float(each.get(k, "nan")) for k in ("x", "y", "angle", "speed"))
            row = [float(step.get("time", "nan")), x, y, math.radians(90 - angle), speed]
            found.setdefault((each.tag, each.get("id", "")), []).append(row)
    return {name: np.array(rows) for name, rows in found.items()}


def moved(back: Read, name: str) -> np.ndarray:
    """Time, x, y (front bumper or centre) and heading of somebody who was read back."""
    states = back.states[name]
    is_vehicle = not name.startswith("pedestrian")
    return np.column_stack([front(back, name) if is_vehicle else states[:, :3], states[:, 3]])


def clock_s(back: Read, sumo_ego: np.ndarray) -> float:
    """SUMO's time at the exported clock's 0: from where the ego drove, to a hundredth of a step."""
    ego, driving = moved(back, "ego"), sumo_ego[sumo_ego[:, 4] > 1.0]
    away = np.hypot(*(driving[:, None, k] - ego[None, :, k] for k in (1, 2)))
    one, other = np.unravel_index(away.argmin(), away.shape)
    return round(float(driving[one, 0] - ego[other, 0]), 3)


def errors_of(
    back: Read, name: str, sumo: np.ndarray, clock: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances and differences of headings at SUMO's times, and SUMO's places then."""
    states = moved(back, name)
    times = sumo[:, 0] - clock
    there = (times > states[0, 0] - 1e-6) & (times < states[-1, 0] + 1e-6)
    times, sumo = times[there], sumo[there]
    x, y = (np.interp(times, states[:, 0], states[:, k]) for k in (1, 2))
    heading = states[np.searchsorted(states[:, 0], times - 1e-6).clip(max=len(states) - 1), 3]
    turned = np.abs(np.angle(np.exp(1j * (sumo[:, 3] - heading))))
    return np.hypot(sumo[:, 1] - x, sumo[:, 2] - y), turned, sumo[:, 1:3]


def assert_as_in_sumo(back: Read, sumo: dict[FROM_SUMO, np.ndarray], ego: str) -> list[str]:
    """Everybody who was read back is somebody of SUMO, within 1 cm; returns SUMO's names.

    Vehicles farther away than R0 may also be off by SUMO's lengths of nodes.
    """
    clock = clock_s(back, sumo["vehicle", ego])
    middle = moved(back, "ego")[:, 1:3].mean(axis=0)
    names = []
    for name in back.states:
        kind = "person" if name.startswith("pedestrian") else "vehicle"
        if name.startswith("obstacle") or len(back.states[name]) == 1:
            continue
        found = {
            other: errors_of(back, name, rows, clock)
            for (tag, other), rows in sumo.items()
            if tag == kind
        }
        seen = [other for other in found if len(found[other][0])]
        if not seen:  # an hour's output has one moment per second
            continue
        best = min(seen, key=lambda other: float(np.median(found[other][0])))
        names.append(best)
        away, turned, places = found[best]
        near = np.hypot(*(places - middle).T) < 2 * R0_M
        assert (away[near] < 0.01).all(), (name, best, away[near].max())
        assert (away < 0.01 + (kind == "vehicle") * NODE_M).all(), (name, best, away.max())
        # SUMO turns a person at once where they begin and end; on the way they face as they walk.
        assert (np.median(turned) if kind == "person" else turned.max()) < 2e-3, (name, best)
    return names


def test_an_hour_of_traffic_in_both_directions(tmp_path: Path) -> None:
    tree = {
        "crossing": {"length_m": 12.0, "lanes": 2, "bearing_deg": 40.0},
        "arms": {"av": "gap_yield", "human": "human_yield"},
        "pedestrians": {"flow_per_hour": 600.0},
        "experiment": {"pairs": 1},
        "traffic": {
            "flow_per_hour": 400.0,
            "oncoming_per_hour": 300.0,
            "duration_s": 60.0,
            "warm_up_s": 20.0,
        },
    }
    run = ran(tree, tmp_path / "run")
    sumo = fcd_of(run, tmp_path / "sumo")
    directions = set()
    for vehicle in ("4", "5"):  # one drives with the road frame's x, the other against it
        out = tmp_path / vehicle
        back = exported(run, out, "--vehicle", vehicle)
        names = assert_as_in_sumo(back, sumo, f"vehicle-1-{vehicle}")
        assert len(names) == len({*names}) > 4
        assert names[0].endswith(f"-{vehicle}")
        lanes = lanes_in(out / "road.xodr")
        for _, x, y, h in back.states["ego"]:
            assert off_centre_m(lanes, complex(x, y), h) < 0.01
        directions.add(round(float(np.cos(back.states["ego"][0, 3] - math.radians(50.0)))))
        assert "0 checker(s) are skipped" in checked(out / "scenario.xosc")
    assert directions == {-1, 1}


@pytest.mark.slow
def test_an_own_simulation_of_left_hand_roads(tmp_path: Path) -> None:
    grid = ("--grid", "--grid.number", "3", "--lefthand", "--sidewalks.guess")
    towns.call(tmp_path, "netgenerate", *grid, "--crossings.guess", "-o", "net.net.xml")
    config = towns.with_demand(tmp_path, 90, 1.0, 0.5, precision="6")
    crossings = usable(tmp_path / "net.net.xml")
    crossing = crossings[len(crossings) // 2]
    scene = tmp_path / "town.toml"
    scene.write_text(
        f'[simulation]\nconfig = "{config.name}"\ncrossings = ["{crossing}"]\n'
        '[arms]\nav = "gap_yield"\nhuman = "sumo_driver"\n[experiment]\npairs = 1\n'
    )
    study = study_of(read_scenario_file(str(scene), [Setting("simulation.av_share", 0.5)]))
    options = Options(traces=True, workers=1)
    run = run_study(study, options, out=tmp_path / "run", make_executor=Inline).path
    sumo = fcd_of(run, tmp_path / "sumo")
    scenes = load_run(run).rows_of("scenes_over", 0, 0).to_pandas()
    scenes = scenes[scenes["arm"] == "av"].assign(people=lambda rows: rows["walks"].map(len))
    met, headings = 0, set()
    for _, rows in scenes.sort_values("people").groupby("approach"):
        vehicle = rows["vehicle"].iloc[-1]
        out = tmp_path / vehicle
        back = exported(run, out, "--vehicle", vehicle)
        names = assert_as_in_sumo(back, sumo, vehicle)
        assert len(names) == len({*names})
        assert names[0] == vehicle
        met += len(names) - 1
        headings.add(round(math.degrees(back.states["ego"][0, 3])))
    assert "0 checker(s) are skipped" in checked(out / "scenario.xosc")
    assert len(headings) == 2
    assert met > 1
