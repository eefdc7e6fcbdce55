"""Score: the measures of a run again from its traces alone, byte for byte."""

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pyarrow.parquet as pq
import pytest

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.core.versions import versions_of_runs
from harness.engine.shared import close_engine
from harness.scenario import Options, Precision, Study
from harness.store import summaries
from harness.strategies import own
from harness.strategies.constant_speed import ConstantSpeed
from harness.studies.batch import experiment, scoring
from harness.studies.batch.experiment import resume, run_study
from harness.studies.batch.scoring import score
from harness.studies.replay.rerun import replay
from tests.batches import FLOW, QUICK, Inline, content, here, one_cell, sweep

STUDIES = {
    "the paper's": lambda: one_cell("cctc", {"experiment.pairs": 30}),
    "crashes": lambda: one_cell("cctc", {**QUICK, "experiment.pairs": 40}),
    "flows with time-outs": lambda: sweep(
        "cctc_flow",
        {**FLOW, "experiment.pairs": 15, "experiment.timeout_s": 30.0},
        "pedestrians.flow_per_hour=100,1000",
        "arms.av=hard_yield,constant_speed",
    ),
}


@pytest.fixture(autouse=True)
def own_simulation(no_simulation: None) -> Iterator[None]:  # noqa: ARG001
    """Tasks that run in this process start its one simulation themselves."""
    yield
    close_engine()


def endings(folder: Path) -> set[str]:
    return set(pq.read_table(folder / "episodes.parquet")["ending"].to_pylist())


@pytest.mark.parametrize("name", list(STUDIES))
@pytest.mark.parametrize("part_pairs", [7, 500])
def test_score_equals_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, part_pairs: int
) -> None:
    study: Study = STUDIES[name]()
    run_study(study, Options(traces=True), out=tmp_path / "run", make_executor=Inline)
    if name == "crashes":
        assert endings(tmp_path / "run") == {"crashed", "crossed"}
    if name == "flows with time-outs":
        assert endings(tmp_path / "run") == {"crashed", "crossed", "timed_out"}
    monkeypatch.setattr(scoring, "_PART_PAIRS", part_pairs)
    score(tmp_path / "run", tmp_path / "scored")
    assert content(tmp_path / "scored") == content(tmp_path / "run")


def test_a_changed_trace_changes_the_measures(tmp_path: Path) -> None:
    study = one_cell("cctc", {**QUICK, "experiment.pairs": 3})
    run_study(study, Options(traces=True), out=tmp_path / "run", make_executor=Inline)
    path = tmp_path / "run" / "traces.parquet"
    table = pq.read_table(path)
    frame = table.to_pandas()
    # 2 m/s slower throughout: nothing else of the run says how fast it was.
    frame.loc[frame["object"] == "ego", "speed_mps"] -= 2.0
    pq.write_table(type(table).from_pandas(frame, schema=table.schema), path)
    score(tmp_path / "run", tmp_path / "scored")
    assert content(tmp_path / "scored") != content(tmp_path / "run")


def test_a_run_that_stopped_early_is_scored_with_its_confidence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(summaries, "FIRST_LOOK", 10)
    study = one_cell("cctc", {**QUICK, "experiment.pairs": 80})
    options = Options(traces=True, until=Precision("kappa", 0.3))
    run_study(study, options, out=tmp_path / "run", make_executor=Inline)
    assert pq.read_metadata(tmp_path / "run" / "pairs.parquet").num_rows < 80
    score(tmp_path / "run", tmp_path / "scored")
    assert content(tmp_path / "scored") == content(tmp_path / "run")


def test_scoring_gives_a_run_the_measures_added_since(tmp_path: Path) -> None:
    study = one_cell("cctc", {**QUICK, "experiment.pairs": 10})
    run_study(study, Options(traces=True), out=tmp_path / "run", make_executor=Inline)
    shutil.copytree(tmp_path / "run", tmp_path / "older")
    path = tmp_path / "older" / "episodes.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["stops", "max_jerk_mps3"]), path)
    score(tmp_path / "older", tmp_path / "scored")
    assert content(tmp_path / "scored") == content(tmp_path / "run")
    done = here("report", tmp_path / "older")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "lacks stops" in done.stderr
    assert "harness score" in done.stderr
    pq.write_table(pq.read_table(path).drop_columns(["ending"]), path)
    with pytest.raises(InputError, match="lacks ending"):
        score(tmp_path / "older", tmp_path / "again")


def test_a_score_says_what_simulated_and_what_scored(tmp_path: Path) -> None:
    study = one_cell("cctc", {**QUICK, "experiment.pairs": 3, "arms.human": "gone:Strategy"})
    # The strategy's module is there while it runs, and its measures need it no more.
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "gone", gone := ModuleType("gone"))
        patch.setattr(gone, "Strategy", ConstantSpeed, raising=False)
        options = Options(traces=True, sumo_outputs="all")
        patch.setattr(experiment, "write_outputs", lambda *_: ())
        run_study(study, options, out=tmp_path / "run", make_executor=Inline)
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
    study = one_cell("cctc", {**QUICK, "experiment.pairs": 2})
    run_study(study, Options(), out=tmp_path / "run", make_executor=Inline)
    with pytest.raises(InputError, match="kept no traces"):
        score(tmp_path / "run", tmp_path / "scored")
    assert not (tmp_path / "scored").exists()
    with pytest.raises(InputError, match="not a run folder"):
        score(tmp_path / "none", tmp_path / "scored")
    done = here("score", tmp_path / "run", "--out", tmp_path / "scored")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "--traces" in done.stderr


TIMED = [
    {
        "name": "CPFA-50",
        "side": "far",
        "start_lateral_m": 6.0,
        "acceleration_distance_m": 1.5,
        "speed_mps": 2.2,
        "impact_share": 0.5,
    }
]


def test_walks_of_every_behaviour_are_scored_and_replayed(tmp_path: Path) -> None:
    changes = {**FLOW, "experiment.pairs": 2, "pedestrians.flow_per_hour": 900.0}
    study = sweep(
        "cctc_flow",
        {**changes, "pedestrians.timed": TIMED},
        "pedestrians.behaviour=constant,gap_acceptance,reactive,sumo",
    )
    run_study(study, Options(traces=True), out=tmp_path / "run", make_executor=Inline)
    pedestrians = pq.read_table(tmp_path / "run" / "pedestrians.parquet").to_pylist()
    walked = [row for row in pedestrians if row["start_s"] is not None]
    with_legs = {row["cell"] for row in walked if row["legs"] is not None and row["index"] > 0}
    assert with_legs == {2, 3}
    assert {row["cell"] for row in walked if row["critical_gap_s"] is not None} == {1}
    assert all(row["legs"] is not None for row in walked if row["index"] == 0)
    score(tmp_path / "run", tmp_path / "scored")
    assert content(tmp_path / "scored") == content(tmp_path / "run")
    close_engine()
    for cell in range(4):
        for again in replay(tmp_path / "run", 1, list(Arm), cell, tmp_path / f"again-{cell}"):
            assert again.differences == (), (cell, again.arm)
