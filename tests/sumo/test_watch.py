"""An episode in sumo-gui, under a virtual display: the same record, and pictures of it."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.core.vocabulary import Arm
from harness.results.loaded_run import Run
from harness.studies.running.replay import watch
from harness.studies.running.run import run
from tests.batches import HARNESS
from tests.scenes import refuses

needs_xvfb = pytest.mark.skipif(
    shutil.which("xvfb-run") is None, reason="needs a virtual display: Debian's package xvfb"
)

EGO_AT_V0 = (69, 117, 180)
PEDESTRIAN = (197, 27, 125)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Run:
    settings = {"experiment.timeout_s": 60.0, "pedestrians.flow_per_hour": 1500.0}
    out = tmp_path_factory.mktemp("watch") / "run"
    return run("cctc_flow", settings=settings, pairs=4, out=out, workers=0)


def pixels(path: Path, colour: tuple[int, int, int]) -> int:
    """How many pixels of a picture have about that colour."""
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    return int((np.abs(picture - colour).max(axis=2) < 40).sum())


def watched(*words: object) -> str:
    """What a command prints that shows sumo-gui, under a virtual display."""
    display = ["xvfb-run", "-a", "-s", "-screen 0 1280x900x24"]
    command = [*display, *HARNESS, *map(str, words), "--gui"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180)
    assert done.returncode == 0, done.stderr
    return done.stdout


@needs_xvfb
def test_the_record_is_the_stored_one_and_pictures_show_ego_and_people(
    stored: Run, tmp_path: Path
) -> None:
    shots = tmp_path / "shots"
    text = watched("replay", stored.path, "--pair", "2", "--screenshots", shots)
    assert text.count("is the stored one") == 2
    for arm in ("av", "human"):
        pictures = sorted((shots / f"2-{arm}").glob("*.png"))
        assert len(pictures) >= 5
        assert pictures[0].name == "t-000.100-s.png"
        # A car of 5 x 1.8 m at 16 pixels a metre has about 2,300; a fifth of it is its windows.
        assert pixels(pictures[0], EGO_AT_V0) > 300
        assert max(pixels(picture, PEDESTRIAN) for picture in pictures) > 30


def test_without_a_display_it_says_so(stored: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    refuses("Xvfb", lambda: watch(stored, 0, range(1), [Arm.AV]))
