"""Ctrl-C and SIGTERM at chosen moments, in every command that writes.

The moment is not a matter of time: a ``sitecustomize`` that only the command itself sees sends the
signal when a module is imported, or when the n-th file is about to be finished.
"""

import os
import signal
import subprocess
from pathlib import Path

import psutil
import pytest

from tests.batches import (
    CHECKOUT,
    QUICK,
    content,
    here,
    options_of,
    printed,
    shell,
    start,
    wait_for,
)
from tests.unit.test_cli_model import made_up

HOOK = """
import os, signal, sys

what, _, where = os.environ.pop("STRIKE", "").partition(":")
numbers = [int(number) for number in os.environ.pop("STRIKE_WITH", "2").split(",")]

def strike():
    for number in numbers:
        signal.raise_signal(number)

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == where:
            strike()

if what == "import":
    sys.meta_path.insert(0, Finder())
if what == "file":
    sync, left = os.fsync, int(where)
    def fsync(file):
        global left
        left -= 1
        if left == 0:
            strike()
        sync(file)
    os.fsync = fsync
"""

MADE_UP = CHECKOUT / "tests" / "data"
RUN = ["run", "cctc", "--pairs", 6, "--workers", 1, "--traces", "-q", "--out", "out"]
RUN += options_of(QUICK)
SWEEP = ["sweep", *RUN[1:], "--vary", "ego.length_m=4,5"]
COMMANDS: dict[str, list[object]] = {
    "report": ["report", "RUN", "--figures", "out"],
    "extract": ["extract", MADE_UP / "vci_made_up", "--format", "vci", "--out", "out.parquet"],
    "model": ["model", "dut", "--figures", "out"],
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An uninterrupted run and sweep."""
    folder = tmp_path_factory.mktemp("whole")
    for name, command in (("run", RUN), ("sweep", SWEEP)):
        printed(*[folder / name if word == "out" else word for word in command])
    return folder


def struck(
    tmp_path: Path, command: list[object], strike: str, *numbers: signal.Signals
) -> "subprocess.CompletedProcess[str]":
    """A command that is struck by signals; leaves nothing temporary and no half-written file."""
    for name in ("hook", "temporary", "here"):
        (tmp_path / name).mkdir(exist_ok=True)
    (tmp_path / "hook" / "sitecustomize.py").write_text(HOOK)
    running = start(
        *command,
        cwd=tmp_path / "here",
        env={
            "PYTHONPATH": os.pathsep.join([str(tmp_path / "hook"), str(CHECKOUT)]),
            "TMPDIR": str(tmp_path / "temporary"),
            "STRIKE": strike,
            "STRIKE_WITH": ",".join(str(int(number)) for number in numbers),
        },
    )
    try:
        output, errors = running.communicate(timeout=120)
    finally:
        running.kill()
    assert [*(tmp_path / "temporary").iterdir()] == []
    assert not [path.name for path in (tmp_path / "here").rglob(".*") if path.name != ".lock"]
    assert (running.returncode, output) == (128 + numbers[0], ""), errors
    return subprocess.CompletedProcess([], running.returncode, output, errors)


INT, TERM = signal.SIGINT, signal.SIGTERM


@pytest.mark.parametrize(
    ("module", "number"),
    [("typer", INT), ("numpy", TERM), ("pyarrow", INT), ("rich.progress", TERM)],
)
def test_while_a_command_imports(tmp_path: Path, module: str, number: signal.Signals) -> None:
    done = struck(tmp_path, RUN, f"import:{module}", number)
    assert done.stderr == "harness: interrupted\n"
    assert [*(tmp_path / "here").iterdir()] == []


ANY_FILE = [
    pytest.param(name, file, number, marks=pytest.mark.slow)
    for name in ("run", "sweep")
    for file in range(1, 13)
    for number in (INT, TERM)
]


@pytest.mark.parametrize(("name", "file", "number"), [("run", 2, INT), *ANY_FILE])
def test_while_a_run_writes_any_file(
    tmp_path: Path, whole: Path, name: str, file: int, number: signal.Signals
) -> None:
    """From the manifest over parts towards the findings."""
    command = RUN if name == "run" else SWEEP
    done = struck(tmp_path, command, f"file:{file}", number)
    out = tmp_path / "here" / "out"
    if file == 1:
        assert done.stderr == "harness: interrupted\n"
        again = shell(*command, cwd=tmp_path / "here", env={"PYTHONPATH": str(CHECKOUT)})
    else:
        assert done.stderr == "harness: interrupted; to continue: harness resume out\n"
        again = here("resume", out, "-q")
    assert again.returncode == 0, again.stderr
    assert content(out) == content(whole / name)


# All files are written by one function: `export` is the command of every day.
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name == "extract" else pytest.mark.slow) for name in COMMANDS],
)
def test_while_another_command_writes_a_file(tmp_path: Path, whole: Path, name: str) -> None:
    command = [whole / "run" if word == "RUN" else word for word in COMMANDS[name]]
    before = content(whole / "run")
    done = struck(tmp_path, command, "file:1", signal.SIGINT)
    assert done.stderr == "harness: interrupted\n"
    assert content(whole / "run") == before
    assert not [path for path in (tmp_path / "here").rglob("*") if path.is_file()]


def test_a_second_signal_does_not_cut_the_clearing_up_short(tmp_path: Path, whole: Path) -> None:
    done = struck(tmp_path, RUN, "file:3", signal.SIGINT, signal.SIGTERM, signal.SIGINT)
    assert done.stderr == "harness: interrupted; to continue: harness resume out\n"
    out = tmp_path / "here" / "out"
    printed("resume", out, "-q")
    assert content(out) == content(whole / "run")


def test_ctrl_c_ends_a_fit_and_its_workers(tmp_path: Path) -> None:
    made_up().to_csv(tmp_path / "made_up.csv")
    rows = tmp_path / "rows.parquet"
    printed("extract", tmp_path / "made_up.csv", "--format", "table", "--out", rows)
    out = tmp_path / "model.json"
    # Enough to do for longer than anybody waits.
    fit = ("fit", rows, "--components", "1..5", "--choose", "bic", "--starts", 10_000)
    running = start(*fit, "--out", out, "--workers", 2, "--quiet")
    try:
        command = psutil.Process(running.pid)
        wait_for(lambda: len(command.children(recursive=True)) >= 2, "two workers", 60)
        workers = command.children(recursive=True)
        os.killpg(running.pid, signal.SIGINT)
        _, errors = running.communicate(timeout=60)
    finally:
        running.kill()
    assert (running.returncode, errors) == (130, "harness: interrupted\n")
    _, alive = psutil.wait_procs(workers, timeout=10)
    assert alive == []
    assert not out.exists()
