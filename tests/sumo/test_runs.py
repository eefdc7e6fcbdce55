"""Runs into folders of parts: the same rows however they are divided, shared or resumed."""

import contextlib
import json
import multiprocessing
import re
import resource
import subprocess
import sys
import weakref
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from harness.core.vocabulary import Observation
from harness.engine.sumo_engine import SumoEngine
from harness.results import folder as folders
from harness.results.loaded_run import Run, load_run
from harness.studies.evaluate import evaluate
from harness.studies.running.run import resume, run
from tests.batches import QUICK, options_of, refusal, shell
from tests.faulty import NAME as FAULTY_NAME, struck
from tests.scenes import refuses


def same_rows(one: Run, other: Run) -> None:
    assert len(one.cells) == len(other.cells)
    for cell in one.study.cells:
        for table in ("episodes", "pedestrians", *["traces"] * one.manifest["traces"]):
            assert one.rows(table, cell.number).equals(other.rows(table, cell.number))


def processes(method: str) -> Callable[[], Executor]:
    return lambda: ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(method))


@contextlib.contextmanager
def longest_file(size: int) -> Iterator[None]:
    """No file of this process may grow beyond ``size`` bytes, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A sweep in this process."""
    out = tmp_path_factory.mktemp("here") / "run"
    return run("cctc_flow", vary=VARIED, pairs=25, traces=True, out=out, workers=0)


VARIED: Any = {"arms.av": ["soft_yield", "hard_yield"], "pedestrians.flow_per_hour": [300, 900]}


@pytest.mark.parametrize(
    "workers",
    [2, lambda: ThreadPoolExecutor(2), processes("spawn"), processes("fork")],
    ids=["two", "threads", "spawn", "fork"],
)
def test_rows_and_findings_are_the_same_for_any_workers(
    tmp_path: Path, here: Run, workers: int | Callable[[], Executor]
) -> None:
    options: dict[str, Any] = {"vary": VARIED, "pairs": 25, "traces": True, "out": tmp_path / "run"}
    if isinstance(workers, int):
        there = run("cctc_flow", workers=workers, **options)
    else:
        # This process has a child of its own, which is no fork's.
        evaluate("cctc_flow", [{}], 1, workers=1)
        with workers() as executor:
            there = run("cctc_flow", executor=executor, **options)
    same_rows(here, there)
    assert [cell.findings for cell in there.cells] == [cell.findings for cell in here.cells]
    assert [cell.findings for cell in load_run(there.path).cells] == [
        cell.findings for cell in here.cells
    ]


def test_a_run_of_a_runs_folder_with_more_pairs_begins_with_its_rows(tmp_path: Path) -> None:
    """Also if the folder is of older tables, which nothing else reads."""
    vary: Any = {"strategies.gap_yield.critical_gap_s": [2.0, 4.0], "arms.av": ["gap_yield"]}
    few = run("cctc_flow", vary=vary, pairs=7, seed=3, out=tmp_path / "few", workers=0).episodes
    made = folders.read_manifest(tmp_path / "few")
    older: Any = folders.sealed({**made, "schema": "of older tables"})
    folders.write_manifest(tmp_path / "few", older)
    many = run(tmp_path / "few", pairs=25, out=tmp_path / "many", workers=0).episodes
    pd.testing.assert_frame_equal(few, many[many["pair"] < 7].reset_index(drop=True))


FAULTY = {
    **{"arms.human": "human_gmm", "experiment.timeout_s": 30.0},
    **struck({"raises": 1, "nan": 3}),
}
SEES_BADLY = {
    "perception.latency_s": 0.3,
    "perception.detection_probability": 0.8,
    "perception.human": True,
}


@pytest.mark.parametrize(
    ("key", "values", "settings", "simulated"),
    [
        ("arms.av", ["soft_yield", "hard_yield"], {}, 3),
        ("arms.av", ["soft_yield", "human_yield", "human_gmm"], SEES_BADLY, 4),
        ("arms.av", ["soft_yield", FAULTY_NAME], FAULTY, 3),
        ("arms.human", ["human_gmm", "human_yield"], {}, 3),
        ("perception.latency_s", [0.0, 0.4], {}, 3),
        ("conflicts.pet_s", [1.0, 2.0], {}, 2),
        ("conflicts.pet_s", [1.0, 2.0], {"arms.av": FAULTY_NAME, **FAULTY}, 3),
        ("ego.length_m", [4.0, 5.0], {}, 4),
    ],
)
def test_a_shared_arm_is_simulated_once_and_its_rows_are_the_same(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    key: str,
    values: list[Any],
    settings: dict[str, Any],
    simulated: int,
) -> None:
    episodes, begin = [], SumoEngine.begin

    def counted(self: SumoEngine, people: Any) -> tuple[float, float]:
        episodes.append(people)
        return begin(self, people)

    monkeypatch.setattr(SumoEngine, "begin", counted)
    options: dict[str, Any] = {"pairs": 6, "traces": True, "workers": 0}
    sweep = run("cctc_flow", vary={key: values}, settings=settings, out=tmp_path / "all", **options)
    assert len(episodes) == simulated * 6
    for cell, value in enumerate(values):
        of_cell = {**settings, key: value}
        if FAULTY_NAME not in of_cell.values():
            of_cell = {name: of for name, of in of_cell.items() if FAULTY_NAME not in name}
        alone = run("cctc_flow", settings=of_cell, out=tmp_path / f"{cell}", **options)
        for table in ("episodes", "pedestrians", "traces"):
            rows = sweep.rows(table, cell).drop_columns("cell")
            assert rows.equals(alone.rows(table, 0).drop_columns("cell"))


def test_a_strategy_that_depends_on_more_than_it_says_is_never_copied(tmp_path: Path) -> None:
    """Its episodes are those that it drove, as in a run of one cell."""
    drives = {"arms.av": f"{__name__}:Moody", "experiment.timeout_s": 60.0}
    sweep = run(
        "cctc",
        vary={"conflicts.pet_s": [1.0, 2.0]},
        settings=drives,
        pairs=8,
        workers=0,
        out=tmp_path / "run",
    )
    one, other = (sweep.rows("episodes", cell)["pass_time_s"].to_pylist()[::2] for cell in (0, 1))
    both = [pair for pair in zip(one, other, strict=True) if None not in pair]
    assert len(both) > 4
    assert all(a != b for a, b in both)


class Moody:
    """Brakes more in each episode that it ever drives."""

    episodes = 0

    def __init__(self) -> None:
        Moody.episodes += 1
        self._brake_mps2 = Moody.episodes * 0.01

    def decide(self, observation: Observation) -> float:
        return -self._brake_mps2 if observation.time_s < 2 else 0.0


def test_damaged_and_missing_parts_are_simulated_again(tmp_path: Path) -> None:
    whole = run("cctc", settings=QUICK, pairs=25, out=tmp_path / "whole", workers=0)
    part = tmp_path / "whole" / "episodes" / "0000-00000005.parquet"
    content = part.read_bytes()
    for damage in (lambda: part.write_bytes(content[:-30]), part.unlink):
        damage()
        same_rows(resume(whole.path, workers=0), load_run(tmp_path / "whole"))
        assert part.read_bytes() == content
    assert "part removed" in (whole.path / "log.jsonl").read_text(encoding="utf-8")
    # Of 25 pairs only the part's five are simulated again, each time.
    events = [json.loads(line) for line in (tmp_path / "whole" / "log.jsonl").open()]
    started = [event["pairs"] for event in events if event["event"] == "started"]
    assert started == [25, 5, 5]


def test_parts_of_another_run_are_refused_and_kept(tmp_path: Path) -> None:
    whole = run("cctc", settings=QUICK, pairs=25, out=tmp_path / "whole", workers=0)
    other = run("cctc", settings=QUICK, pairs=25, seed=2, out=tmp_path / "other", workers=0)
    part = Path("episodes", "0000-00000005.parquet")
    content = (other.path / part).read_bytes()
    (whole.path / part).write_bytes(content)
    refuses("belongs to another run", lambda: resume(whole.path))
    assert (whole.path / part).read_bytes() == content
    (whole.path / part).rename(whole.path / "episodes" / "0009-00000005.parquet")
    refuses("is no part that this run plans", lambda: resume(whole.path))


def test_a_full_disk_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("COVERAGE_PROCESS_START", "COVERAGE_PROCESS_CONFIG"):
        monkeypatch.delenv(name, raising=False)  # its files are too large, too
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")  # compiled modules would be cut off
    whole = run("cctc", settings=QUICK, pairs=250, out=tmp_path / "whole", workers=0)
    arguments = ("run", "cctc", "--pairs", 250, "-q", "--out", tmp_path / "run", "--workers", 1)
    with longest_file(8_000):
        done = shell(*arguments, *options_of(QUICK))
    assert done.returncode == 1
    assert re.fullmatch(r"harness: .*File too large.*harness resume .*\n", done.stderr)
    assert not list((tmp_path / "run").rglob("*.partial"))
    same_rows(resume(tmp_path / "run", workers=0), whole)


def lacking(folder: Path) -> None:
    (folder / "episodes" / "0000-00000000.parquet").unlink()


def recounted(folder: Path) -> None:
    findings = folder / "findings.json"
    findings.write_text(findings.read_text().replace('"value": 5', '"value": 6'))


def edited(folder: Path) -> None:
    manifest = folder / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"seed": 1', '"seed": 2'))


def cut(folder: Path) -> None:
    part = folder / "episodes" / "0000-00000000.parquet"
    part.write_bytes(part.read_bytes()[:1_000])


@pytest.mark.parametrize(
    ("command", "change", "line"),
    [
        ("run cctc --pairs 5 --out", lambda _: None, "already holds a run.*harness resume"),
        ("resume", edited, "digest differs"),
        ("show", edited, "digest differs"),
        ("worst", cut, "is damaged .*harness resume"),
        ("compare", lacking, "episodes are missing: cell 0, pair 0; .*harness resume"),
        ("worst", lacking, "episodes are missing: cell 0, pair 0; .*harness resume"),
        ("show", recounted, "digest differs.*delete it; `harness resume"),
        ("resume", recounted, "digest differs.*delete it; `harness resume"),
        ("resume", lambda folder: (folder / "manifest.json").write_text("{"), "is damaged"),
    ],
)
def test_a_folder_that_cannot_be_used_is_refused_in_one_line_and_kept(
    tmp_path: Path, command: str, change: Callable[[Path], object], line: str
) -> None:
    vary = {"arms.av": ["constant_speed", "soft_yield"]}
    settings = {key: value for key, value in QUICK.items() if key not in vary}
    run("cctc", settings=settings, vary=vary, pairs=5, out=tmp_path / "run", workers=0)
    change(tmp_path / "run")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert re.search(line, refusal(*command.split(), tmp_path / "run"))
    assert before == {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"settings": {"arms.av": "nobody"}}, "unknown strategy"),
        ({"workers": -1}, "workers"),
        ({"scenario": "traffic", "traces": True}, "traces: is not supported with simulations"),
        ({"vary": {"arms.av": "hard_yield"}}, "vary arms.av: 'hard_yield' is not a list"),
        ({"scenario": ".."}, "is not a run folder"),
    ],
)
def test_what_is_refused_writes_no_manifest(
    tmp_path: Path, options: dict[str, Any], line: str
) -> None:
    scenario = options.pop("scenario", "cctc")
    refuses(line, lambda: run(scenario, pairs=1, out=tmp_path / "run", **options))
    assert not (tmp_path / "run" / "manifest.json").exists()


class Counting(ThreadPoolExecutor):
    """Counts the tasks that are submitted and have not ended, and those alive."""

    at_once = 6

    def __init__(self) -> None:
        self.most, self._futures = 0, weakref.WeakSet[Future[Any]]()
        super().__init__(2)

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> "Future[Any]":
        future = super().submit(function, *arguments, **options)
        self._futures.add(future)
        self.most = max(self.most, len(self._futures))
        return future


def test_few_tasks_and_rows_are_in_memory_at_a_time(tmp_path: Path) -> None:
    with Counting() as executor:
        run("cctc", settings=QUICK, pairs=190, out=tmp_path / "run", executor=executor)
    assert executor.most <= 4 * 2


IMPORTED = 100
"""Modules of the house that a run may import."""

COMMAND = """
import sys
sys.argv = ["harness", *{words}]
from harness.__main__ import main
try:
    main()
except SystemExit as end:
    assert end.code == 0, end.code
names = [name for name in sys.modules if name.split(".")[0] == "harness"]
print(len(names), file=sys.stderr)
"""


def test_a_run_imports_only_what_it_uses(tmp_path: Path) -> None:
    out = str(tmp_path / "run")
    for words in (["run", "cctc", "--pairs", "2", "--out", out], ["show", out], ["resume", out]):
        command = [sys.executable, "-c", COMMAND.format(words=words)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        assert int(done.stderr.splitlines()[-1]) <= IMPORTED, words
    child = (
        "import sys, harness.engine.starting, harness.studies.running.episodes; print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", child], capture_output=True, text=True, check=True)
    names = [name for name in done.stdout.split() if name.split(".")[0] == "harness"]
    assert 0 < len(names) <= IMPORTED
