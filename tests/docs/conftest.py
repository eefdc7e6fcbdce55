"""One run for all pages."""

import shutil
from pathlib import Path

import pytest

from tests.batches import here

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as ``make run`` leaves it, with the checkout's examples and scenarios beside.

    18 pairs: the pages replay pair 17.
    """
    folder = tmp_path_factory.mktemp("made")
    done = here("run", "cctc", "--pairs", 18, "--quiet", "--traces", cwd=folder)
    assert done.returncode == 0, done.stderr
    for name in ("examples", "scenarios"):
        shutil.copytree(ROOT / name, folder / name)
    (folder / "harness" / "model" / "shipped").mkdir(parents=True)
    return folder
