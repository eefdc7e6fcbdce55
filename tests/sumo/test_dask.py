"""The same tasks on a Dask cluster: a scheduler and workers on the loopback interface.

Only processes started here are ended, by their ids.
"""

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from harness.core.errors import InputError
from harness.old.studies.batch.experiment import run_study
from harness.old.studies.runs.run_data import RunData
from harness.scenario import Options, Study
from tests.batches import (
    QUICK,
    content,
    one_cell,
    options_of,
    printed,
    refusal,
    run_inline,
    shell,
    start,
    sweep,
    wait_for,
)
from tests.faulty import NAME, struck

Client = pytest.importorskip("distributed", reason="the extra `cluster` is missing").Client
from harness.old.studies.workers.cluster import DaskCluster  # noqa: E402

CHANGES = {**QUICK, "experiment.pairs": 120}

Launch = Callable[..., "subprocess.Popen[bytes]"]


@pytest.fixture(scope="module")
def launch(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Launch]:
    """Starts ``dask …`` in a folder of its own, as on another machine; ends it with the tests."""
    started: list[subprocess.Popen[bytes]] = []

    def make(*arguments: str) -> "subprocess.Popen[bytes]":
        folder = tmp_path_factory.mktemp("dask")
        with (folder / "log.txt").open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *arguments], cwd=folder, stdout=log, stderr=log
            )
        started.append(process)
        return process

    yield make
    for process in reversed(started):
        end(process)


def end(process: "subprocess.Popen[bytes]") -> None:
    """End a process and, if it leaves any, its own children."""
    try:
        children = psutil.Process(process.pid).children(recursive=True)
    except psutil.NoSuchProcess:
        children = []
    process.terminate()
    try:
        process.wait(timeout=20)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    for child in children:
        if child.is_running():
            child.kill()


def scheduler(launch: Launch, folder: Path) -> "tuple[subprocess.Popen[bytes], str]":
    """A scheduler's process and its address."""
    file = folder / "scheduler.json"
    options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file"]
    process = launch("scheduler", *options, str(file))
    # The file is there before anything is in it.
    wait_for(lambda: file.exists() and file.stat().st_size, "a scheduler")
    return process, str(json.loads(file.read_text(encoding="utf-8"))["address"])


def worker(launch: Launch, address: str, threads: int = 1) -> "subprocess.Popen[bytes]":
    process = launch("worker", address, "--nthreads", str(threads), "--no-dashboard")
    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(1, timeout=300)
    return process


@pytest.fixture(scope="module")
def cluster(launch: Launch, tmp_path_factory: pytest.TempPathFactory) -> str:
    """A scheduler with one worker of one thread; gives its address."""
    _, address = scheduler(launch, tmp_path_factory.mktemp("cluster"))
    worker(launch, address)
    return address


@pytest.fixture
def whole(tmp_path: Path) -> dict[str, bytes]:
    """The same run in this process."""
    return content(run_inline(one_cell("cctc", CHANGES), tmp_path / "whole", traces=True).path)


def run_there(study: Study, options: Options, cluster: str, folder: Path) -> RunData:
    return run_study(study, options, out=folder, make_executor=lambda _: DaskCluster(cluster))


def until_a_shard(
    folder: Path, running: "subprocess.Popen[str]", strike: Callable[[], None]
) -> str:
    """What a run says whose cluster or itself is struck when some of its work is finished."""
    try:
        wait_for(lambda: list(folder.glob("shards/*.arrows")), "finished work")
        strike()
        return running.communicate(timeout=300)[1]
    finally:
        running.kill()


def test_same_bytes_as_in_one_process(
    cluster: str, tmp_path: Path, whole: dict[str, bytes]
) -> None:
    # A relative folder: the worker's working directory is another one.
    arguments = ["run", "cctc", "--traces", "--dask", cluster, "--out", "run"]
    done = shell(*arguments, *options_of(CHANGES), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert content(tmp_path / "run") == whole


def test_cells_of_a_sweep_share_the_workers(cluster: str, tmp_path: Path) -> None:
    study = sweep("cctc", {**CHANGES, "experiment.pairs": 20}, "ego.length_m=4,4.5,5")
    run_study(study, Options(workers=1), out=tmp_path / "here")
    run_there(study, Options(), cluster, tmp_path / "there")
    assert content(tmp_path / "there") == content(tmp_path / "here")


@pytest.mark.slow
def test_interrupted_on_the_cluster_resumed_here(
    cluster: str, tmp_path: Path, whole: dict[str, bytes]
) -> None:
    folder = tmp_path / "run"
    arguments = ["run", "cctc", "--traces", "--dask", cluster, "--out", folder]
    running = start(*arguments, *options_of(CHANGES))
    errors = until_a_shard(folder, running, lambda: os.kill(running.pid, signal.SIGINT))
    if running.returncode != 0:
        assert running.returncode == 130, errors
        assert "harness resume" in errors
        assert "Traceback" not in errors
        assert shell("resume", folder, "-q").returncode == 0
    assert content(folder) == whole


STRATEGY = """
from pathlib import Path

class Mine:
    def decide(self, observation):
        return {expression}
"""


def own(cluster: str | None, name: str, folder: Path, out: str) -> dict[str, bytes]:
    """A run of a user's own strategy from its folder, here or on the cluster."""
    changes = {**QUICK, "arms.av": name, "experiment.pairs": 20}
    where = [] if cluster is None else ["--dask", cluster]
    command = ("run", "cctc", "-q", "--out", out, *where, *options_of(changes))
    printed(*command, cwd=folder)
    return content(folder / out)


def test_a_strategy_in_a_module_is_uploaded(cluster: str, tmp_path: Path) -> None:
    # The workers run in other folders.
    (tmp_path / "mine_dask.py").write_text(STRATEGY.format(expression=-0.5))
    there = own(cluster, "mine_dask:Mine", tmp_path, "there")
    assert there == own(None, "mine_dask:Mine", tmp_path, "here")


@pytest.mark.slow
def test_a_strategy_in_a_package_with_data_is_uploaded_as_it_is_now(
    cluster: str, tmp_path: Path
) -> None:
    inner = tmp_path / "mypackage" / "inner"
    inner.mkdir(parents=True)
    for folder in (inner, inner.parent):
        (folder / "__init__.py").touch()
    source = 'float(-float(Path(__file__).with_name("brake.txt").read_text()))'
    (inner / "mine.py").write_text(STRATEGY.format(expression=source))
    tables = []
    for brake in (2.0, 0.5):
        (inner / "brake.txt").write_text(str(brake))
        out = own(cluster, "mypackage.inner.mine:Mine", tmp_path, f"there-{brake}")
        tables.append(out["episodes.parquet"])
    assert tables[0] != tables[1]
    assert out == own(None, "mypackage.inner.mine:Mine", tmp_path, "here")


@pytest.mark.slow
def test_a_task_that_dies_costs_the_cluster_no_worker(cluster: str, tmp_path: Path) -> None:
    def workers() -> dict[str, int]:
        with Client(cluster, set_as_default=False) as client:
            return dict(client.run(os.getpid))

    before = workers()
    changes = {**QUICK, "arms.av": NAME, "experiment.pairs": 6, **struck({"aborts": 2})}
    study = one_cell("cctc", changes)
    options = Options(task_pairs=3, workers=1)
    run_study(study, options, out=tmp_path / "here")
    finished = run_there(study, options, cluster, tmp_path / "there")
    assert [(pair, arm) for _, pair, arm, _ in finished.failures] == [(2, "av"), (2, "human")]
    assert all("died (exit code -6)" in why for *_, why in finished.failures)
    assert content(tmp_path / "there") == content(tmp_path / "here")
    assert workers() == before


def test_workers_with_several_threads_are_refused(
    launch: Launch, tmp_path_factory: pytest.TempPathFactory, tmp_path: Path
) -> None:
    _, address = scheduler(launch, tmp_path_factory.mktemp("threads"))
    with pytest.raises(InputError, match="no workers"):
        DaskCluster(address)
    worker(launch, address, threads=2)
    line = refusal("run", "cctc", "--dask", address, "--out", tmp_path / "run", "--pairs", "2")
    assert all(word in line for word in ("threads", "2", "--nthreads 1"))


@pytest.mark.parametrize(
    "address",
    [
        pytest.param("tcp://127.0.0.1:{port}", marks=pytest.mark.slow),  # ten seconds are waited
        "nonsense://x:{port}",
        "127.0.0.1",
    ],
)
def test_nobody_there(tmp_path: Path, address: str) -> None:
    with socket.socket() as free:
        # Bound but not listening: whoever calls is turned away.
        free.bind(("127.0.0.1", 0))
        given = address.format(port=free.getsockname()[1])
        line = refusal("run", "cctc", "--dask", given, "--out", tmp_path / "run", "--pairs", "2")
    assert f"--dask {given}" in line


@pytest.mark.slow
def test_a_cluster_that_goes_away(
    launch: Launch, tmp_path_factory: pytest.TempPathFactory, tmp_path: Path
) -> None:
    """What is finished is kept; the pairs are not blamed for the cluster's end."""
    process, address = scheduler(launch, tmp_path_factory.mktemp("gone"))
    worker(launch, address)
    folder = tmp_path / "run"
    changes = {**CHANGES, "experiment.pairs": 4000}
    running = start("run", "cctc", "--dask", address, "--out", folder, *options_of(changes))
    errors = until_a_shard(folder, running, process.kill)
    assert running.returncode == 1
    assert "Traceback" not in errors
    assert "harness resume" in errors
    log = (folder / "log.jsonl").read_text(encoding="utf-8")
    assert "pair given up" not in log
