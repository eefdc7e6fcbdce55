"""Runs of the plain engine: SUMO's records without SUMO; a share and every crash are audited."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from harness.core.encounter import Arm
from harness.core.errors import InputError, InterruptedRunError
from harness.engine.plain import PlainEngine
from harness.episode.pairing import PairRunner
from harness.measures import Outcome
from harness.measures.agreement import TOLERANCE
from harness.report.one_pair import run_pair
from harness.scenario import Scenario
from harness.store.run_folder import RunFolder
from harness.studies.batch.experiment import resume
from harness.studies.kinds.audit import audit_of
from harness.studies.replay.rerun import debug
from harness.studies.runs.opening import load_run
from harness.studies.runs.reported import audit_lines
from harness.studies.runs.run_data import RunData
from tests import planner
from tests.batches import FLOW, Inline, one_cell, run_inline, sweep
from tests.conftest import close_all

CRASHES = {**FLOW, "arms.av": "constant_speed", "experiment.pairs": 24}
PLAIN: dict[str, Any] = {"engine": "plain", "audit": 0.25}


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunData, RunData]:
    folder, study = tmp_path_factory.mktemp("both"), one_cell("cctc_flow", CRASHES)
    return run_inline(study, folder / "plain", **PLAIN), run_inline(study, folder / "sumo")


def test_every_record_is_sumos_and_is_replayed_there(both: tuple[RunData, RunData]) -> None:
    plain, sumo = (run.episodes for run in both)
    assert (plain["ending"] == "crashed").sum() > 3
    for name in plain.columns.drop("sumo_collision"):
        if pd.api.types.is_float_dtype(plain[name]):
            pd.testing.assert_series_equal(
                plain[name], sumo[name], rtol=TOLERANCE, atol=TOLERANCE, check_exact=False
            )
        else:
            assert plain[name].equals(sumo[name]), name
    assert plain["sumo_collision"].isna().all()
    close_all()
    repeated = debug(both[0].path, 3, [*Arm])
    assert [one.differences for one in repeated.values()] == [(), ()]


def test_a_share_and_every_crash_are_repeated(both: tuple[RunData, RunData]) -> None:
    run = both[0]
    crashed = run.episodes[run.episodes["ending"] == "crashed"]
    wanted = {*zip(crashed["pair"], crashed["arm"], strict=True)}
    offset = audit_of(0.25, run.scenario).first
    wanted |= {(pair, arm.value) for pair in range(offset, 24, 4) for arm in Arm}
    assert {*zip(run.audit["pair"], run.audit["arm"], strict=True)} == wanted
    assert run.disagreements == ()
    count = len(wanted)
    assert audit_lines(run) == [f"Plain engine: {count} of {count} records repeated in SUMO agree."]
    assert audit_lines(both[1]) == []


@pytest.mark.parametrize(("pairs", "share", "count"), [(1000, 0.01, 10), (50, 0.01, 1), (7, 1, 7)])
def test_how_many_pairs_are_chosen(pairs: int, share: float, count: int) -> None:
    chosen = set()
    for seed in range(20):
        scenario = Scenario.model_validate({"experiment": {"pairs": pairs, "seed": seed}})
        own = [pair for pair in range(pairs) if audit_of(share, scenario).repeats(pair)]
        assert len(own) == count
        chosen.add(tuple(own))
    assert len(chosen) > 5 or share == 1
    assert not audit_of(0, scenario).repeats(0)


@pytest.mark.usefixtures("no_simulation")
def test_a_record_that_is_not_sumos_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    honest = PlainEngine.step

    def drifting(self: PlainEngine, *of: object) -> tuple[float, float]:
        x, speed = honest(self, *of)  # type: ignore[arg-type]
        self._x += 1e-4
        return x + 1e-4, speed

    monkeypatch.setattr(PlainEngine, "step", drifting)
    study = one_cell("cctc", {"experiment.pairs": 3, "arms.av": planner.NAME})
    run = run_inline(study, tmp_path / "run", engine="plain", audit=1.0)
    assert len(run.disagreements) == 6
    assert run.ties == ()
    assert "0 of 6 records repeated in SUMO agree" in audit_lines(run)[0]
    assert "Cell 0 pair 0 human: pass_time_s" in audit_lines(run)[2]


@pytest.mark.usefixtures("no_simulation")
def test_a_tie_of_the_strategy_is_counted_and_named_and_no_failure(tmp_path: Path) -> None:
    changes = {**FLOW, "arms.av": planner.NAME, "experiment.pairs": 8}
    study = one_cell("cctc_flow", changes)
    run = run_inline(study, tmp_path / "run", engine="plain", audit=1.0)
    assert run.disagreements == ()
    assert {arm for _, _, arm, _ in run.ties} == {"av"}
    # What is stored of the first: until the tie SUMO drives the same, then it does not.
    _, pair, _, words = run.ties[0]
    when = float(run.audit["tie_s"].dropna().iloc[0])
    both = [run_pair(study.cells[0].scenario, pair, engine=of).av for of in ("plain", "sumo")]
    speeds = [of.trace.speed_mps for of in both]
    step = round(when / 0.1)
    assert np.abs(speeds[0][: step + 1] - speeds[1][: step + 1]).max() < 1e-9
    assert abs(speeds[0][step + 1] - speeds[1][step + 1]) > 0.09
    assert words.startswith(f"tie at {when:.3f} s, ")
    first, *named = audit_lines(run)
    agree = 16 - len(run.ties)
    assert f"{agree} of 16 records repeated in SUMO agree, {len(run.ties)} differ by a tie" in first
    assert named[0].startswith(f"Cell 0 pair {pair} av: tie at ")


@pytest.mark.usefixtures("no_simulation")
def test_a_resumed_run_is_audited_as_a_whole_one(
    tmp_path: Path, both: tuple[RunData, RunData], monkeypatch: pytest.MonkeyPatch
) -> None:
    written = RunFolder.write_shard

    def interrupted(self: RunFolder, cell: int, first: int, count: int, rows: Any) -> None:
        written(self, cell, first, count, rows)
        # Tasks are cut by the time that pairs take: the first may hold a single pair.
        if any(rows["audit"]["pair"]):
            raise KeyboardInterrupt

    study = one_cell("cctc_flow", CRASHES)
    with monkeypatch.context() as patch:
        patch.setattr(RunFolder, "write_shard", interrupted)
        with pytest.raises(InterruptedRunError):
            run_inline(study, tmp_path / "run", **PLAIN, task_pairs=6)
    assert not load_run(tmp_path / "run").finished
    assert len(load_run(tmp_path / "run").audit) > 0
    resume(str(tmp_path / "run"), make_executor=Inline)
    for name in ("audit.parquet", "episodes.parquet", "summary.csv"):
        one, other = (path / name for path in (tmp_path / "run", both[0].path))
        assert one.read_bytes() == other.read_bytes(), name


@pytest.mark.usefixtures("no_simulation")
def test_an_arm_that_cells_share_is_repeated_and_counted_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    repeated: list[tuple[Arm, int]] = []
    simulated = PairRunner.run_arm

    def counted(self: PairRunner, pair: int, arm: Arm, *of: object, **asked: object) -> Outcome:
        repeated.append((arm, pair))
        return simulated(self, pair, arm, *of, **asked)  # type: ignore[arg-type]

    monkeypatch.setattr(PairRunner, "run_arm", counted)
    humans = ["human_gmm", "human_yield"]
    study = sweep("cctc_flow", CRASHES, f"arms.human={','.join(humans)}")
    half: dict[str, Any] = {"engine": "plain", "audit": 0.5}
    run = run_inline(study, tmp_path / "run", **half)

    # Every second pair, and every crash; the AV's arm is the same in both cells.
    first = audit_of(0.5, run.scenario).first
    episodes = run.episodes
    chosen = (episodes["pair"] % 2 == first) | (episodes["ending"] == "crashed")
    rows = episodes[chosen][["cell", "pair", "arm"]].reset_index(drop=True)
    pd.testing.assert_frame_equal(run.audit[["cell", "pair", "arm"]], rows)
    av = rows[(rows["arm"] == "av") & (rows["cell"] == 0)]
    human = rows[rows["arm"] == "human"]
    expected = {Arm.AV: av["pair"], Arm.HUMAN: human["pair"]}
    assert sorted(repeated) == sorted((arm, pair) for arm in Arm for pair in expected[arm])
    count = len(av) + len(human)
    assert f"{count} of {count} records repeated in SUMO agree" in audit_lines(run)[0]

    # Each cell's rows are those of the cell run alone.
    for number, name in enumerate(humans):
        own = one_cell("cctc_flow", {**CRASHES, "arms.human": name})
        alone = run_inline(own, tmp_path / name, **half)
        rows = run.audit[run.audit["cell"] == number].drop(columns="cell").reset_index(drop=True)
        pd.testing.assert_frame_equal(rows, alone.audit.drop(columns="cell"))


@pytest.mark.parametrize(
    ("changes", "options", "said"),
    [
        ({"arms.av": "sumo_driver"}, {}, 'arms.av = "sumo_driver" needs SUMO'),
        ({"pedestrians.behaviour": "sumo"}, {}, 'pedestrians.behaviour = "sumo" needs SUMO'),
        ({"traffic.flow_per_hour": 600}, {}, r"\[traffic\] needs SUMO"),
        ({}, {"sumo_outputs": "all"}, "--sumo-outputs: cannot be combined with --engine plain"),
    ],
)
def test_refused(
    tmp_path: Path, changes: dict[str, object], options: dict[str, object], said: str
) -> None:
    study = one_cell("cctc_flow", changes)
    with pytest.raises(InputError, match=said):
        run_inline(study, tmp_path / "run", engine="plain", **options)
    assert not (tmp_path / "run").exists()
