"""Faults of strategies and deaths of processes: one failed episode in one arm, nothing else lost.

Children are fresh processes, where nothing that a test patches is seen: the faulty strategy is a
user's own, found by its module.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import psutil
import pyarrow as pa
import pytest

from harness.results.loaded_run import Run
from harness.studies.evaluate import evaluate
from harness.studies.running import children
from harness.studies.running.run import run
from tests.batches import QUICK
from tests.faulty import NAME, struck

CULPRITS = {
    "raises": (1, "strategy", "the strategy raised RuntimeError: on purpose at t = 0.300 s"),
    "nan": (2, "strategy", "the strategy returned nan at t = 0.300 s"),
    "text": (3, "strategy", "the strategy returned 'fast' at t = 0.300 s"),
    "fallback": (6, "strategy", "its fallback raised LookupError: on purpose"),
    "model_use": (7, "strategy", "its model_use raised LookupError: on purpose"),
    "loses_ego": (4, "engine", "SUMO failed during the episode"),
    "exits": (9, "strategy", "the strategy raised SystemExit: 3 at t = 0.300 s"),
    "aborts": (12, "strategy", "the worker process died (exit code -6)"),
    "leaves": (19, "strategy", "the worker process died (exit code 0)"),
    "segfaults": (20, "strategy", "the worker process died (exit code -11)"),
    "hangs": (13, "strategy", "decide gave no answer within 1 s"),
    "hangs_in_c": (17, "strategy", "decide gave no answer within 1 s"),
}
"""The pair that each fault strikes of 24, what is to blame, and the reason."""

CHANGES: dict[str, Any] = {
    **QUICK,
    "arms.av": NAME,
    "experiment.timeout_s": 5.0,
    "experiment.decide_limit_s": 1.0,
}


BABBLES = 22
"""The pair in which a strategy prints megabytes, which is no fault."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, Run]:
    """The same run without a fault and with every fault."""
    folder = tmp_path_factory.mktemp("faults")
    faults = struck({"babbles": BABBLES, **{name: pair for name, (pair, _, _) in CULPRITS.items()}})
    clean = run("cctc", settings=CHANGES, pairs=24, out=folder / "clean")
    faulty = run("cctc", settings={**CHANGES, **faults}, pairs=24, out=folder / "faulty")
    return clean, faulty


@pytest.mark.parametrize("fault", CULPRITS)
def test_a_fault_is_one_failed_episode_in_one_arm(runs: tuple[Run, Run], fault: str) -> None:
    pair, blamed, reason = CULPRITS[fault]
    found = [failure for failure in runs[1].failures if failure[1] == pair]
    assert [(cell, arm) for cell, _, arm, _ in found] == [(0, "av")]
    assert reason in found[0][-1]
    assert "\n" not in found[0][-1]
    rows = runs[1].episodes.set_index(["pair", "arm"])
    assert rows.loc[(pair, "av"), "failed_in"] == blamed


@pytest.mark.parametrize("table", ["episodes", "pedestrians"])
def test_all_others_keep_their_rows(runs: tuple[Run, Run], table: str) -> None:
    failed = {(pair, arm) for _, pair, arm, _ in runs[1].failures}
    assert failed == {(pair, "av") for pair, _, _ in CULPRITS.values()}

    def others(of: Run) -> pa.Table:
        rows = of.rows(table, 0)
        keys = zip(rows["pair"].to_pylist(), rows["arm"].to_pylist(), strict=True)
        return rows.filter(pa.array([key not in failed for key in keys]))

    clean, faulty = map(others, runs)
    assert clean.num_rows > 2 * 24 - len(CULPRITS) - 1
    assert faulty.equals(clean)


def test_the_log_has_one_line_a_fault_with_its_stacks_and_traceback(runs: tuple[Run, Run]) -> None:
    events = [json.loads(line) for line in (runs[1].path / "log.jsonl").open(encoding="utf-8")]
    by_event = {
        name: {event["pair"]: event for event in events if event["event"] == name}
        for name in ("episode given up", "tried again", "arm failed")
    }
    stacks = {pair: event["stack"] for pair, event in by_event["episode given up"].items()}
    assert "in hang" in stacks[CULPRITS["hangs"][0]]
    assert "in hang_in_c" in stacks[CULPRITS["hangs_in_c"][0]]
    died = {CULPRITS[name][0] for name in ("aborts", "leaves", "segfaults")}
    assert {*by_event["tried again"]} == died == {pair for pair, of in stacks.items() if of is None}
    assert {*by_event["arm failed"]} == {pair for pair, _, _ in CULPRITS.values()}
    assert "died were tried again (3 in" in runs[1].result().notes[-1].text
    counted = Counter((event["event"], event.get("pair")) for event in events)
    assert {*counted.values()} == {1}
    assert "in raise_error" in by_event["arm failed"][CULPRITS["raises"][0]]["traceback"]


def test_a_strategy_may_decide_for_longer_than_anything_else_may_last(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    settings = {**CHANGES, "experiment.decide_limit_s": 60.0}
    for faults in ({}, {"dawdles": 0}):  # first the process starts
        found = evaluate("cctc", [struck(faults)], 1, settings=settings, engine="plain", workers=1)
        assert found["failure"].tolist() == [None]
        monkeypatch.setattr(children, "SLOW_S", 0.5)


SCRIPT = """
import sys
from harness.studies.running.run import run
from tests.faulty import struck
run("cctc", settings={**CHANGES, **struck(FAULTS)}, pairs=PAIRS, out=sys.argv[1], workers=2)
""".replace("CHANGES", repr({**CHANGES, "experiment.decide_limit_s": 100.0}))


def started(folder: Path, faults: dict[str, int], pairs: int) -> "subprocess.Popen[str]":
    script = SCRIPT.replace("FAULTS", repr(faults)).replace("PAIRS", str(pairs))
    return subprocess.Popen(
        [sys.executable, "-c", script, str(folder)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def children_of(process: "subprocess.Popen[str]", seconds: float) -> list[psutil.Process]:
    """The children of a command once it has some and has worked for a while."""
    end = time.monotonic() + 60
    while not psutil.Process(process.pid).children() and time.monotonic() < end:
        time.sleep(0.01)
    time.sleep(seconds)
    try:
        return psutil.Process(process.pid).children(recursive=True)
    except psutil.NoSuchProcess:
        return []


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_no_process_outlives_its_parent(tmp_path: Path, number: int) -> None:
    """Even if a strategy hangs in C code that keeps the interpreter's lock."""
    running = started(tmp_path / "run", {"hangs_in_c": 0}, 5)
    children = children_of(running, 2.5)
    assert children
    os.kill(running.pid, number)
    _, errors = running.communicate(timeout=60)
    _, alive = psutil.wait_procs(children, timeout=10)
    assert alive == []
    if number == signal.SIGINT:
        assert "harness.resume" in errors.splitlines()[-1]
