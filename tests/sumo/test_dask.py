"""The same tasks on a Dask cluster on the loopback interface."""

import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from harness.results.loaded_run import load_run
from harness.studies.running.run import resume, run
from harness.studies.running.workers import dask_executor
from tests.batches import QUICK, here, options_of, shell, start
from tests.faulty import NAME, struck
from tests.sumo.test_runs import same_rows

distributed = pytest.importorskip("distributed", reason="the extra `cluster` is missing")


CLUSTER = """
import distributed
if __name__ == "__main__":
    options = dict(n_workers=1, threads_per_worker=2, dashboard_address="127.0.0.1:0")
    with distributed.LocalCluster(host="127.0.0.1", **options) as cluster:
        print(cluster.scheduler_address, flush=True)
        input()
"""
"""A scheduler and a worker with two threads, until standard input ends."""


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Any]]:
    """A cluster in another folder: its address and its process."""
    folder = tmp_path_factory.mktemp("cluster")
    (folder / "cluster.py").write_text(CLUSTER)
    process = subprocess.Popen(
        [sys.executable, "cluster.py"],
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    yield process.stdout.readline().strip(), process
    process.communicate("\n", timeout=60)


WORDS = options_of(QUICK)


def test_rows_are_those_of_one_process_and_faults_cost_the_cluster_no_worker(
    started: tuple[str, Any], tmp_path: Path
) -> None:
    settings = {**QUICK, **struck({"segfaults": 2, "nan": 7})}
    del settings["arms.av"]
    options: dict[str, Any] = {
        **{"settings": settings, "pairs": 25, "traces": True},
        "vary": {"arms.av": [NAME, "constant_speed"]},
    }
    with distributed.Client(started[0], set_as_default=False) as client:
        before = client.run(os.getpid)
        with dask_executor(started[0], []) as executor:
            there = run("cctc", executor=executor, out=tmp_path / "there", **options)
        assert client.run(os.getpid) == before
    same_rows(there, run("cctc", workers=1, out=tmp_path / "here", **options))
    assert [failure[:3] for failure in there.failures] == [(0, 2, "av"), (0, 7, "av")]


STRATEGY = """
class Mine:
    def decide(self, observation):
        return {command}
"""


def test_a_strategy_in_a_module_is_uploaded_as_it_is_now(
    started: tuple[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The workers run in another folder.
    monkeypatch.chdir(tmp_path)
    own = ("--set", "arms.av=mine_on_dask:Mine", "--pairs", 5, "--quiet")
    found = []
    for command in (-0.5, -1.5):
        Path("mine_on_dask.py").write_text(STRATEGY.format(command=command))
        done = shell("run", "cctc", *WORDS, *own, "--dask", started[0], "--out", f"{command}")
        assert done.returncode == 0, done.stderr
        found.append(load_run(Path(f"{command}")))
    assert here("run", "cctc", *WORDS, *own, "--out", "here").returncode == 0
    same_rows(found[1], load_run(Path("here")))
    assert not found[0].rows("episodes", 0).equals(found[1].rows("episodes", 0))


@pytest.mark.parametrize("address", [
    pytest.param("tcp://127.0.0.1:{port}", marks=pytest.mark.slow),  # ten seconds are waited
    "nonsense://x:{port}",
])  # fmt: skip
def test_nobody_there(tmp_path: Path, address: str) -> None:
    with socket.socket() as free:
        # Bound but not listening: whoever calls is turned away.
        free.bind(("127.0.0.1", 0))
        given = address.format(port=free.getsockname()[1])
        done = shell("run", "cctc", "--dask", given, "--pairs", 2, "--out", tmp_path / "run")
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(rf"harness: --dask {re.escape(given)}: .*\n", done.stderr)


def test_finished_work_is_kept_if_the_cluster_goes_away(
    started: tuple[str, Any], tmp_path: Path
) -> None:
    """The last test of this file, because it ends the cluster."""
    folder, (address, process) = tmp_path / "run", started
    words = ("--pairs", 300, "-q", *WORDS)
    running = start("run", "cctc", *words, "--dask", address, "--out", folder)
    try:
        while not [*folder.glob("episodes/*.parquet")] and running.poll() is None:
            time.sleep(0.01)
        process.kill()
        errors = running.communicate(timeout=120)[1]
    finally:
        running.kill()
    assert running.returncode == 1, errors
    assert re.fullmatch(r"harness: .*harness resume .*\n", errors)
    assert "given up" not in (folder / "log.jsonl").read_text(encoding="utf-8")
    whole = run("cctc", settings=QUICK, pairs=300, workers=0, out=tmp_path / "whole")
    same_rows(resume(folder, workers=0), whole)
