"""The Python in the docs runs as it is written, page by page."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def script_of(page: Path) -> str:
    """The page's Python blocks, one after the other."""
    text = page.read_text(encoding="utf-8")
    return "\n".join(re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL))


PAGES = [page for page in sorted((ROOT / "docs").glob("*.md")) if script_of(page)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where ``harness run cctc`` has been called once, with fewer pairs."""
    folder = tmp_path_factory.mktemp("python")
    command = [sys.executable, "-m", "harness", "run", "cctc", "--pairs", "5", "--quiet"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=300)
    return folder


def test_pages_have_python() -> None:
    assert {page.stem for page in PAGES} >= {"python", "report", "rl", "strategies"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_python_of_a_page_runs(page: Path, folder: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    done = subprocess.run(
        [sys.executable, "-c", script_of(page)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
