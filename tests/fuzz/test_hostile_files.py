"""Whatever is in a file, a command works or refuses it in one line: no traceback and no hang."""

import math
import shutil
import signal
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args
from unittest.mock import Mock

import pandas as pd
import pytest
from hypothesis import given, strategies as st
from pydantic import BaseModel

from harness.core.errors import HarnessError
from harness.core.files import shipped_directory
from harness.engine.shared import close_engine
from harness.model.interaction import SHIPPED
from harness.scenario import Scenario
from tests.batches import here
from tests.conftest import close_all
from tests.fuzz.hostile import cases, hostile

DATA = Path(__file__).resolve().parents[1] / "data"
HANG_S = 120
"""No case takes nearly as long; what does, hangs."""

HOURS = """
arms = {av = "gap_yield", human = "human_yield"}
ego = {initial_speed_mps = 8.0}
traffic = {flow_per_hour = 300, duration_s = 60, warm_up_s = 20}
experiment = {pairs = 2}
"""
FIT = "fit {file} --components 1 --starts 1 --folds 0 --workers 1 --out out/model.json"
RUN = "run"
ONE = "--pair 0 --arm av --out out"
KINDS: dict[str, tuple[int, tuple[str, ...]]] = {
    "scenario": (10_000, ("run {file} --out out", "run {file} --vary experiment.seed=1,2")),
    "model": (10_000, ("model {file}", "run cctc --set model.path={file} --out out")),
    "run": (10_000, (f"compare {RUN}", f"show {RUN} --full", f"resume {RUN}")),
    "run, shown": (400, (f"report {RUN} --out out/page.html", f"replay {RUN} {ONE}")),
    "model, shown": (200, ("model {file} --figures out",)),
    "rows": (2_500, (FIT,)),
    "network": (5_000, ("crossings {file}", "crossings {file} --json")),
    "hours": (600, ("report hours --out out/page.html",)),
    "town": (
        1_000,
        (
            "crossings town/town.sumocfg",
            "crossings town/town.sumocfg --write out/town.toml --edge :J7_c0",
            "run town/own.toml --out out",
        ),
    ),
    "risk": (2_500, ("show risk", "resume risk")),
}
"""Cases of each kind of file in full, and the commands that read it; those that draw take long."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where the commands are given, with good files; a run ends when it has a manifest."""
    close_all()
    folder = tmp_path_factory.mktemp("fuzz") / "here"
    folder.mkdir()
    shutil.copy(shipped_directory("scenarios") / "cctc.toml", folder)
    shutil.copy(SHIPPED / f"{Scenario().model.name}.json", folder)
    shutil.copy(DATA / "rows_made_up.csv", folder)
    pd.read_csv(DATA / "rows_made_up.csv").to_parquet(folder / "rows_made_up.parquet")
    shutil.copy(shipped_directory("networks") / "cctc" / "cctc.net.xml", folder)
    shutil.copytree(DATA.parents[1] / "examples" / "own_simulation", folder / "town")
    (folder / "hours.toml").write_text(HOURS, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        sweep = "run cctc_flow --vary arms.av=soft_yield,gap_yield --pairs 2 --traces"
        assert done_or_refused(*sweep.split(), "--set", "pedestrians.max_count=3", "--out", RUN)
        (folder / RUN / "log.jsonl").unlink()  # it has a clock in it
        assert done_or_refused("run", "hours.toml", "--out", "hours")
        risk = "risk cctc --set arms.av=constant_speed --target-cv 1 --out risk"
        assert done_or_refused(*risk.split())
        own = "crossings town/town.sumocfg --write town/own.toml --edge :J7_c0"
        assert done_or_refused(*own.split())
        yield folder
    close_engine()


@pytest.fixture
def _nothing_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    begins = Mock(side_effect=HarnessError("here the tasks would begin"))
    monkeypatch.setattr("harness.studies.running.run.tasks_of", begins)


def files_of(folder: Path, kind: str) -> list[Path]:
    named = {
        "scenario": "*.toml",
        "model": "*.json",
        "run": f"{RUN}/**/[!.]*",
        "rows": "rows*",
        "network": "*.net.xml",
        "hours": "hours/[!.]*",
        "risk": "risk/[!.]*",
        "town": "town/*",
    }
    return sorted(path for path in folder.glob(named[kind.split(",")[0]]) if path.is_file())


def done_or_refused(*words: str) -> bool:
    """Whether a command did what it was told; else it refused in one line with exit code 2."""
    signal.alarm(HANG_S)  # nothing catches it: it ends the process
    try:
        done = here(*words)
    finally:
        signal.alarm(0)
    code, said = done.returncode, done.stdout + done.stderr
    assert code in (0, 1, 2), said
    assert "Traceback" not in said
    # A terminal obeys control characters, wherever they come from.
    assert not {c for c in said if unicodedata.category(c) in ("Cc", "Cs")} - {"\n"}, said
    if code == 2:
        *before, line = done.stderr.splitlines()
        assert line.startswith("harness: ")
        # What breaks late may follow on a table or a progress bar.
        assert (done.stdout == "" and not before) or "is damaged" in line, done.stderr
    return code != 2


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.usefixtures("_nothing_runs")
def test_whatever_is_in_a_file(folder: Path, kind: str) -> None:
    (number, commands), files = KINDS[kind], files_of(folder, kind)
    there, kept = {*folder.iterdir()}, {path: path.read_bytes() for path in files}

    @cases(number)
    @given(st.data())
    def case(data: st.DataObject) -> None:
        for path, content in kept.items():
            path.write_bytes(content)
        for name in ("out", "runs"):
            shutil.rmtree(folder / name, ignore_errors=True)
        (folder / "out").mkdir()
        file = data.draw(st.sampled_from(files))
        file.write_bytes(data.draw(hostile(kept[file], file.suffix)))
        done_or_refused(*data.draw(st.sampled_from(commands)).format(file=file.name).split())
        assert {path.name for path in {*folder.iterdir()} - there} <= {"out", "runs"}
        assert [path.name for path in folder.parent.iterdir()] == [folder.name]
        assert not [path for path in folder.rglob("*") if path.name.endswith(".partial")]

    case()
    for path, content in kept.items():
        path.write_bytes(content)


def extremes() -> Iterator[tuple[str, Any]]:
    """The last values that the form of a scenario lets through, by key."""
    for table, section in Scenario.model_fields.items():
        if table == "experiment" or not isinstance(section.annotation, type):
            continue
        fields = getattr(section.annotation, "model_fields", {})
        for key, field in fields.items():
            limits = {type(limit).__name__: limit for limit in field.metadata}
            for name, limit in limits.items():
                if name in ("Ge", "Le"):
                    yield f"{table}.{key}", getattr(limit, name.lower())
                elif name in ("Gt", "Lt"):
                    towards = math.inf if name == "Gt" else -math.inf
                    yield f"{table}.{key}", math.nextafter(getattr(limit, name.lower()), towards)
            if "Le" not in limits and "Lt" not in limits and field.annotation is float:
                yield f"{table}.{key}", 1e308
            if not isinstance(field.annotation, type):
                yield from ((f"{table}.{key}", word) for word in get_args(field.annotation))


EXTREMES = [(key, value) for key, value in extremes() if not isinstance(value, type | BaseModel)]


@cases(600)
@given(st.lists(st.sampled_from(EXTREMES), min_size=1, max_size=5, unique_by=lambda pair: pair[0]))
def test_what_is_accepted_runs_to_its_end(folder: Path, chosen: list[tuple[str, Any]]) -> None:
    """No extreme hangs, or leaves a run that cannot be read."""
    settings = [word for key, value in chosen for word in ("--set", f"{key}={value}")]
    short = ["--set", "experiment.timeout_s=20", "--pairs", "2", "--out", "out"]
    if done_or_refused("run", "cctc_flow", *short, *settings):
        assert done_or_refused("show", "out", "--full")
    shutil.rmtree(folder / "out", ignore_errors=True)


DEEP = "[" * 5_000 + "]" * 5_000
UNUSUAL = {
    "empty.json": b"",
    "utf16.toml": "[ego]\n".encode("utf-16"),
    "nul.toml": b"[experiment]\npairs = 1\x00\n",
    "deep.toml": f"[experiment]\npairs = {DEEP}\n".encode(),
    "deepkey.toml": f"strategies.a{'.a' * 3_000} = 1\n".encode(),
    "digits.toml": f"[experiment]\nseed = 0x{'f' * 5_000}\n".encode(),
    "cells.toml": b"[sweep.experiment]\nseed = [" + b"1," * 99_999 + b"]\npairs = [1, 2]\n",
    "device.toml": b'[model]\npath = "/dev/zero"\n',
    "deep.json": f'{{"provenance": {DEEP}}}'.encode(),
    "exponent.json": b'{"schema": 1e999999999}',
    "huge.csv": b"range_m\n1" + b"0" * 400 + b"\n",
    "encoding.net.xml": b'<?xml version="1.0" encoding="None"?><net/>',
}


@pytest.mark.parametrize("name", UNUSUAL)
@pytest.mark.usefixtures("_nothing_runs")
def test_unusual_files_are_refused(folder: Path, name: str) -> None:
    command = {".toml": "run {}", ".json": "model {}", ".csv": FIT.replace("{file}", "{}")}
    command |= {".xml": "crossings {}"}
    (folder / name).write_bytes(UNUSUAL[name])
    assert not done_or_refused(*command[Path(name).suffix].format(name).split())
    (folder / name).unlink()
