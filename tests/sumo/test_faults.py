"""Injected faults: the culprits get ``engine_failed`` with the reason, all others their results.

Workers are fresh processes, where nothing that a test patches is seen: the faulty strategy is a
user's own, found by its module.
"""

import json
import resource
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from harness.core.encounter import Arrival
from harness.core.errors import EngineError, HarnessError
from harness.core.seeding import stream
from harness.engine.plain import PlainEngine
from harness.old.studies.batch.experiment import resume, run_study
from harness.scenario import Options
from tests.batches import QUICK, Inline, content, here, one_cell, options_of, run_inline, shell
from tests.faulty import NAME, struck

CULPRITS = {
    "raises": 1,
    "nan": 2,
    "text": 3,
    "loses_ego": 4,
    "exits": 9,
    "aborts": 12,
    "hangs": 13,
    "hangs_in_c": 17,
}
"""The pair each fault strikes, of 24 in tasks of 4: some tasks hold several, some none."""

REASONS = {
    "raises": "the strategy raised RuntimeError: on purpose at t = 0.300 s",
    "nan": "the strategy returned nan at t = 0.300 s",
    "text": "the strategy returned 'fast' at t = 0.300 s",
    "loses_ego": "SUMO failed during the episode",
    "exits": "the strategy raised SystemExit: 3 at t = 0.300 s (",
    # 6 is SIGABRT's number on every POSIX system.
    "aborts": "the worker process died (exit code -6)",
    "hangs": "decide gave no answer within 2 s (arm av)",
    "hangs_in_c": "decide gave no answer within 2 s (arm av)",
}

CHANGES: dict[str, object] = {
    **QUICK,
    "arms.av": NAME,
    "experiment.pairs": 24,
    "experiment.timeout_s": 5.0,
    "experiment.decide_limit_s": 2.0,
    "pedestrians.flow_per_hour": 1000.0,
}


@pytest.fixture(scope="module")
def batch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One run with every fault (``faulty``) and one with none (``clean``)."""
    folder = tmp_path_factory.mktemp("faults")
    run_inline(one_cell("cctc", CHANGES), folder / "clean")
    study = one_cell("cctc", {**CHANGES, **struck(CULPRITS)})
    # Code that keeps the interpreter's lock is seen by the limit of the whole pair alone.
    options = Options(workers=2, task_pairs=4, traces=True, hang_after_s=5.0)
    told: set[str] = set()
    finished = run_study(
        study, options, out=folder / "faulty", progress=lambda _done, _of, what: told.add(what)
    )
    # Two seconds without news are said, where there were any.
    assert {what.partition(",")[0] for what in told} == {"pairs"}
    assert all(what == "pairs" or "pair " in what for what in told)
    assert {(pair, arm) for _, pair, arm, _ in finished.failures} >= {
        (pair, "av") for pair in CULPRITS.values()
    }
    return folder


def rows(folder: Path, name: str) -> dict[int, list[dict[str, Any]]]:
    found: dict[int, list[dict[str, Any]]] = {}
    for row in pq.read_table(folder / f"{name}.parquet").to_pylist():
        found.setdefault(row["pair"], []).append(row)
    return found


@pytest.mark.parametrize("fault", list(CULPRITS))
def test_the_culprit_is_recorded_with_its_reason(batch: Path, fault: str) -> None:
    av, human = rows(batch / "faulty", "episodes")[CULPRITS[fault]]
    assert (av["arm"], av["ending"]) == ("av", "engine_failed")
    assert REASONS[fault] in av["reason"]
    assert av["pass_time_s"] is None
    assert av["failed_in"] == ("engine" if fault in ("loses_ego", "aborts") else "strategy")
    if fault != "aborts":
        # The other arm of the pair has a new simulation and its own result.
        assert human == rows(batch / "clean", "episodes")[CULPRITS[fault]][1]
    else:
        assert human["ending"] == "engine_failed"


def test_all_others_keep_their_results(batch: Path) -> None:
    for name in ("episodes", "pedestrians", "pairs"):
        clean, faulty = rows(batch / "clean", name), rows(batch / "faulty", name)
        for pair in set(range(24)) - set(CULPRITS.values()):
            assert faulty.get(pair) == clean.get(pair), (name, pair)
    assert len(rows(batch / "faulty", "episodes")) == 24


def test_the_log_has_the_stack_of_a_hung_worker_and_the_strategys_traceback(batch: Path) -> None:
    lines = (batch / "faulty" / "log.jsonl").read_text(encoding="utf-8").splitlines()
    events = [json.loads(line) for line in lines]
    given_up = [event for event in events if event["event"] == "episode given up"]
    for fault, function in (("hangs", "in hang"), ("hangs_in_c", "in hang_in_c")):
        pair = CULPRITS[fault]
        stacks = [event["stack"] for event in given_up if event["pair"] == pair]
        assert len(stacks) == 1, "another attempt would wait as long"
        assert function in stacks[0]
    for what, faults in (("pair", ["aborts"]), ("episode", ["hangs", "hangs_in_c"])):
        named = {event["pair"] for event in events if event["event"] == f"{what} given up"}
        assert named == {CULPRITS[name] for name in faults}
    failed = {event["pair"]: event for event in events if event["event"] == "episode failed"}
    assert set(failed) == {pair for name, pair in CULPRITS.items() if name != "aborts"}
    event = failed[CULPRITS["raises"]]
    assert (event["arm"], event["strategy"]) == ("av", NAME)
    assert REASONS["raises"] in event["reason"]
    first, *_, last = event["traceback"].splitlines()
    assert (first, last) == ("Traceback (most recent call last):", "RuntimeError: on purpose")
    assert all(place in event["traceback"] for place in ("in decide", "in raise_error"))
    assert "episode.py" not in event["traceback"]
    assert failed[CULPRITS["nan"]]["traceback"] is None


@pytest.mark.slow
@pytest.mark.usefixtures("no_simulation")
def test_where_both_strategies_hang_both_arms_are_given_up(tmp_path: Path) -> None:
    """Each for itself: the second hang says both reasons, and the run goes on."""
    changes = {**CHANGES, "experiment.pairs": 3, "experiment.decide_limit_s": 1.0}
    changes["arms.human"] = NAME
    # One strategy in both arms draws the same numbers in both.
    number = float(stream(1, "strategy", 1).random())
    study = one_cell("cctc", {**changes, f'strategies."{NAME}".hangs': number})
    run_study(study, Options(workers=1), out=tmp_path / "run")
    found = rows(tmp_path / "run", "episodes")
    av, human = found[1]
    assert {av["ending"], human["ending"]} == {"engine_failed"}
    assert "(arm av); decide gave no answer within 1 s (arm human)" in av["reason"]
    assert [row["ending"] for pair in (0, 2) for row in found[pair]].count("engine_failed") == 0


def test_summary_counts_the_failed_apart(batch: Path) -> None:
    head, line = (batch / "faulty" / "summary.csv").read_text(encoding="utf-8").splitlines()
    summary = dict(zip(head.split(","), line.split(","), strict=True))
    assert (summary["pairs"], summary["failed"]) == ("24", "8")
    clean = rows(batch / "clean", "episodes")
    crashed = [clean[pair][0]["ending"] == "crashed" for pair in clean]
    kept = [crash for pair, crash in enumerate(crashed) if pair not in CULPRITS.values()]
    assert float(summary["kappa"]) == pytest.approx(sum(kept) / 16)


def test_the_command_names_the_culprit(tmp_path: Path) -> None:
    changes = {**CHANGES, **struck({"nan": 2}), "experiment.pairs": 4}
    done = here("run", "cctc", "--out", tmp_path / "run", *options_of(changes))
    assert done.returncode == 1
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("harness:")]
    assert all(word in line for word in ("1 episode", "pair 2", "av", "returned nan"))
    assert "Traceback" not in done.stderr


class NoStart(PlainEngine):
    """Cannot begin some of its episodes."""

    episodes = 0

    def begin(self, arrivals: Sequence[Arrival]) -> tuple[float, float]:
        NoStart.episodes += 1
        if NoStart.episodes in (3, 6):
            raise EngineError("no start")
        return super().begin(arrivals)


def test_an_engine_that_does_not_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NoStart, "episodes", 0)
    monkeypatch.setattr(
        "harness.old.studies.kinds.encounters.open_engine",
        lambda scenario, _name: NoStart(scenario.vehicle(), scenario.experiment.step_s),
    )
    study = one_cell("cctc", {**QUICK, "experiment.pairs": 4})
    episodes = run_inline(study, tmp_path / "run", traces=True).episodes.to_dict("records")
    failed = [(row["pair"], row["arm"]) for row in episodes if row["reason"] == "no start"]
    # Episodes come as pair 0 av, 0 human, 1 av, …: the third and the sixth.
    assert failed == [(1, "av"), (2, "human")]
    assert len(episodes) == 8


@contextmanager
def longest_file(size: int) -> Iterator[None]:
    """No file of this process may grow beyond ``size`` bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize(
    ("limit", "task_pairs", "what"), [(4_000, 50, "shards"), (12_000, 5, "parquet")]
)
@pytest.mark.usefixtures("no_simulation")
def test_a_disk_that_is_full_and_then_is_not(
    tmp_path: Path, limit: int, task_pairs: int, what: str
) -> None:
    study = one_cell("cctc", {**QUICK, "experiment.pairs": 250})
    run_inline(study, tmp_path / "whole")
    with longest_file(limit), pytest.raises(HarnessError, match=f"{what}.*File too large"):
        run_inline(study, tmp_path / "run", task_pairs=task_pairs)
    assert not list((tmp_path / "run").rglob("*.partial"))
    resume(tmp_path / "run", make_executor=Inline)
    assert content(tmp_path / "run") == content(tmp_path / "whole")


def mount(folder: Path, *options: str) -> bool:
    command = ["mount", "-t", "tmpfs", *options, "tmpfs", str(folder)]
    try:
        return subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        return False


@pytest.mark.slow
def test_a_small_file_system_from_the_shell(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    if not mount(disk, "-o", "size=64k"):
        pytest.skip("no right to mount a small file system")
    try:
        changes = options_of({**QUICK, "experiment.pairs": 400})
        done = shell("run", "cctc", "--traces", "-q", "--out", disk / "run", *changes)
        assert done.returncode == 1
        assert done.stderr.count("\n") == 1, done.stderr
        assert "No space left on device" in done.stderr
        assert mount(disk, "-o", "remount,size=64m")
        again = shell("resume", disk / "run", "-q")
        assert again.returncode == 0, again.stderr
        whole = shell("run", "cctc", "--traces", "-q", "--out", tmp_path / "whole", *changes)
        assert whole.returncode == 0
        assert content(disk / "run") == content(tmp_path / "whole")
    finally:
        subprocess.run(["umount", str(disk)], check=False)
