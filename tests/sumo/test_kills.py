"""Runs that are killed and resumed end as those that were not.

Real signals to real processes, which are all started here and known by their ids.
"""

import os
import random
import signal
import time
from pathlib import Path
from typing import Any

import psutil
import pytest

from harness.old.store.reading import read_manifest
from tests.batches import (
    QUICK,
    content,
    one_cell,
    options_of,
    run_inline,
    shell,
    start,
    wait_for,
    workers_of,
)

CHANGES = {**QUICK, "pedestrians.flow_per_hour": 1000.0, "experiment.pairs": 400}
"""Long enough to be hit: a second or two of simulation, in tasks of 50 pairs."""

COMMAND = ["run", "cctc", "--workers", "2", "--quiet", *options_of(CHANGES)]

SECONDS = 120.0


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The uninterrupted run, in this process and without workers."""
    folder = tmp_path_factory.mktemp("kills") / "whole"
    return content(run_inline(one_cell("cctc", CHANGES), folder).path)


def alive(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def resumed(folder: Path) -> dict[str, bytes]:
    if not (folder / "manifest.json").exists():
        # Killed before it had begun: there is nothing to resume.
        done = shell(*COMMAND, "--out", folder)
    else:
        done = shell("resume", folder, "--workers", "2", "--quiet")
    assert done.returncode == 0, done.stderr
    return content(folder)


def kill_a_worker(folder: Path, seed: int, whole: dict[str, bytes]) -> None:
    """SIGKILL to one worker at a random moment, its start included: the run goes on by itself."""
    dice = random.Random(seed)
    running = start(*COMMAND, "--out", folder)
    try:
        wait_for(lambda: workers_of(running.pid), "a worker")
        time.sleep(dice.uniform(0.0, 3.0))
        victims = workers_of(running.pid)
        if victims:
            os.kill(dice.choice(victims).pid, signal.SIGKILL)
        _, errors = running.communicate(timeout=SECONDS)
    finally:
        running.kill()
    assert running.returncode == 0, errors
    assert content(folder) == whole


def kill_the_parent(folder: Path, seed: int, whole: dict[str, bytes]) -> None:
    """SIGKILL to the command itself; its workers end by themselves."""
    dice = random.Random(seed)
    running = start(*COMMAND, "--out", folder)
    try:
        wait_for(lambda: folder.exists() or running.poll() is not None, "the run folder")
        time.sleep(dice.uniform(0.0, 4.0))
        workers = workers_of(running.pid)
    finally:
        running.kill()
    running.communicate()
    wait_for(lambda: not any(alive(worker) for worker in workers), "the workers' end", 10.0)
    assert resumed(folder) == whole


OFTEN = [
    pytest.param(kill, seed, marks=pytest.mark.slow)
    for kill in (kill_a_worker, kill_the_parent)
    for seed in (0, *range(100, 120))
]


# Seed 3 kills a second after the folder is there.  test_pool.py kills a worker every day.
@pytest.mark.parametrize(("kill", "seed"), [(kill_the_parent, 3), *OFTEN])
def test_killed(tmp_path: Path, whole: dict[str, bytes], kill: Any, seed: int) -> None:
    kill(tmp_path / "run", seed, whole)


@pytest.mark.parametrize(
    ("number", "to_group", "after_shards"),
    [
        pytest.param(signal.SIGINT, True, 0, id="Ctrl-C at the start"),
        pytest.param(signal.SIGINT, False, 2, id="SIGINT", marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, False, 2, id="SIGTERM", marks=pytest.mark.slow),
    ],
)
def test_interrupted_and_resumed(
    tmp_path: Path, whole: dict[str, bytes], number: int, to_group: bool, after_shards: int
) -> None:
    folder = tmp_path / "run"
    running = start(*COMMAND, "--out", folder)
    try:
        wait_for(lambda: len(workers_of(running.pid)) == 2, "both workers")
        workers = workers_of(running.pid)
        # From here on without delay, or a run on a busy machine is finished before the signal.
        wait_for(lambda: len([*folder.glob("shards/*.arrows")]) >= after_shards, "finished work")
        # A terminal sends it to every process of the group.
        (os.killpg if to_group else os.kill)(running.pid, number)
        output, errors = running.communicate(timeout=SECONDS)
    finally:
        running.kill()
    assert running.returncode == 128 + number, errors
    assert (output, errors.count("\n")) == ("", 1)
    if not (folder / "manifest.json").exists():
        # Interrupted while it still started: nothing has begun.
        assert after_shards == 0
        assert "interrupted" in errors
    else:
        assert f"harness resume {folder}" in errors
        assert read_manifest(folder)["counts"] is None
    wait_for(lambda: not any(alive(worker) for worker in workers), "the workers' end", 5.0)
    assert len([*folder.glob("shards/*.arrows")]) >= after_shards
    assert resumed(folder) == whole
