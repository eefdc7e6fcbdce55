"""Whenever something is broken off, ``harness resume`` gives the bytes of what never was.

It is broken off between any two tasks; by signals when any file is about to be finished, which a
``sitecustomize`` that only the command sees sends; and by killing the command or a child of it at
a moment drawn at random.
"""

import json
import os
import random
import re
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from harness.results.folder import done_parts
from harness.studies.running import workers
from tests.batches import (
    CHECKOUT,
    QUICK,
    content,
    here,
    options_of,
    printed,
    refusal,
    start,
    wait_for,
)
from tests.recordings import made_up
from tests.sumo.test_simulation_runs import hour

RUN = ["run", "cctc", "--pairs", 25, "--traces", *options_of(QUICK)]
LONGER = ["--pairs", 400, "--set", "experiment.decide_limit_s=100"]
COMMANDS: dict[str, list[object]] = {
    "run": RUN,
    "sweep": ["sweep", *RUN[1:], "--vary", "ego.length_m=4,5"],
    "simulation": ["run", "hour.toml", "--pairs", 3],
    "risk": ["risk", "cctc", "--set", "arms.av=constant_speed", "--target-cv", 0.3],
    "longer": [*RUN, *LONGER],
}

INT, TERM, KILL = signal.SIGINT, signal.SIGTERM, signal.SIGKILL


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], dict[str, bytes]]:
    """What an uninterrupted command writes, by its name; each is carried out once."""
    folder, found = tmp_path_factory.mktemp("whole"), dict[str, dict[str, bytes]]()
    hour(folder)

    def files(name: str) -> dict[str, bytes]:
        if name not in found:
            printed(*COMMANDS[name], "--out", name, "--quiet", cwd=folder)
            found[name] = content(folder / name)
        return found[name]

    return files


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return hour(tmp_path).parent


@pytest.mark.parametrize(
    ("name", "breaks"),
    [
        ("run", [0, 4]),
        ("run", [1]),
        ("sweep", [3, 2]),
        ("simulation", [1, 0]),
        ("simulation", [2]),
        ("risk", [6, 15]),
    ],
)
def test_between_two_tasks(
    folder: Path,
    whole: Callable[[str], dict[str, bytes]],
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    breaks: list[int],
) -> None:
    """Each time it is broken off before the task of a number, counted from where it went on."""
    submit = workers.InProcess.submit
    left = [0]

    def counted(self: workers.InProcess, *arguments: object, **options: object) -> object:
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        return submit(self, *arguments, **options)

    words: list[object] = [*COMMANDS[name], "--out", "out", "--quiet"]
    with monkeypatch.context() as patch:
        patch.setattr(workers.InProcess, "submit", counted)
        for times, left[0] in enumerate(breaks, 1):
            done = here(*words, cwd=folder)
            said = "harness: interrupted; to continue: harness resume out\n"
            assert (done.returncode, done.stdout, done.stderr) == (130, "", said)
            assert len(done_parts(folder / "out")) == sum(breaks[:times])
            words = ["resume", "out", "--quiet"]
    refused = "no pair is finished yet|is not finished"
    if breaks == [0, 4] or name == "risk":
        assert re.search(
            refused, refusal("compare" if name == "run" else "show", "out", cwd=folder)
        )
    printed("resume", "out", "--quiet", cwd=folder)
    assert content(folder / "out") == whole(name)


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
EXTRACT = ["extract", CHECKOUT / "tests" / "data" / "vci_made_up", "--format", "vci"]


def struck(
    folder: Path, command: list[object], strike: str, numbers: tuple[int, ...]
) -> "subprocess.CompletedProcess[str]":
    """A command that is struck by signals; leaves nothing temporary and no half-written file."""
    for name in ("hook", "temporary", "here"):
        (folder / name).mkdir()
    (folder / "hook" / "sitecustomize.py").write_text(HOOK)
    env = {"PYTHONPATH": os.pathsep.join([str(folder / "hook"), str(CHECKOUT)])}
    env |= {"TMPDIR": str(folder / "temporary"), "STRIKE": strike}
    env |= {"STRIKE_WITH": ",".join(map(str, map(int, numbers)))}
    running = start(*command, cwd=folder / "here", env=env)
    try:
        output, errors = running.communicate(timeout=120)
    finally:
        running.kill()
    assert [*(folder / "temporary").iterdir()] == []
    assert not [path.name for path in (folder / "here").rglob(".*") if path.name != ".lock"]
    assert (running.returncode, output) == (128 + numbers[0], ""), errors
    return subprocess.CompletedProcess([], running.returncode, output, errors)


ANY_FILE = [
    pytest.param(name, f"file:{file}", (number,), marks=pytest.mark.slow)
    for name in ("run", "sweep")
    for file in range(1, 13)
    for number in (INT, TERM)
]


@pytest.mark.parametrize(
    ("name", "strike", "numbers"),
    [
        ("run", "import:numpy", (TERM,)),
        ("extract", "file:1", (INT,)),
        ("run", "file:2", (TERM,)),
        # Later signals do not cut the clearing up short.
        ("run", "file:3", (INT, TERM, INT)),
        *ANY_FILE,
    ],
)
def test_by_signals(
    tmp_path: Path,
    whole: Callable[[str], dict[str, bytes]],
    name: str,
    strike: str,
    numbers: tuple[int, ...],
) -> None:
    """From the manifest, the first file of a run, over parts towards the findings."""
    out = tmp_path / "here" / "out"
    command: list[object] = [*COMMANDS.get(name, EXTRACT), "--quiet", "--out", "out"]
    if name == "extract":
        command[-1] = "out.parquet"
    else:
        command += ["--workers", 1]
    done = struck(tmp_path, command, strike, numbers)
    if not out.exists() or strike == "file:1":
        assert done.stderr == "harness: interrupted\n"
        assert not [path for path in (tmp_path / "here").rglob("*.parquet") if path.is_file()]
    else:
        assert done.stderr == "harness: interrupted; to continue: harness resume out\n"
        printed("resume", out, "-q")
        assert content(out) == whole(name)


OFTEN = [
    pytest.param(name, seed, marks=pytest.mark.slow)
    for name in ("longer", "simulation", "risk")
    for seed in range(10, 20)
]


@pytest.mark.parametrize(("name", "seed"), [("longer", 1), ("simulation", 0), ("risk", 3), *OFTEN])
def test_by_killing_any_process_at_any_moment(
    folder: Path, whole: Callable[[str], dict[str, bytes]], name: str, seed: int
) -> None:
    dice, out = random.Random(seed), folder / "out"
    running = start(*COMMANDS[name], "--workers", 2, "--quiet", "--out", "out", cwd=folder)
    command = psutil.Process(running.pid)
    wait_for(lambda: running.poll() is not None or command.children(), "a child", 60)
    time.sleep(dice.uniform(0.0, 3.0))
    children = command.children(recursive=True) if running.poll() is None else []
    victim, number = dice.choice([running.pid, *(child.pid for child in children)]), KILL
    if victim == running.pid:
        number = dice.choice([KILL, INT])
    if running.poll() is None:
        os.kill(victim, number)
    running.communicate(timeout=120)
    _, alive = psutil.wait_procs(children, timeout=20)
    assert alive == []
    if not (out / "manifest.json").is_file():
        printed(*COMMANDS[name], "--quiet", "--out", "out", cwd=folder)
    parts = {path: path.stat().st_mtime_ns for path in out.glob("episodes/*.parquet")}
    printed("resume", "out", "--quiet", cwd=folder)
    assert parts.items() <= {path: path.stat().st_mtime_ns for path in parts}.items()
    assert not [*out.rglob("*.partial")]
    events = [json.loads(line)["event"] for line in (out / "log.jsonl").open(encoding="utf-8")]
    assert "episode given up" not in events
    assert ("tried again" in events) <= (victim != running.pid)
    assert content(out) == whole(name)


def test_ctrl_c_ends_a_fit_and_its_workers(tmp_path: Path) -> None:
    made_up().to_csv(tmp_path / "made_up.csv")
    rows, out = tmp_path / "rows.parquet", tmp_path / "model.json"
    printed("extract", tmp_path / "made_up.csv", "--format", "table", "--out", rows)
    # Enough to do for longer than anybody waits.
    fit = ("fit", rows, "--components", "1..5", "--choose", "bic", "--starts", 10_000)
    running = start(*fit, "--out", out, "--workers", 2, "--quiet")
    try:
        command = psutil.Process(running.pid)
        wait_for(lambda: len(command.children(recursive=True)) >= 2, "two workers", 60)
        children = command.children(recursive=True)
        os.killpg(running.pid, INT)
        _, errors = running.communicate(timeout=60)
    finally:
        running.kill()
    assert (running.returncode, errors) == (130, "harness: interrupted\n")
    _, alive = psutil.wait_procs(children, timeout=10)
    assert alive == []
    assert not out.exists()
