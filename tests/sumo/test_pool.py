"""The local pool: which death is whose fault, and what a worker does not do."""

import os
import signal
import subprocess
import sys
import time
from multiprocessing.connection import Pipe
from pathlib import Path
from typing import Any

import pytest

from harness.core.errors import HarnessError
from harness.old.studies.batch.experiment import run_study
from harness.old.studies.workers import pool as pools
from harness.old.studies.workers.executor import ExecutorLostError, TaskFailedError, WorkerDiedError
from harness.old.studies.workers.executors import executor_for
from harness.old.studies.workers.pool import LocalPool
from harness.scenario import Options
from tests.batches import CHECKOUT, QUICK, one_cell, wait_for


def test_a_death_costs_its_own_call_alone_and_between_two_calls_none(
    request: pytest.FixtureRequest,
) -> None:
    pool = LocalPool(1)
    request.addfinalizer(pool.stop)
    assert pool.submit(abs, -3).result() == 3
    died, after = pool.submit(os._exit, 7), pool.submit(abs, -4)
    with pytest.raises(WorkerDiedError, match="exit code 7"):
        died.result()
    assert after.result() == 4
    with pytest.raises(TaskFailedError, match="TypeError"):
        pool.submit(abs, "text").result()
    assert pool.submit(abs, -1).result() == 1
    (process,) = pool._alive
    os.kill(process.pid, signal.SIGKILL)
    wait_for(lambda: process.poll() is not None, "its end", 60.0)
    assert pool.submit(abs, -2).result() == 2


def test_what_a_worker_started_dies_with_it(request: pytest.FixtureRequest) -> None:
    pool = LocalPool(1)
    request.addfinalizer(pool.stop)
    for end in (lambda: pool.submit(os._exit, 7).exception(), pool.stop):
        # The shell ends at once; what it started goes on.
        words = "sleep 300 >/dev/null 2>&1 & echo $!"
        started = Path("/proc", pool.submit(subprocess.getoutput, words).result(), "status")
        assert started.exists()
        end()
        wait_for(
            lambda status=started: not status.exists() or "zombie" in status.read_text("utf-8"),
            "the end of what the worker started",
            10.0,
        )


def test_workers_that_never_get_ready_blame_no_pair(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.setattr(pools, "_START", "raise SystemExit(3)")
    pool = LocalPool(1)
    request.addfinalizer(pool.stop)
    with pytest.raises(ExecutorLostError, match="exit code 3"):
        pool.submit(abs, -1).result()
    study = one_cell("cctc", {**QUICK, "experiment.pairs": 4})
    with pytest.raises(HarnessError, match=r"exit code 3.*harness resume"):
        run_study(study, Options(workers=2, task_pairs=1), out=tmp_path / "run")
    assert "given up" not in (tmp_path / "run" / "log.jsonl").read_text(encoding="utf-8")


@pytest.mark.slow
def test_few_pairs_that_are_slow_get_every_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pools, "LATER_S", 0.2)
    study = one_cell("cctc", {**QUICK, "experiment.pairs": 40})
    pool = executor_for(study, Options(workers=2))
    try:
        # One does for 40 quick pairs; while it is still at work after a while the other helps.
        naps = [pool.submit(time.sleep, 1.0) for _ in range(2)]
        assert pool.workers == 2
        for nap in naps:
            nap.result()
        assert len(pool._alive) == 2
    finally:
        pool.stop()
    monkeypatch.setattr(pools, "LATER_S", 60.0)
    pool = executor_for(study, Options(workers=2))
    pool.submit(time.sleep, 0.0).result()
    assert len(pool._alive) == 1
    begin = time.monotonic()
    pool.stop()
    assert time.monotonic() - begin < 30


@pytest.mark.parametrize("gone", ["pipe", "standard input", "both"])
def test_a_worker_that_loses_its_parent_while_it_starts_is_silent(gone: str) -> None:
    ours, theirs = Pipe()
    worker = subprocess.Popen(
        [sys.executable, "-P", "-c", pools._START, str(theirs.fileno()), "math", *sys.path],
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        pass_fds=[theirs.fileno()],
    )
    theirs.close()
    try:
        assert worker.stdin is not None
        assert worker.stderr is not None
        if gone != "pipe":
            worker.stdin.close()
        if gone != "standard input":
            ours.close()
        assert worker.stderr.read() == b""
        worker.wait(timeout=60)
    finally:
        worker.kill()


SCRIPT = """
from harness.old.studies.batch.experiment import run_study
from harness.scenario.options import Options
from harness.scenario import Setting, read_scenario_file
from harness.scenario.study import study_of

print("main module")
study = study_of(read_scenario_file("cctc", [Setting("experiment.pairs", 2)]))
run_study(study, Options(workers=1))
"""


def test_a_script_needs_no_guard(tmp_path: Path) -> None:
    """multiprocessing's workers would run it again, and begin another run each."""
    (tmp_path / "script.py").write_text(SCRIPT, encoding="utf-8")
    env = {**os.environ, "PYTHONPATH": str(CHECKOUT)}
    command = [sys.executable, "script.py"]
    pipes: Any = {"capture_output": True, "text": True, "timeout": 300}
    done = subprocess.run(command, cwd=tmp_path, env=env, **pipes)
    assert (done.returncode, done.stdout) == (0, "main module\n"), done.stderr
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["cctc-1"]
