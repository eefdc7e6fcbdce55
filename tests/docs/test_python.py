"""The Python in the docs runs as it is written, page by page."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.conftest import ROOT


def script_of(page: Path) -> str:
    """The page's Python blocks, one after the other."""
    text = page.read_text(encoding="utf-8")
    return "\n".join(re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL))


PAGES = [page for page in sorted((ROOT / "docs").glob("*.md")) if script_of(page)]


def test_pages_have_python() -> None:
    assert {page.stem for page in PAGES} >= {"python", "report", "strategies"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_python_of_a_page_runs(page: Path, made: Path, tmp_path: Path) -> None:
    shutil.copytree(made, tmp_path / "checkout")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    done = subprocess.run(
        [sys.executable, "-c", script_of(page)],
        cwd=tmp_path / "checkout",
        capture_output=True,
        text=True,
        timeout=300,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
