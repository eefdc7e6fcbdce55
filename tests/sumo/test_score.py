"""Score: the measures of a run again from its traces alone, byte for byte."""

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pyarrow.parquet as pq
import pytest

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.core.versions import versions_of_runs
from harness.scenario import Study
from harness.strategies import own
from harness.strategies.constant_speed import ConstantSpeed
from harness.studies.batch import experiment, scoring
from harness.studies.batch.experiment import resume
from harness.studies.batch.scoring import score
from harness.studies.replay.rerun import replay
from tests.batches import (
    FLOW,
    QUICK,
    Inline,
    content,
    one_cell,
    one_process,
    refusal,
    run_inline,
    sweep,
)

WITH_TIME_OUTS = {**FLOW, "experiment.pairs": 15, "experiment.timeout_s": 30.0}
VARY = ("pedestrians.flow_per_hour=100,1000", "arms.av=hard_yield,constant_speed")

pytestmark = pytest.mark.usefixtures("no_simulation")


def quick(folder: Path, pairs: int, changes: Any = (), **options: Any) -> Path:
    """A run of so many short episodes."""
    study = one_cell("cctc", {**QUICK, "experiment.pairs": pairs, **dict(changes)})
    return run_inline(study, folder, **options).path


def assert_scored_alike(run: Path, scored: Path) -> None:
    score(run, scored)
    assert content(scored) == content(run)


@pytest.mark.parametrize(
    ("study", "endings"),
    [
        (lambda: one_cell("cctc", {"experiment.pairs": 30}), {"crossed"}),
        (lambda: one_cell("cctc", {**QUICK, "experiment.pairs": 40}), {"crashed", "crossed"}),
        (
            lambda: sweep("cctc_flow", WITH_TIME_OUTS, *VARY),
            {"crashed", "crossed", "timed_out"},
        ),
    ],
)
def test_score_equals_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, study: Callable[[], Study], endings: set[str]
) -> None:
    run = run_inline(study(), tmp_path / "run", traces=True)
    assert {*run.episodes["ending"]} == endings
    for part_pairs in (7, 500):
        monkeypatch.setattr(scoring, "_PART_PAIRS", part_pairs)
        assert_scored_alike(run.path, tmp_path / f"scored-{part_pairs}")


def test_a_changed_trace_changes_the_measures(tmp_path: Path) -> None:
    quick(tmp_path / "run", 3, traces=True)
    path = tmp_path / "run" / "traces.parquet"
    table = pq.read_table(path)
    frame = table.to_pandas()
    # 2 m/s slower throughout: nothing else of the run says how fast it was.
    frame.loc[frame["object"] == "ego", "speed_mps"] -= 2.0
    pq.write_table(type(table).from_pandas(frame, schema=table.schema), path)
    score(tmp_path / "run", tmp_path / "scored")
    assert content(tmp_path / "scored") != content(tmp_path / "run")


def test_scoring_gives_a_run_the_measures_added_since(tmp_path: Path) -> None:
    quick(tmp_path / "run", 10, traces=True)
    shutil.copytree(tmp_path / "run", tmp_path / "older")
    path = tmp_path / "older" / "episodes.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["stops", "max_jerk_mps3"]), path)
    score(tmp_path / "older", tmp_path / "scored")
    assert content(tmp_path / "scored") == content(tmp_path / "run")
    line = refusal("report", tmp_path / "older")
    assert "lacks stops" in line
    assert "harness score" in line
    pq.write_table(pq.read_table(path).drop_columns(["ending"]), path)
    with pytest.raises(InputError, match="lacks ending"):
        score(tmp_path / "older", tmp_path / "again")


def test_a_score_says_what_simulated_and_what_scored(tmp_path: Path) -> None:
    # The strategy's module is there while it runs, and its measures need it no more.
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "gone", gone := ModuleType("gone"))
        patch.setattr(gone, "Strategy", ConstantSpeed, raising=False)
        patch.setattr(experiment, "write_outputs", lambda *_: ())
        human = {"arms.human": "gone:Strategy"}
        quick(tmp_path / "run", 3, human, traces=True)
    own.load_once.cache_clear()
    path = tmp_path / "run" / "manifest.json"
    document = json.loads(path.read_text())
    assert document["scored_with"]["versions"] == document["simulated_with"]["versions"]
    document["simulated_with"]["versions"]["sumo"] = "1.0"
    document["simulated_with"]["models"][0]["sha256"] = "0" * 64
    path.write_text(json.dumps(document))
    score(tmp_path / "run", tmp_path / "scored")
    scored = json.loads((tmp_path / "scored" / "manifest.json").read_text())
    assert scored["simulated_with"] == document["simulated_with"]
    assert scored["scored_with"] == {"versions": versions_of_runs()}
    assert scored["know_the_model"] == document["know_the_model"]

    def simulates(_workers: int) -> Inline:
        raise AssertionError("a scored run is simulated")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiment, "write_outputs", lambda *_: simulates(1))
        assert resume(tmp_path / "scored", make_executor=simulates).finished


def test_refused(tmp_path: Path) -> None:
    run = quick(tmp_path / "run", 2)
    for folder, words in ((run, "kept no traces"), (tmp_path / "none", "not a run folder")):
        with pytest.raises(InputError, match=words):
            score(folder, tmp_path / "scored")
        assert not (tmp_path / "scored").exists()
    assert "--traces" in refusal("score", run, "--out", tmp_path / "scored")


RUNNER = {"start_lateral_m": 6.0, "acceleration_distance_m": 1.5, "speed_mps": 2.2}
TIMED = [{"name": "CPFA-50", "side": "far", "impact_share": 0.5, **RUNNER}]


def test_walks_of_every_behaviour_are_scored_and_replayed(tmp_path: Path) -> None:
    changes = {**WITH_TIME_OUTS, "experiment.pairs": 2, "pedestrians.flow_per_hour": 900.0}
    behaviours = "pedestrians.behaviour=constant,gap_acceptance,threshold,reactive"
    study = sweep("cctc_flow", {**changes, "pedestrians.timed": TIMED}, behaviours)
    run_inline(study, tmp_path / "run", traces=True)
    pedestrians = pq.read_table(tmp_path / "run" / "pedestrians.parquet").to_pylist()
    walked = [row for row in pedestrians if row["start_s"] is not None]
    with_legs = {row["cell"] for row in walked if row["legs"] is not None and row["index"] > 0}
    assert with_legs == {3, 4}
    assert {row["cell"] for row in walked if row["critical_gap_s"] is not None} == {1}
    assert {row["cell"] for row in walked if row["latency_s"] is not None} == {2}
    assert all(row["legs"] is not None for row in walked if row["index"] == 0)
    assert_scored_alike(tmp_path / "run", tmp_path / "scored")
    with one_process():
        for cell in range(5):
            for again in replay(tmp_path / "run", 1, list(Arm), cell, tmp_path / f"again-{cell}"):
                assert again.differences == (), (cell, again.arm)
