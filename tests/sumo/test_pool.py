"""The local pool: which death is whose fault, and what a worker does not do."""

import os
import signal
import subprocess
import sys
from multiprocessing.connection import Pipe
from pathlib import Path

import pytest

from harness.old.studies.workers import pool as pools
from harness.old.studies.workers.executor import ExecutorLostError, TaskFailedError, WorkerDiedError
from harness.old.studies.workers.pool import LocalPool
from tests.batches import wait_for


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
    monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.setattr(pools, "_START", "raise SystemExit(3)")
    pool = LocalPool(1)
    request.addfinalizer(pool.stop)
    with pytest.raises(ExecutorLostError, match="exit code 3"):
        pool.submit(abs, -1).result()


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
