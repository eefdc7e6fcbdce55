"""Every command in the README and the docs runs as it is written, with fewer pairs.

The commands of a page run one after the other in a folder of their own, which begins with what
``make run`` leaves there.
"""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from harness.model.trajectories.extraction import Extraction, extract, write_rows
from tests.batches import printed
from tests.docs.conftest import ROOT
from tests.recordings import made_up

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
DUT = ROOT.parent / "shared" / "data" / "dut"
MADE_UP = ROOT / "tests" / "data" / "vci_made_up"

SHORTER = {
    "run": ["--pairs", "20", "--workers", "1", "--quiet"],
    "sweep": ["--pairs", "2", "--workers", "1", "--quiet"],
    "fit": ["--components", "1..2", "--starts", "1", "--folds", "2", "--workers", "1"],
    "validate": ["--drivers", "constant_speed"],
    "people": ["--trials", "20", "--hours", "0"],
    "examples.train_policy": ["--generations", "1", "--episodes", "2"],
}
"""Options added to a command, by its second word or its first; the last one given counts."""

TRAJECTORIES = {"../shared/data/dut", "TRAJECTORIES"}
"""Words that stand for trajectories."""

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


LONG_PAGES = {"index", "python", "report", "risk", "simulations"}
"""Pages whose commands take long: `make test-all`."""

LONG = {
    "show": "tests/unit/test_cli_model.py",
    "--figures": "tests/report",
    "risk": "tests/sumo/test_risk.py",
    "validate": "tests/unit/test_validation.py",
}
"""Words of commands that `make test` leaves to `make test-all`, and who else tries them."""


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


def run_page(page: Path, trajectories: Path, skipped: set[str]) -> None:
    """Run a page's commands in the working directory, with the scenario files that it shows."""
    text = page.read_text("utf-8")
    for name, shown in re.findall(r"(?ms)^```toml\n# (\w+\.toml)\n(.*?)^```$", text):
        Path(name).write_text(shown, "utf-8")
    for command in commands(page):
        words = shlex.split(command, comments=True)
        if left_out(words) or skipped & {*words}:
            continue
        words = [str(trajectories) if word in TRAJECTORIES else word for word in words]
        if words[0] == "harness":
            shorter = next((SHORTER[word] for word in words[2:0:-1] if word in SHORTER), [])
            printed(*words[1:], *shorter)
        elif words[:2] == ["python", "-m"]:
            run = [sys.executable, *words[1:], *SHORTER.get(words[2], [])]
            subprocess.run(run, check=True, timeout=300, capture_output=True)
        else:
            subprocess.run(words, check=True, timeout=60)
        if words[1] == "extract" and trajectories == MADE_UP:
            # Its single vehicle is too little for a fit.
            rows = Path(words[words.index("--out") + 1])
            made = extract([MADE_UP], "vci")
            write_rows(rows, Extraction(made_up().assign(source="made up"), made.counts), command)


def test_pages_have_commands() -> None:
    assert len(commands(ROOT / "README.md")) > 8


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=pytest.mark.slow if page.stem in LONG_PAGES else [], id=page.stem)
        for page in PAGES
        if commands(page)
    ],
)
def test_the_commands_of_a_page_run(page, made, tmp_path, monkeypatch) -> None:
    shutil.copytree(made, tmp_path / "checkout")
    monkeypatch.chdir(tmp_path / "checkout")
    # The page of a command uses what it made.
    run_page(page, MADE_UP, set(LONG) - {page.stem})


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", ["README.md", "docs/model.md", "docs/report.md", "docs/risk.md", "docs/validation.md"]
)
def test_the_commands_of_a_page_run_on_real_trajectories(page, made, tmp_path, monkeypatch) -> None:
    if not DUT.is_dir():
        pytest.skip("needs the DUT set in ../shared/data/dut")
    shutil.copytree(made, tmp_path / "checkout")
    monkeypatch.chdir(tmp_path / "checkout")
    run_page(ROOT / page, DUT, set())
