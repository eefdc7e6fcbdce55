"""Every command in the README and the docs runs as it is written, with fewer pairs.

The commands of a page run one after the other in a folder of their own, which begins with what
``make run`` leaves there.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
DUT = ROOT.parent / "shared" / "data" / "dut"

PAIRS, PAIRS_OF_A_SWEEP = "18", "2"
"""Instead of any other number: the pages replay pair 17 of runs."""

SHORTER = {
    "run": ["--pairs", PAIRS, "--workers", "1", "--quiet"],
    "sweep": ["--pairs", PAIRS_OF_A_SWEEP, "--workers", "2", "--quiet"],
    "fit": ["--components", "1..2", "--starts", "1", "--folds", "2", "--workers", "2"],
    "examples.train_policy": ["--generations", "1", "--episodes", "2"],
}
"""Options added to a command, by its first word; the last one given counts."""

NEEDS_DUT = {"../shared/data/dut", "TRAJECTORIES"}
"""Words that stand for trajectories; where the DUT set is missing, a page is skipped from there."""

STANDS_ALONE = "--resume"
"""Beside it nothing may be changed."""

NOT_HERE = {
    "make": "sets up an environment of its own",
    "source": "changes the shell",
    "pip": "changes the environment",
    "git": "changes the checkout",
    ".venv/bin/pre-commit": "changes the checkout",
    "dask": "serves for ever; tests/sumo/test_dask.py starts a cluster",
    "--dask": "needs that cluster",
    "xvfb-run": "tests/sumo/test_watch.py",
    "--gui": "needs a display; tests/sumo/test_watch.py",
    "--open": "opens a browser",
    "benchmarks": "takes long",
}
"""What is not run, by a word it begins with or holds, and why."""


def commands(page: Path) -> list[str]:
    """The commands of a page's console blocks, without their remarks."""
    blocks = re.findall(
        r"^```console\n(.*?)^```$", page.read_text("utf-8"), re.MULTILINE | re.DOTALL
    )
    lines = [line.strip() for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    return [line for line in lines if line and not line.startswith("#")]


def left_out(words: list[str]) -> bool:
    """Whether a command is one of those that are not run here."""
    module = words[2] if words[:2] == ["python", "-m"] else ""
    return any(words[0] == key or key in words or module.split(".")[0] == key for key in NOT_HERE)


def as_run(words: list[str]) -> list[str]:
    """The command with this interpreter, and shorter."""
    if words[0] == "harness":
        name, begin = words[1], [sys.executable, "-m", "harness"]
    elif words[:2] == ["python", "-m"]:
        name, begin = words[2], [sys.executable, "-m"]
    else:
        return words
    rest = words[1:] if words[0] == "harness" else words[2:]
    return [*begin, *rest, *([] if STANDS_ALONE in words else SHORTER.get(name, []))]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as ``make run`` leaves it, with the checkout's examples and scenarios beside."""
    folder = tmp_path_factory.mktemp("made")
    command = [sys.executable, "-m", "harness", "run", "cctc", *SHORTER["run"], "--traces"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=300)
    for name in ("examples", "scenarios"):
        shutil.copytree(ROOT / name, folder / name)
    (folder / "harness" / "models").mkdir(parents=True)
    return folder


def test_pages_have_commands() -> None:
    assert len(commands(ROOT / "README.md")) > 8


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=lambda p: p.stem)
def test_the_commands_of_a_page_run(page: Path, made: Path, tmp_path: Path) -> None:
    folder = tmp_path / "checkout"
    shutil.copytree(made, folder)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    for command in commands(page):
        words = shlex.split(command, comments=True)
        if left_out(words):
            continue
        if NEEDS_DUT & {*words}:
            if not DUT.is_dir():
                pytest.skip(f"{command}: needs the DUT set in ../shared/data/dut")
            words = [str(DUT) if word in NEEDS_DUT else word for word in words]
        done = subprocess.run(
            as_run(words), cwd=folder, capture_output=True, text=True, timeout=300, env=environment
        )
        assert done.returncode == 0, f"{command}\n{done.stderr[-2000:]}"
