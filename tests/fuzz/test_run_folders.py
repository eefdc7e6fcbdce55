"""Run folders cut off, mixed from two runs, or changed: read, or refused in one line."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st

import harness
from harness.batch.experiment import Options, run_study
from harness.engine.process import close_engine
from harness.repeat.stored import StoredCell
from harness.review.compare import compare
from harness.review.export import export_csv
from harness.review.scoring import score
from tests.batches import QUICK, Inline, one_cell, sweep
from tests.fuzz.hostile import NAMES, VALUES, accepted_or_refused_in_one_line, files_below

FILES = (
    "manifest.json",
    "cells.parquet",
    "episodes.parquet",
    "pedestrians.parquet",
    "pairs.parquet",
    "traces.parquet",
    "summary.csv",
    "measures.csv",
    "conflicts.csv",
    "log.jsonl",
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``one``: a sweep of two strategies with traces.  ``other``: another scenario's run."""
    from tests.conftest import _close_all

    _close_all()
    folder = tmp_path_factory.mktemp("runs")
    changes = {**QUICK, "experiment.pairs": 6}
    study = sweep("cctc_flow", changes, "arms.av=constant_speed,hard_yield")
    run_study(study, Options(traces=True), out=folder / "one", make_executor=Inline)
    changes = {**changes, "experiment.pairs": 3, "experiment.seed": 5}
    run_study(one_cell("cctc", changes), Options(), out=folder / "other", make_executor=Inline)
    close_engine()
    assert {file.name for file in (folder / "one").iterdir()} >= set(FILES)
    return folder


def everything(folder: Path) -> list[Callable[[], Any]]:
    """Every way in which a stored run is read."""

    def frames() -> None:
        run = harness.load_run(folder)
        for name in ("cells", "episodes", "pedestrians", "pairs", "summary", "measures"):
            getattr(run, name)
        _ = run.conflicts, run.failures, run.scenario
        if run.kept_traces:
            _ = run.traces

    out = folder.parent / "scored"
    return [
        frames,
        lambda: StoredCell(folder, 0).check_pair(0),
        lambda: compare(folder),
        lambda: export_csv(folder),
        lambda: score(folder, out),
    ]


def read_one(runs: Path, folder: Path, way: int) -> None:
    """Read a hostile copy in one of the ways; nothing is written outside, nothing half."""
    outside = files_below(runs)
    accepted_or_refused_in_one_line(everything(folder)[way])
    changed = {path for path in files_below(runs) - outside if not path.is_relative_to(folder)}
    assert {path.relative_to(runs).parts[0] for path in changed} <= {"scored"}
    assert not [path for path in files_below(runs) if path.name.endswith(".partial")]
    shutil.rmtree(runs / "scored", ignore_errors=True)


WAYS = st.integers(0, 4)


@pytest.fixture
def copy(runs: Path) -> Callable[[], Path]:
    """Gives a fresh copy of the run to be spoilt, in the same place."""

    def make() -> Path:
        folder = runs / "hostile"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(runs / "one", folder)
        return folder

    return make


@given(
    st.sampled_from(FILES),
    st.integers(0, 2**31),
    st.lists(st.tuples(st.integers(0, 2**31), st.integers(0, 255)), max_size=5),
    WAYS,
)
def test_cut_off_or_changed_bytes(
    runs: Path,
    copy: Callable[[], Path],
    name: str,
    end: int,
    flips: list[tuple[int, int]],
    way: int,
) -> None:
    folder = copy()
    content = bytearray((folder / name).read_bytes())
    for place, value in flips:
        content[place % len(content)] = value
    cut = content if flips else content[: end % len(content)]
    (folder / name).write_bytes(bytes(cut))
    read_one(runs, folder, way)


@given(st.sets(st.sampled_from(FILES), min_size=1), st.booleans(), WAYS)
def test_missing_or_from_another_run(
    runs: Path, copy: Callable[[], Path], names: set[str], mixed: bool, way: int
) -> None:
    folder = copy()
    for name in names:
        (folder / name).unlink()
        if mixed and (runs / "other" / name).is_file():
            shutil.copyfile(runs / "other" / name, folder / name)
    read_one(runs, folder, way)


@given(
    st.sampled_from(
        ["schema", "name", "scenario", "cells", "traces", "until", "seed", "versions", "models"]
    ),
    VALUES,
    WAYS,
)
def test_any_value_in_the_manifest(
    runs: Path, copy: Callable[[], Path], key: str, value: Any, way: int
) -> None:
    folder = copy()
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    manifest[key] = value
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    read_one(runs, folder, way)


@given(NAMES, NAMES, WAYS)
def test_any_strategy_in_the_manifest(
    runs: Path, copy: Callable[[], Path], module: str, strategy: str, way: int
) -> None:
    folder = copy()
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    manifest["scenario"]["arms"]["av"] = f"{module}:{strategy}"
    manifest["cells"] = [{f"strategies.{module}.{strategy}": value} for value in (1, 2)]
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    read_one(runs, folder, way)
