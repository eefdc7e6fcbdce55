"""Stored episodes repeated: with SUMO's files, in this process, and for the page."""

from pathlib import Path

import pytest

from harness.core.vocabulary import Arm
from harness.results.folder import read_cell
from harness.results.loaded_run import Run
from harness.studies.page_content import chosen_pairs, shown_pairs
from harness.studies.running.replay import replay
from harness.studies.running.run import run
from harness.studies.worst import worst
from tests.scenes import refuses

FILES = {"fcd.xml", "tripinfo.xml", "collisions.xml", "site.net.xml"}


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return run("cctc_flow", pairs=8, out=tmp_path_factory.mktemp("replays") / "run", workers=0)


def test_a_range_of_pairs_has_a_folder_for_each_episode(stored: Run, tmp_path: Path) -> None:
    replayed = replay(stored, 0, range(1, 3), list(Arm), tmp_path / "out")
    assert [(each.differences, each.problem) for each in replayed] == [((), None)] * 4
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        *("1-av", "1-human", "2-av", "2-human")
    }
    assert {path.name for path in (tmp_path / "out" / "2-av").iterdir()} == FILES


OWN = """
class Brakes:
    def decide(self, observation):
        return -{brake}
"""


def test_a_difference_from_the_record_is_named_after_what_has_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "brakes_replayed.py"
    file.write_text(OWN.format(brake=0.5))
    settings = {"arms.av": "brakes_replayed:Brakes", "experiment.timeout_s": 60.0}
    stored = run("cctc", settings=settings, pairs=1, out="run", workers=1)
    (same,) = replay(stored, 0, range(1), [Arm.AV], Path("same"))
    assert same.differences == ()
    file.write_text(OWN.format(brake=1.5))
    (other,) = replay(stored, 0, range(1), [Arm.AV], Path("other"))
    assert other.differences[0].endswith("Brakes has been edited since the run")
    assert any("episodes.max_deceleration_mps2" in line for line in other.differences)


@pytest.mark.parametrize("kept", [False, True])
def test_shown_pairs_have_the_traces_of_the_record(stored: Run, tmp_path: Path, kept: bool) -> None:
    traced = run("cctc_flow", pairs=8, traces=True, out=tmp_path / "run", workers=0)
    shown = shown_pairs(traced if kept else stored)
    assert {(pair.cell, pair.pair) for pair in shown} == {(0, pair) for pair in range(8)}
    for pair in shown:
        assert (pair.repeated, pair.differences) == (not kept, ())
        assert pair.traces.equals(read_cell(traced.path, "traces", 0, traced.manifest, pair.pair))


def test_the_worst_come_first_and_each_has_its_command(stored: Run) -> None:
    result = worst(stored, "delay_s", 3)
    rows = stored.episodes[stored.episodes["arm"] == "av"].nlargest(3, "delay_s")
    assert [record["pair"] for record in result.records] == rows["pair"].tolist()
    assert f"--pair {rows['pair'].iloc[0]} --arm av --gui" in result.closing[0]
    assert len({key for keys in chosen_pairs(stored).values() for key in keys}) == 8
    refuses("unknown measure", lambda: worst(stored, "delays"))
    refuses("neither small nor large", lambda: worst(stored, "arrivals"))
