"""Replay: the same episode again, with files that SUMO's own tools read."""

import os
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

from harness.core.vocabulary import Arm
from harness.results.loaded_run import Run
from harness.studies.running.replay import replay
from harness.studies.running.run import run as simulate
from tests.batches import CHECKOUT, FLOW, HARNESS, QUICK, here, one_process, options_of
from tests.sites import to_road

FLOW_PER_HOUR = "pedestrians.flow_per_hour"
# Replay starts a SUMO of its own, and only one can run in a process.
FILES = ("fcd.xml", "tripinfo.xml", "collisions.xml")

pytestmark = pytest.mark.usefixtures("no_simulation")


CHILD = [{"side": "near", "start_lateral_m": 4.0, "speed_mps": 1.4, "impact_share": 0.25}]
"""They come from the footpath, 1.75 m before the kerb."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A sweep of two flows with traces."""
    vary = {FLOW_PER_HOUR: [200, 1000]}
    out = tmp_path_factory.mktemp("replay") / "run"
    settings = {**FLOW, "experiment.pairs": 8, "pedestrians.timed": CHILD}
    return simulate("cctc_flow", settings=settings, vary=vary, traces=True, workers=0, out=out)


def outputs(run: Run, pair: int, arm: Arm, cell: int) -> Path:
    folder = run.path.parent / f"{cell}-{pair}-{arm}"
    if not folder.exists():
        (replayed,) = replay(run, cell, range(pair, pair + 1), [arm], folder)
        assert replayed.differences == ()
    return folder


def stored(run: Run, name: str, pair: int, arm: str, cell: int) -> list[dict[str, Any]]:
    rows = run.rows(name, cell).to_pylist()
    return [row for row in rows if (row["pair"], row["arm"]) == (pair, arm)]


def busiest(run: Run, cell: int) -> int:
    """The pair whose AV met most pedestrians."""
    rows = run.rows("episodes", cell).to_pylist()
    met = {row["pair"]: row["pedestrians"] for row in rows if row["arm"] == "av"}
    return max(met, key=lambda pair: met[pair])


@pytest.mark.parametrize("arm", list(Arm))
def test_fcd_agrees_with_the_trace(run: Run, arm: Arm) -> None:
    pair = busiest(run, 1)
    folder = outputs(run, pair, arm, 1)
    crossing = run.scenario_of(1).crossing
    seen: dict[tuple[str, int], tuple[float, float, float]] = {}
    for step in ET.parse(folder / "fcd.xml").getroot():
        # SUMO inserts the ego in its second step: its clock is one step ahead.
        number = round(float(step.attrib["time"]) / 0.1) - 1
        for item in step:
            x, y = float(item.attrib["x"]), float(item.attrib["y"])
            for digits in (item.attrib["x"], item.attrib["y"], item.attrib["speed"]):
                assert len(digits.partition(".")[2]) >= 6
            # SUMO's ids carry the number of the episode in the middle: pedestrian-0-3.
            index = item.attrib["id"].rpartition("-")[2]
            if item.tag == "vehicle":
                assert item.attrib["type"] == ("av" if arm is Arm.AV else "ego")
            name = "ego" if item.tag == "vehicle" else f"pedestrian-{index}"
            speed = float(item.attrib["speed"])
            seen[name, number] = (*to_road(crossing, x, y), speed)
    rows = stored(run, "traces", pair, arm.value, 1)
    compared = {"ego": 0, "pedestrian": 0}
    for row in rows:
        kind = row["object"].partition("-")[0]
        # Within about 1 cm of a kerb, and of the footpath's end 1.5 m before it, SUMO puts people
        # up to 11 mm elsewhere.
        near = any(abs(row["y_m"] - end_m) < 0.02 for end_m in (-1.5, 0.0, 9.0))
        if kind == "pedestrian" and near:
            continue
        found = seen.get((row["object"], round(row["time_s"] / 0.1)))
        if found is None:
            # Who has reached the other side is taken away within SUMO's step.
            continue
        x, y, speed = found
        # 6 digits are written, of coordinates turned by the road's bearing.
        assert x == pytest.approx(row["x_m"], abs=2e-6)
        assert y == pytest.approx(row["y_m"], abs=2e-6)
        if kind == "ego":
            assert speed == pytest.approx(row["speed_mps"], abs=1e-6)
        compared[kind] += 1
    steps = stored(run, "episodes", pair, arm.value, 1)[0]["steps"]
    assert compared["ego"] >= steps - 1
    assert compared["pedestrian"] > 50


def test_the_files_are_whole_and_time_lost_is_the_delay(run: Run) -> None:
    rows = run.episodes.query("cell == 1 and arm == 'av' and ending == 'crossed' and delay_s > 1")
    pair = int(rows["pair"].iloc[0])
    folder = outputs(run, pair, Arm.AV, 1)
    roots = {name: ET.parse(folder / name).getroot() for name in FILES}
    (trip,) = roots["tripinfo.xml"]
    assert trip.get("id") == "ego-0"
    (episode,) = stored(run, "episodes", pair, "av", 1)
    # SUMO's loss is the sum of (1 - v / v0) dt, our delay t - way / v0: equal but for the last step
    # beyond the passage, and SUMO's speeds at the ends of steps.
    assert float(trip.get("timeLoss")) == pytest.approx(episode["delay_s"], abs=0.2)


RAISES = """
class Raises:
    def decide(self, observation):
        breakpoint()
        raise ArithmeticError("on purpose")
"""


def test_debug_has_standard_input_and_the_traceback(tmp_path: Path) -> None:
    (tmp_path / "raising.py").write_text(RAISES.replace("breakpoint()", "pass"), encoding="utf-8")
    env = {**os.environ, "PYTHONPATH": str(CHECKOUT)}
    changes = options_of({**QUICK, "arms.av": "raising:Raises", "experiment.pairs": 1})
    assert here("run", "cctc", "--out", "run", *changes, cwd=tmp_path).returncode == 1
    again = here("replay", "run", "--pair", 0, "--arm", "av", "--out", "o", cwd=tmp_path)
    assert "ArithmeticError: on purpose" in again.stderr
    (tmp_path / "raising.py").write_text(RAISES, encoding="utf-8")
    command = [*HARNESS, "replay", "run", "--pair", "0", "--arm", "av", "--debug"]
    pipes: Any = {"input": "p 6 * 7\nc\n", "capture_output": True, "text": True}
    done = subprocess.run(command, cwd=tmp_path, env=env, timeout=300, **pipes)
    assert "42" in done.stdout
    assert "ArithmeticError: on purpose" in done.stderr


RUNNER = {"start_lateral_m": 6.0, "acceleration_distance_m": 1.5, "speed_mps": 2.2}
TIMED = [{"name": "CPFA-50", "side": "far", "impact_share": 0.5, **RUNNER}]


def test_walks_of_every_behaviour_are_replayed(tmp_path: Path) -> None:
    changes = {**FLOW, "experiment.pairs": 2, "experiment.timeout_s": 30.0, FLOW_PER_HOUR: 900.0}
    vary = {"pedestrians.behaviour": ["constant", "gap_acceptance", "threshold", "reactive"]}
    settings = {**changes, "pedestrians.timed": TIMED}
    out = tmp_path / "run"
    run = simulate("cctc_flow", settings=settings, vary=vary, traces=True, workers=0, out=out)
    pedestrians = [row for cell in range(4) for row in run.rows("pedestrians", cell).to_pylist()]
    walked = [row for row in pedestrians if row["start_s"] is not None]
    with_legs = {row["cell"] for row in walked if row["legs"] is not None and row["index"] > 0}
    assert with_legs == {3}
    assert {row["cell"] for row in walked if row["critical_gap_s"] is not None} == {1}
    assert {row["cell"] for row in walked if row["latency_s"] is not None} == {2}
    assert all(row["legs"] is not None for row in walked if row["index"] == 0)
    with one_process():
        for cell in range(4):
            for again in replay(run, cell, range(1, 2), list(Arm), tmp_path / f"again-{cell}"):
                assert again.differences == (), again.name
