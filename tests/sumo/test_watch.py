"""An episode in sumo-gui, under a virtual display: the same record."""

import shutil
import subprocess

import pytest

from harness.core.vocabulary import Arm
from harness.results.loaded_run import Run
from harness.studies.running.replay import watch
from harness.studies.running.run import run
from tests.batches import HARNESS
from tests.scenes import refuses


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Run:
    settings = {"experiment.timeout_s": 60.0, "pedestrians.flow_per_hour": 1500.0}
    out = tmp_path_factory.mktemp("watch") / "run"
    return run("cctc_flow", settings=settings, pairs=4, out=out, workers=0)


@pytest.mark.skipif(not shutil.which("xvfb-run"), reason="needs Debian's package xvfb")
def test_the_record_is_the_stored_one(stored: Run) -> None:
    display = ["xvfb-run", "-a", "-s", "-screen 0 1280x900x24"]
    command = [*display, *HARNESS, "replay", str(stored.path), "--pair", "2", "--gui"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("is the stored one") == 2


def test_without_a_display_it_says_so(stored: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    refuses("Xvfb", lambda: watch(stored, 0, range(1), [Arm.AV]))
