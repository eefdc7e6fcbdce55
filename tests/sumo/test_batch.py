"""Batches: the same bytes however they are carried out, and what resume accepts."""

import json
import os
import signal
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from harness.core.encounter import Arm, Trace
from harness.core.errors import HarnessError, InputError
from harness.episode import pairing
from harness.episode.loop import Episode, drive
from harness.episode.traffic.pairing import HourOutcome, HourRunner
from harness.old.store.reading import read_manifest
from harness.old.store.run_folder import claim_folder
from harness.old.studies.batch.experiment import resume
from harness.old.studies.kinds.tasks import Task
from harness.old.studies.workers.pool import LocalPool
from harness.scenario import Study
from tests.batches import (
    FLOW,
    QUICK,
    Inline,
    content,
    one_cell,
    options_of,
    printed,
    run_inline,
    run_stopped,
    sweep,
)

TABLES = ("episodes", "pedestrians", "pairs", "traces")
LAMBDA = "pedestrians.flow_per_hour"
BOTH = "arms.av=hard_yield,soft_yield"


pytestmark = pytest.mark.usefixtures("no_simulation")


def flow_study() -> Study:
    return sweep("cctc_flow", FLOW, f"{LAMBDA}=200,1000", BOTH)


def quick(pairs: int) -> Study:
    """Short episodes."""
    return one_cell("cctc", {**QUICK, "experiment.pairs": pairs})


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The flow study in one process, with traces: what every other way is held against."""
    folder = tmp_path_factory.mktemp("batch") / "plain"
    return run_inline(flow_study(), folder, traces=True).path


def assert_alike(one: Path, other: Path) -> None:
    assert content(one) == content(other)


@pytest.mark.parametrize(
    ("make", "task_pairs"),
    [
        (LocalPool, 5),
        (Inline, 1),
        *(pytest.param(*way, marks=pytest.mark.slow) for way in ((LocalPool, 50), (Inline, 7))),
    ],
)
def test_same_bytes_for_any_workers_and_tasks(
    plain: Path, tmp_path: Path, make: Any, task_pairs: int
) -> None:
    workers = 1 if task_pairs == 50 else 2
    options = {"workers": workers, "task_pairs": task_pairs, "traces": True}
    run_inline(flow_study(), tmp_path / "run", make, **options)
    assert_alike(tmp_path / "run", plain)


def test_pedestrians_at_the_trigger_do_not_depend_on_the_task(tmp_path: Path) -> None:
    # Their walking speeds are worked out together for all pairs of a task.
    for task_pairs in (24, 1, 5):
        run_inline(quick(24), tmp_path / str(task_pairs), task_pairs=task_pairs)
        assert_alike(tmp_path / str(task_pairs), tmp_path / "24")


def test_an_arm_that_cells_share_is_simulated_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driven = []

    def counted(episode: Episode, strategy: object) -> Trace:
        driven.append(strategy)
        return drive(episode, strategy)

    monkeypatch.setattr(pairing, "drive", counted)
    changes = {**FLOW, "experiment.pairs": 4}
    humans = ("human_gmm", "gap_yield")
    run_inline(sweep("cctc_flow", changes, f"arms.human={','.join(humans)}"), tmp_path / "both")
    # The AV's arm once, the human's of each cell.
    assert len(driven) == (1 + 2) * 4
    for cell, human in enumerate(humans):
        run_inline(one_cell("cctc_flow", {**changes, "arms.human": human}), tmp_path / human)
        for table in ("episodes", "pedestrians"):
            own = pq.read_table(tmp_path / human / f"{table}.parquet").drop_columns("cell")
            both = pq.read_table(tmp_path / "both" / f"{table}.parquet")
            mine = both.filter(pa.compute.equal(both["cell"], cell)).drop_columns("cell")
            assert mine.equals(own)


@pytest.mark.parametrize(("share", "arms"), [(1.0, 1 + 3), (0.5, 2 * 3)])
def test_hours_with_several_references_simulate_the_av_once(
    share: float, arms: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unless the reference drives in the AV's arm too; sharing changes no byte of a cell."""
    simulated = []
    run_arm = HourRunner.run_arm

    def counted(runner: HourRunner, pair: int, arm: Arm) -> HourOutcome:
        simulated.append(arm)
        return run_arm(runner, pair, arm)

    monkeypatch.setattr(HourRunner, "run_arm", counted)
    traffic = {"flow_per_hour": 400.0, "duration_s": 40.0, "warm_up_s": 10.0, "av_share": share}
    changes = {
        "experiment.pairs": 1,
        "arms.av": "gap_yield",
        "pedestrians.flow_per_hour": 600.0,
        **{f"traffic.{name}": value for name, value in traffic.items()},
    }
    humans = ("human_yield", "human_recorded", "human_gmm")
    study = sweep("cctc_flow", changes, f"arms.human={','.join(humans)}")
    run_inline(study, tmp_path / "all", traces=True)
    assert len(simulated) == arms
    for cell, human in enumerate(humans):
        run_inline(
            one_cell("cctc_flow", {**changes, "arms.human": human}), tmp_path / human, traces=True
        )
        for table in ("hours", "passages", "pedestrians", "queues", "traces"):
            own = pq.read_table(tmp_path / human / f"{table}.parquet").drop_columns("cell")
            every = pq.read_table(tmp_path / "all" / f"{table}.parquet")
            mine = every.filter(pa.compute.equal(every["cell"], cell)).drop_columns("cell")
            assert own.num_rows > 0
            assert mine.equals(own)


@pytest.mark.parametrize("tasks", [2, 7])
def test_same_bytes_after_resume(plain: Path, tmp_path: Path, tasks: int) -> None:
    run_stopped(flow_study(), tmp_path / "run", tasks, task_pairs=3, traces=True)
    assert read_manifest(tmp_path / "run")["counts"] is None
    assert len(list((tmp_path / "run").glob("shards/*.arrows"))) >= tasks - 2
    resume(tmp_path / "run", make_executor=Inline)
    assert_alike(tmp_path / "run", plain)


class Timed(Inline):
    """Notes its tasks, whose pairs take so long each."""

    def __init__(self, pair_s: float = 1.0, workers: int = 1) -> None:
        super().__init__(workers)
        self.pair_s, self.tasks = pair_s, list[Task]()

    def submit(self, function: Any, argument: Any) -> Any:
        self.tasks.append(argument)
        (result,) = super().submit(function, argument).result()
        timed: Future[Any] = Future()
        timed.set_result((replace(result, took_s=self.pair_s * argument.count),))
        return timed


def test_finished_pairs_do_not_run_again(tmp_path: Path) -> None:
    run_stopped(quick(20), tmp_path / "run", 5, task_pairs=2)
    kept = {path.stem for path in (tmp_path / "run" / "shards").glob("*.arrows")}
    notes = Timed()
    resume(tmp_path / "run", make_executor=lambda _: notes)
    done = {pair for name in kept for pair in pairs_of(name)}
    again = {pair for task in notes.tasks for pair in pairs_of(task.name)}
    assert 5 <= len(done) <= 10
    assert sorted([*done, *again]) == list(range(20))


@pytest.mark.parametrize("pair_s", [0.004, 1.0, 60.0])
def test_tasks_are_cut_by_the_time_they_take(tmp_path: Path, pair_s: float) -> None:
    """Two workers then end within a small task of each other, and neither is busy for minutes."""
    timed = Timed(pair_s, workers=2)
    options = {"workers": 2, "task_pairs": 20, "engine": "plain"}
    run_inline(quick(120), tmp_path / "run", lambda _: timed, **options)
    sizes = [task.count for task in timed.tasks]
    assert sum(sizes) == 120
    # Two for each worker, before anything is known of their time.
    assert sizes[:4] == [1, 1, 1, 1]
    if pair_s == 0.004:
        # An eighth of what is left, but at least 20 ms: 116/8 = 14, 102/8 = 12, 90/8 = 11 …
        assert sizes[4:7] == [14, 12, 11]
        assert min(sizes[4:-1]) == 5
        assert sizes[4:] == sorted(sizes[4:], reverse=True)
    else:
        # At most 5 s.
        assert max(sizes) == (5 if pair_s == 1.0 else 1)


def pairs_of(name: str) -> range:
    """The pairs in a task's name: cell-first-count."""
    _, first, count = (int(part) for part in name.split("-"))
    return range(first, first + count)


def by_keys(folder: Path, name: str) -> dict[tuple[Any, ...], list[dict[str, Any]]]:
    """Rows of a table by the varied keys of their cell, without the cell's number."""
    cells = pq.read_table(folder / "cells.parquet").to_pylist()
    keys = {row.pop("cell"): tuple(sorted(row.items())) for row in cells}
    rows: dict[tuple[Any, ...], list[dict[str, Any]]] = {key: [] for key in keys.values()}
    for row in pq.read_table(folder / f"{name}.parquet").to_pylist():
        rows[keys[row.pop("cell")]].append(row)
    return rows


def csv_rows(folder: Path) -> list[list[tuple[str, str]]]:
    head, *lines = (folder / "summary.csv").read_text(encoding="utf-8").splitlines()
    pairs = [zip(head.split(","), line.split(","), strict=True) for line in lines]
    return [sorted(row) for row in pairs]


def test_neither_another_strategy_nor_the_order_changes_a_cell(plain: Path, tmp_path: Path) -> None:
    three = "arms.av=soft_yield,constant_speed,hard_yield"
    study = sweep("cctc_flow", FLOW, three, f"{LAMBDA}=1000,200")
    run_inline(study, tmp_path / "run", traces=True)
    for name in TABLES:
        more, fewer = by_keys(tmp_path / "run", name), by_keys(plain, name)
        assert len(more) == 6
        assert {key: more[key] for key in fewer} == fewer, name
    ours, theirs = (csv_rows(folder) for folder in (tmp_path / "run", plain))
    assert [row for row in theirs if row not in ours] == []
    assert (len(ours), len(theirs)) == (6, 4)


def test_traces_hold_every_step_and_change_nothing_else(plain: Path, tmp_path: Path) -> None:
    run_inline(flow_study(), tmp_path / "run")
    with_traces, without = content(plain), content(tmp_path / "run")
    assert set(with_traces) - set(without) == {"traces.parquet"}
    same = set(without) - {"manifest.json"}
    assert {name: with_traces[name] for name in same} == {name: without[name] for name in same}
    traces = pq.read_table(plain / "traces.parquet").to_pandas()
    egos = traces[traces["object"] == "ego"].groupby(["cell", "pair", "arm"]).size()
    episodes = pq.read_table(plain / "episodes.parquet").to_pandas()
    steps = episodes.set_index(["cell", "pair", "arm"])["steps"]
    # n steps have n + 1 ends.
    assert (egos.sort_index() == steps.sort_index() + 1).all()


def test_folder_has_what_the_files_page_says_and_no_nan(plain: Path) -> None:
    assert set(content(plain)) == {
        "manifest.json",
        *("summary.parquet", "summary.csv", "measures.csv", "conflicts.csv"),
        *(f"{name}.parquet" for name in ("cells", "episodes", "pairs", "pedestrians", "traces")),
    }
    for path in plain.glob("*.parquet"):
        table = pq.read_table(path)
        for name, column in zip(table.column_names, table.columns, strict=True):
            if pa.types.is_floating(column.type):
                assert np.isfinite(column.drop_null().to_numpy()).all(), (path.name, name)
    manifest = json.loads((plain / "manifest.json").read_text(encoding="utf-8"))
    # 4 cells of 12 pairs, two arms each.
    assert (manifest["counts"]["pairs"], manifest["counts"]["episodes"]) == (48, 96)


def test_who_waits_for_an_empty_crossing_ends(tmp_path: Path) -> None:
    changes = {"arms.av": "hard_yield", **FLOW, "experiment.timeout_s": 40.0, LAMBDA: 1000.0}
    run_inline(one_cell("cctc_flow", changes), tmp_path / "run")
    episodes = pq.read_table(tmp_path / "run" / "episodes.parquet").to_pylist()
    av = [row for row in episodes if row["arm"] == "av"]
    assert {row["ending"] for row in av} == {"crossed", "timed_out"}
    for row in episodes:
        # 40 s are 400 steps of 0.1 s.
        assert row["steps"] <= 400
        assert (row["steps"] == 400) or row["ending"] != "timed_out"
        assert (row["pass_time_s"] is None) == (row["ending"] != "crossed")


def holder_of(folder: Path) -> "subprocess.Popen[str]":
    """A process that holds the lock of a run folder until it is ended."""
    code = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from harness.old.store.run_folder import RunFolder\n"
        "folder = RunFolder(Path(sys.argv[1]))\n"
        "print('held', flush=True)\n"
        "time.sleep(300)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(folder)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def test_one_process_for_each_folder(tmp_path: Path) -> None:
    run_stopped(quick(6), tmp_path / "run", 2, task_pairs=1)
    other = holder_of(tmp_path / "run")
    try:
        with pytest.raises(InputError, match="another process"):
            resume(tmp_path / "run", make_executor=Inline)
    finally:
        os.kill(other.pid, signal.SIGKILL)
        other.wait()
    # What the dead one left behind is in nobody's way.
    assert (tmp_path / "run" / ".lock").exists()
    resume(tmp_path / "run", make_executor=Inline)
    run_inline(quick(6), tmp_path / "whole")
    assert_alike(tmp_path / "run", tmp_path / "whole")


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("simulated_with", "versions", "sumo"), "1.27.0", ["sumo", "1.27.0", "1.28.0"]),
        (("simulated_with", "versions", "harness"), "0.0.1", ["harness", "0.0.1"]),
        (("simulated_with", "versions", "numpy"), None, ["numpy"]),
        (("simulated_with", "models", 0, "sha256"), "0" * 64, ["model"]),
        (("schema",), 999, ["999"]),
        (("cells",), None, ["cells", "None"]),
        (("scenario", "ego", "initial_speed_mps"), -1.0, ["initial_speed_mps"]),
    ],
)
def test_resume_under_other_conditions_is_refused(
    tmp_path: Path, path: tuple[Any, ...], value: object, words: list[str]
) -> None:
    run_stopped(quick(4), tmp_path / "run", 1, task_pairs=1)
    manifest = tmp_path / "run" / "manifest.json"
    document = json.loads(manifest.read_text(encoding="utf-8"))
    node = document
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    manifest.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        resume(tmp_path / "run", make_executor=Inline)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_resume_of_a_finished_run_only_reads_and_of_none_is_refused(tmp_path: Path) -> None:
    for folder in (tmp_path / "none", tmp_path):
        with pytest.raises(InputError, match=r"is no folder|not a run folder"):
            resume(folder, make_executor=Inline)
    assert list(tmp_path.iterdir()) == []
    first = run_inline(quick(6), tmp_path / "run")
    before = content(tmp_path / "run")
    # Killed while it cleared up: the manifest was written, a shard was still there.
    (tmp_path / "run" / "shards").mkdir()
    (tmp_path / "run" / "shards" / "0-0-3.arrows").write_bytes(b"")

    def nobody(_workers: int) -> Inline:
        raise AssertionError("nothing is left to do")

    again = resume(tmp_path / "run", make_executor=nobody)
    assert again.results == first.results
    assert content(tmp_path / "run") == before


def flip(data: bytes) -> bytes:
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 0xFF]) + data[middle + 1 :]


@pytest.mark.parametrize(
    "damage",
    [lambda _: b"", lambda _: b"no shard", lambda data: data[: len(data) // 2], flip],
    ids=["empty", "garbage", "cut off", "a byte changed"],
)
def test_a_damaged_shard_is_run_again(tmp_path: Path, damage: Any) -> None:
    run_inline(quick(6), tmp_path / "whole", traces=True)
    run_stopped(quick(6), tmp_path / "run", 3, task_pairs=1, traces=True)
    shard = min((tmp_path / "run" / "shards").glob("*.arrows"))
    shard.write_bytes(damage(shard.read_bytes()))
    resume(tmp_path / "run", make_executor=Inline)
    assert_alike(tmp_path / "run", tmp_path / "whole")


def test_folders_of_runs_that_start_at_the_same_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with ThreadPoolExecutor(8) as pool:
        folders = list(pool.map(lambda _: claim_folder(None, "cctc"), range(40)))
    assert sorted(folder.name for folder in folders) == sorted(f"cctc-{n}" for n in range(1, 41))


def test_a_file_system_that_refuses_is_one_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("harness.core.files.os.fsync", full)
    with pytest.raises(HarnessError, match="No space left on device"):
        run_inline(quick(2), tmp_path / "run")


def test_a_study_from_the_command_line(tmp_path: Path) -> None:
    scenario = tmp_path / "mine.toml"
    lines = ('arms.av = "hard_yield"', "experiment.pairs = 6", f'sweep.{LAMBDA} = ["200:400:200"]')
    scenario.write_text("\n".join(lines), encoding="utf-8")
    done = printed("run", scenario, cwd=tmp_path)
    for word in ("μ", "crashes", "delay", "200", "400", "runs/mine-1"):
        assert word in done
    rows = csv_rows(tmp_path / "runs" / "mine-1")
    assert [dict(row)[LAMBDA] for row in rows] == ["200", "400"]


MEASURE = """
import resource, subprocess, sys
done = subprocess.run([sys.executable, "-m", "harness", *sys.argv[1:]])
# Of the largest process below this one: the command or one of its workers, in kilobytes.
print(done.returncode, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_number_of_pairs(tmp_path: Path) -> None:
    peaks = {}
    for pairs in (1_000, 20_000):
        changes = options_of({**QUICK, "experiment.pairs": pairs})
        arguments = ["run", "cctc", "-q", "--out", str(tmp_path / str(pairs)), *changes]
        command = [sys.executable, "-c", MEASURE, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=1_800, check=True)
        code, peak = done.stdout.split()[-2:]
        assert code == "0", done.stderr
        peaks[pairs] = int(peak)
    assert peaks[20_000] <= 1.2 * peaks[1_000], peaks
