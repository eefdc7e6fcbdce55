"""Replay: the same episode again, with files that SUMO's own tools read."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import sumo as sumo_package

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.old.studies.batch.experiment import run_study
from harness.old.studies.kinds.outputs import SUMO_FILES
from harness.old.studies.replay.rerun import replay
from harness.scenario import Options
from harness.site import Place, read_site
from tests.batches import (
    CHECKOUT,
    FLOW,
    HARNESS,
    QUICK,
    here,
    one_cell,
    one_process,
    options_of,
    printed,
    refusal,
    run_inline,
    shell,
    sweep,
)
from tests.faulty import FAULTS, NAME, raise_error, struck
from tests.scenes import refuses

HOME = Path(sumo_package.SUMO_HOME)
FLOW_PER_HOUR = "pedestrians.flow_per_hour"
PAIRS = 8


# Replay starts a SUMO of its own, and only one can run in a process.
pytestmark = pytest.mark.usefixtures("no_simulation")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep of two flows with traces."""
    folder = tmp_path_factory.mktemp("replay") / "run"
    study = sweep("cctc_flow", {**FLOW, "experiment.pairs": PAIRS}, f"{FLOW_PER_HOUR}=200,1000")
    with one_process():
        run_study(study, Options(traces=True), out=folder)
    return folder


def outputs(run: Path, pair: int, arm: str, cell: int) -> Path:
    folder = run.parent / f"{cell}-{pair}-{arm}"
    if not folder.exists():
        (replayed,) = replay(run, pair, [Arm(arm)], cell, folder)
        assert replayed.differences == ()
    return folder


def stored(run: Path, name: str, pair: int, arm: str, cell: int) -> list[dict[str, Any]]:
    rows = pq.read_table(run / f"{name}.parquet").to_pylist()
    return [r for r in rows if (r["pair"], r["arm"], r["cell"]) == (pair, arm, cell)]


def busiest(run: Path, cell: int) -> int:
    """The pair whose AV met most pedestrians."""
    rows = pq.read_table(run / "episodes.parquet").to_pylist()
    met = {r["pair"]: r["pedestrians"] for r in rows if (r["arm"], r["cell"]) == ("av", cell)}
    return max(met, key=lambda pair: met[pair])


def test_a_stored_record_that_was_changed_is_noticed(run: Path, tmp_path: Path) -> None:
    other = tmp_path / "run"
    other.mkdir()
    for path in run.glob("*.*"):
        (other / path.name).write_bytes(path.read_bytes())
    table = pq.read_table(other / "episodes.parquet")
    steps = table["steps"].to_pylist()
    position = table.schema.get_field_index("steps")
    more = pa.array([step + 1 for step in steps], type=pa.int32())
    changed = table.set_column(position, table.schema.field("steps"), more)
    pq.write_table(changed, other / "episodes.parquet")
    done = here("replay", other, "--pair", 0, "--arm", "av", "--out", tmp_path / "out")
    assert done.returncode == 1
    assert f"episodes.steps: {steps[0]} instead of {steps[0] + 1}" in done.stdout


@pytest.mark.parametrize("arm", list(Arm))
def test_fcd_agrees_with_the_trace(run: Path, arm: Arm) -> None:
    pair = busiest(run, 1)
    folder = outputs(run, pair, arm, 1)
    site = read_site(Place(folder / "site.net.xml"))
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
            seen[name, number] = (*site.frame.to_road(x, y), speed)
    rows = stored(run, "traces", pair, arm.value, 1)
    compared = {"ego": 0, "pedestrian": 0}
    for row in rows:
        kind = row["object"].partition("-")[0]
        # Within about 1 cm of either kerb SUMO puts people up to 11 mm elsewhere.
        if kind == "pedestrian" and not 0.02 < row["y_m"] < 8.98:
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


def test_the_files_are_whole_and_time_lost_is_the_delay(run: Path) -> None:
    rows = pd.read_parquet(run / "episodes.parquet")
    rows = rows.query("cell == 1 and arm == 'av' and ending == 'crossed' and delay_s > 1")
    pair = int(rows["pair"].iloc[0])
    folder = outputs(run, pair, Arm.AV, 1)
    roots = {name: ET.parse(folder / name).getroot() for name in SUMO_FILES.values()}
    (trip,) = roots["tripinfo.xml"]
    assert trip.get("id") == "ego-0"
    (episode,) = stored(run, "episodes", pair, "av", 1)
    # SUMO's loss is the sum of (1 - v / v0) dt, our delay t - way / v0: equal but for the last step
    # beyond the passage, and SUMO's speeds at the ends of steps.
    assert float(trip.get("timeLoss")) == pytest.approx(episode["delay_s"], abs=0.2)


@pytest.mark.slow
def test_sumos_own_plot_of_the_trajectories(run: Path, tmp_path: Path) -> None:
    folder = outputs(run, 0, Arm.AV, 0)
    picture = tmp_path / "plot.png"
    tool = HOME / "tools" / "plot_trajectories.py"
    command = [*map(str, (sys.executable, tool, "-t", "td", "-o", picture, folder / "fcd.xml"))]
    env = {**os.environ, "MPLBACKEND": "agg", "SUMO_HOME": str(HOME)}
    done = subprocess.run(command, capture_output=True, text=True, env=env, timeout=120)
    assert done.returncode == 0, done.stderr
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_refused(run: Path, tmp_path: Path) -> None:
    full = tmp_path / "full"
    full.mkdir()
    (full / "file").touch()
    for pair, cell, out, word in (
        (PAIRS, 0, tmp_path / "out", "0 to 7"),
        (-1, 0, tmp_path / "out", "0 to 7"),
        (0, 2, tmp_path / "out", "0 to 1"),
        (0, 0, full, "not empty"),
        (0, 0, full / "file", "not empty"),
        (0, 0, full / "file" / "deeper", "cannot be written"),
    ):
        with pytest.raises(InputError, match=word):
            replay(run, pair, [Arm.AV], cell, out)
    refuses("not a run folder", lambda: replay(tmp_path, 0, [Arm.AV], 0, tmp_path / "out"))
    wrong = refusal("replay", run, "--pair", "0", "--arm", "ego", "--out", tmp_path / "out")
    assert "'ego' is not one of 'av', 'human', 'both'" in wrong
    assert not (tmp_path / "out").exists()


def test_both_arms_from_the_command_line(run: Path, tmp_path: Path) -> None:
    text = printed("replay", run, "--pair", "3", "--cell", "1", "--out", tmp_path / "out")
    assert text.count("identical") == 2
    names = {"site.net.xml", *SUMO_FILES.values()}
    for arm in ("av", "human"):
        assert {path.name for path in (tmp_path / "out" / arm).iterdir()} == names


def test_an_episode_that_kills_its_process_ends_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A run in this process, which has to live; the replay's own process has the real fault.
    monkeypatch.setitem(FAULTS, "aborts", raise_error)
    changes = {**QUICK, "arms.av": NAME, "experiment.pairs": 2, **struck({"aborts": 1})}
    run_inline(one_cell("cctc", changes), tmp_path / "run")
    done = shell(
        *("replay", tmp_path / "run", "--pair", 1, "--arm", "av", "--out", tmp_path / "again"),
        cwd=CHECKOUT,
    )
    assert done.returncode == 1
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("harness:")]
    # 6 is SIGABRT's number on every POSIX system.
    assert "died (exit code -6)" in line
    assert done.stdout == ""


def test_an_episode_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(FAULTS, "hangs", raise_error)
    changes = {**QUICK, "arms.av": NAME, "experiment.pairs": 1, **struck({"hangs": 0})}
    changes["experiment.timeout_s"] = 5.0
    run_inline(one_cell("cctc", changes), tmp_path / "run")
    (again,) = replay(tmp_path / "run", 0, [Arm.AV], 0, tmp_path / "again", hang_after_s=1.0)
    assert again.problem is not None
    assert "no pair finished within" in again.problem
    assert "in hang" in (tmp_path / "again" / "stack.txt").read_text(encoding="utf-8")


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
    behaviours = "pedestrians.behaviour=constant,gap_acceptance,threshold,reactive"
    study = sweep("cctc_flow", {**changes, "pedestrians.timed": TIMED}, behaviours)
    run_inline(study, tmp_path / "run", traces=True)
    pedestrians = pq.read_table(tmp_path / "run" / "pedestrians.parquet").to_pylist()
    walked = [row for row in pedestrians if row["start_s"] is not None]
    with_legs = {row["cell"] for row in walked if row["legs"] is not None and row["index"] > 0}
    assert with_legs == {3}
    assert {row["cell"] for row in walked if row["critical_gap_s"] is not None} == {1}
    assert {row["cell"] for row in walked if row["latency_s"] is not None} == {2}
    assert all(row["legs"] is not None for row in walked if row["index"] == 0)
    with one_process():
        for cell in range(4):
            for again in replay(tmp_path / "run", 1, list(Arm), cell, tmp_path / f"again-{cell}"):
                assert again.differences == (), (cell, again.arm)
