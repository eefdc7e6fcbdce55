"""Runs into folders of parts: the same rows however they are divided, shared or resumed."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from harness.core.errors import HarnessError, InputError
from harness.results.run import Run, load_run
from harness.studies.run import resume, run
from harness.studies.workers import InProcess
from tests.unit.test_parts import longest_file

QUICK: dict[str, Any] = {
    **{"arms.av": "constant_speed", "arms.human": "constant_speed", "model.extrapolate": True},
    **{"ego.initial_speed_mps": 10.0, "ego.trigger_range_m": 10.0},
    "pedestrians.flow_per_hour": 1000.0,
}


def same_rows(one: Run, other: Run) -> None:
    for table in ("episodes", "pedestrians"):
        pd.testing.assert_frame_equal(getattr(one, table), getattr(other, table))


def test_rows_are_the_same_for_any_workers(tmp_path: Path) -> None:
    here = run("cctc_flow", pairs=25, out=tmp_path / "here", workers=0)
    with ThreadPoolExecutor(2) as executor:
        there = run("cctc_flow", pairs=25, out=tmp_path / "there", executor=executor)
    same_rows(here, there)
    assert [cell.findings for cell in here.cells] == [cell.findings for cell in there.cells]
    assert [cell.findings for cell in load_run(here.path).cells] == [
        cell.findings for cell in here.cells
    ]


def test_a_run_of_fewer_pairs_is_the_beginning_of_a_longer_one(tmp_path: Path) -> None:
    few = run("cctc_flow", pairs=7, out=tmp_path / "few", workers=0).episodes
    many = run("cctc_flow", pairs=25, out=tmp_path / "many", workers=0).episodes
    pd.testing.assert_frame_equal(few, many[many["pair"] < 7].reset_index(drop=True))


@pytest.mark.parametrize(
    ("key", "values", "simulated"),
    [
        ("arms.av", ["soft_yield", "hard_yield"], 3),
        ("arms.human", ["human_gmm", "constant_speed"], 3),
        ("perception.latency_s", [0.0, 0.4], 3),
        ("ego.length_m", [4.0, 5.0], 4),
    ],
)
def test_a_shared_arm_is_simulated_once_and_its_rows_are_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, key: str, values: list[Any], simulated: int
) -> None:
    from harness.episode.pairing import PairRunner

    episodes, begins = [], PairRunner._run_arm

    def counted(self: PairRunner, *arguments: Any, **options: Any) -> Any:
        episodes.append(arguments)
        return begins(self, *arguments, **options)

    monkeypatch.setattr(PairRunner, "_run_arm", counted)
    sweep = run("cctc_flow", vary={key: values}, pairs=4, out=tmp_path / "all", workers=0)
    assert len(episodes) == simulated * 4
    for cell, value in enumerate(values):
        alone = run(
            "cctc_flow", settings={key: value}, pairs=4, out=tmp_path / f"{cell}", workers=0
        )
        for table in ("episodes", "pedestrians"):
            rows = getattr(sweep, table)
            rows = rows[rows["cell"] == cell].drop(columns="cell").reset_index(drop=True)
            expected = getattr(alone, table).drop(columns="cell")
            pd.testing.assert_frame_equal(rows, expected, check_dtype=False)


class Stopping(InProcess):
    """Stops, as Ctrl-C does, when it is given its n-th task."""

    def __init__(self, tasks: int) -> None:
        self.left = tasks

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> Any:
        self.left -= 1
        if self.left < 0:
            raise KeyboardInterrupt
        return super().submit(function, *arguments, **options)


def test_damaged_and_missing_parts_are_simulated_again(tmp_path: Path) -> None:
    whole = run("cctc", settings=QUICK, pairs=25, out=tmp_path / "whole", workers=0)
    part = tmp_path / "whole" / "episodes" / "0000-00000005.parquet"
    content = part.read_bytes()
    for damage in (lambda: part.write_bytes(content[:-30]), part.unlink):
        damage()
        same_rows(resume(whole.path, workers=0), load_run(tmp_path / "whole"))
        assert part.read_bytes() == content
    assert "part removed" in (whole.path / "log.jsonl").read_text(encoding="utf-8")


def test_parts_of_another_run_are_refused_and_kept(tmp_path: Path) -> None:
    whole = run("cctc", settings=QUICK, pairs=25, out=tmp_path / "whole", workers=0)
    other = run("cctc", settings=QUICK, pairs=25, seed=2, out=tmp_path / "other", workers=0)
    part = Path("episodes", "0000-00000005.parquet")
    content = (other.path / part).read_bytes()
    (whole.path / part).write_bytes(content)
    with pytest.raises(InputError, match="belongs to another run"):
        resume(whole.path)
    assert (whole.path / part).read_bytes() == content
    (whole.path / part).rename(whole.path / "episodes" / "0009-00000005.parquet")
    with pytest.raises(InputError, match="is no part that this run plans"):
        resume(whole.path)


def test_a_full_disk_loses_nothing(tmp_path: Path) -> None:
    whole = run("cctc", settings=QUICK, pairs=250, out=tmp_path / "whole", workers=0)
    with longest_file(8_000), pytest.raises(HarnessError, match=r"File too large.*harness resume"):
        run("cctc", settings=QUICK, pairs=250, out=tmp_path / "run", workers=0)
    assert not list((tmp_path / "run").rglob("*.partial"))
    same_rows(resume(tmp_path / "run", workers=0), whole)


def test_a_run_never_writes_into_another(tmp_path: Path) -> None:
    run("cctc", settings=QUICK, pairs=1, out=tmp_path / "run", workers=0)
    with pytest.raises(InputError, match=r"already holds a run.*harness resume"):
        run("cctc", settings=QUICK, pairs=1, out=tmp_path / "run", workers=0)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"settings": {"arms.av": "nobody"}}, "unknown strategy"),
        ({"workers": -1}, "workers"),
        ({"engine": "unity"}, "unknown engine"),
        ({"scenario": "traffic"}, "scenario of encounters"),
    ],
)
def test_what_is_refused_writes_no_manifest(
    tmp_path: Path, options: dict[str, Any], line: str
) -> None:
    scenario = options.pop("scenario", "cctc")
    with pytest.raises(InputError, match=line):
        run(scenario, pairs=1, out=tmp_path / "run", **options)
    assert not (tmp_path / "run" / "manifest.json").exists()


def test_an_interrupted_run_goes_on_where_it_was(tmp_path: Path) -> None:
    whole = run("cctc", settings=QUICK, pairs=25, out=tmp_path / "whole", workers=0)
    with pytest.raises(KeyboardInterrupt, match="harness resume"):
        run("cctc", settings=QUICK, pairs=25, out=tmp_path / "run", executor=Stopping(2))
    assert not load_run(tmp_path / "run").finished
    same_rows(resume(tmp_path / "run", workers=0), whole)
