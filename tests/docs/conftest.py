"""One run for all pages, and the command line in this process: no command starts Python again."""

import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from harness.batch import experiment
from harness.calibration import jobs
from harness.cli import app as cli
from harness.engine.shared import close_engine
from harness.replay import rerun, sumo_outputs
from harness.report import episode_traces
from harness.workers import pool
from tests.batches import Inline

ROOT = Path(__file__).resolve().parents[2]

Harness = Callable[..., int]


def call(*words: object) -> int:
    """Run ``harness`` in this process; returns its exit code."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["harness", *map(str, words)])
        for module in (pool, experiment, jobs, rerun, sumo_outputs, episode_traces):
            # tests/sumo holds the workers.
            patch.setattr(module, "LocalPool", lambda workers, *_, **__: Inline(workers))
        with pytest.raises(SystemExit) as end:
            cli.main()
    close_engine()
    assert isinstance(end.value.code, int)
    return end.value.code


@pytest.fixture
def harness(no_simulation: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[Harness]:  # noqa: ARG001
    """Runs ``harness`` in this process, wherever that is."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    path = list(sys.path)
    yield call
    sys.path[:] = path


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as ``make run`` leaves it, with the checkout's examples and scenarios beside.

    18 pairs: the pages replay pair 17.
    """
    from tests.conftest import _close_all

    _close_all()
    folder = tmp_path_factory.mktemp("made")
    here = Path.cwd()
    os.chdir(folder)
    try:
        assert call("run", "cctc", "--pairs", 18, "--quiet", "--traces") == 0
    finally:
        os.chdir(here)
    for name in ("examples", "scenarios"):
        shutil.copytree(ROOT / name, folder / name)
    (folder / "harness" / "models").mkdir(parents=True)
    return folder
