"""Run folders read back: the same numbers, finished or not; bad folders refused in one line."""

import csv
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pandas.testing import assert_frame_equal

import harness
from harness.core.errors import InputError
from harness.old.store.schemas import SCHEMA
from harness.old.store.summaries import summarise_cell
from harness.old.studies.runs.export import export_csv
from harness.old.studies.runs.reported import reported
from harness.old.studies.runs.run_data import RunData
from tests.batches import here, one_cell, run_stopped
from tests.made_up import made_up
from tests.scenes import refuses

Spoil = Callable[[Path], object]
NAN, INF = float("nan"), float("inf")


def test_tables_are_what_the_files_hold(single: Path) -> None:
    run = harness.load_run(single)
    assert (run.name, run.kept_traces) == ("cctc", True)
    assert run.scenario.ego.trigger_range_m == 30
    for name in ("cells", "episodes", "pedestrians", "pairs", "traces"):
        stored = pq.read_table(single / f"{name}.parquet")
        frame: pd.DataFrame = getattr(run, name)
        assert list(frame.columns) == stored.column_names
        for column, values in stored.to_pydict().items():
            found = [None if pd.isna(value) else value for value in frame[column]]
            assert found == values, column
    with (single / "summary.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert list(run.summary.columns) == ["cell", *row]
    assert {name: float(run.summary[name][0]) for name in row} == pytest.approx(
        {name: float(value or "nan") for name, value in row.items()}, nan_ok=True
    )
    one_pair = run.traces[run.traces["pair"] == 7].reset_index(drop=True)
    assert len(one_pair) > 100
    assert_frame_equal(run.traces_of(0, 7), one_pair)


@pytest.mark.parametrize("name", ["measures", "conflicts"])
def test_statistics_are_what_the_files_hold(swept: Path, name: str) -> None:
    frame: pd.DataFrame = getattr(harness.load_run(swept), name)
    assert_frame_equal(frame, pd.read_csv(swept / f"{name}.csv"), check_dtype=False)


def test_varied_keys_of_a_sweep(swept: Path, tmp_path: Path) -> None:
    run = harness.load_run(swept)
    assert run.varied_keys == ["pedestrians.flow_per_hour", "arms.av"]
    assert list(run.summary["arms.av"]) == ["soft_yield", "constant_speed"] * 2
    assert list(run.summary["pedestrians.flow_per_hour"]) == [300, 300, 900, 900]
    assert list(run.summary["cell"]) == list(run.cells["cell"]) == [0, 1, 2, 3]
    assert run.scenario_of(3).arms.av == "constant_speed"
    with pytest.raises(InputError, match="kept no traces"):
        run.traces_of(0, 0)
    # The text of a varied key stays text.
    folder = copy(swept, tmp_path)
    cells = json.loads((folder / "manifest.json").read_text())["cells"]
    manifest(folder, cells=[{**cell, "model.name": "nan"} for cell in cells])
    assert list(harness.load_run(folder).summary["model.name"]) == ["nan"] * 4


def test_an_unfinished_run_is_to_be_resumed_first(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run_stopped(one_cell("cctc", {"experiment.pairs": 12}), folder, 1, workers=1)
    for use in (harness.load_run, harness.compare, harness.worst):
        with pytest.raises(InputError, match="is not finished; allowed: `harness resume"):
            use(folder)


def copy(folder: Path, to: Path) -> Path:
    """A copy to be spoilt."""
    target = to / "copy"
    shutil.copytree(folder, target)
    return target


def manifest(folder: Path, **changes: object) -> None:
    path = folder / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def put(table: str, name: str, value: object, every: bool = False) -> Spoil:
    """Puts a value into the first row of a column, or into every one."""

    def spoil(folder: Path) -> None:
        path = folder / f"{table}.parquet"
        good = pq.read_table(path)
        values = [value, *good[name].to_pylist()[1:]] if not every else [value] * good.num_rows
        column = pa.array(values, good[name].type)
        pq.write_table(good.set_column(good.column_names.index(name), name, column), path)

    return spoil


def drop(table: str, name: str) -> Spoil:
    """Removes a column."""

    def spoil(folder: Path) -> None:
        path = folder / f"{table}.parquet"
        pq.write_table(pq.read_table(path).drop_columns([name]), path)

    return spoil


def text(content: str) -> Spoil:
    """Writes another manifest."""
    return lambda folder: (folder / "manifest.json").write_text(content)


OLD = f"manifest.json: format version 0; allowed: {SCHEMA}: run its scenario again"
NO_VERSION = "manifest.json: format version None"
SPOILT: list[tuple[Spoil, str, str]] = [
    (lambda f: [p.unlink() for p in f.iterdir()], "", "is not a run folder"),
    (lambda f: (shutil.rmtree(f), f.write_text("x")), "", "is not a run folder"),
    (shutil.rmtree, "", "is not a run folder"),
    (text('{"name": "app"}'), "", NO_VERSION),
    (text("{"), "", "manifest.json: is damaged"),
    (text("[]"), "", NO_VERSION),
    (lambda f: manifest(f, schema=0), "", OLD),
    (lambda f: manifest(f, counts=[1]), "", "manifest.json: counts: [1] is not accepted"),
    (lambda f: manifest(f, scenario={"ego": {"wheels": 4}}), "", "ego.wheels"),
    (lambda f: (f / "pairs.parquet").unlink(), "", "pairs.parquet: is missing"),
    (lambda f: cut(f / "episodes.parquet"), "", "episodes.parquet: is damaged"),
    (
        lambda f: shutil.copy(f / "cells.parquet", f / "pairs.parquet"),
        "",
        "pairs.parquet: 1 rows; allowed: 12, as the manifest says",
    ),
    (put("episodes", "pair", None), "episodes", "episodes.parquet: pair: is empty in a row"),
    (put("episodes", "pair", 5), "episodes", "pair: rows are not in order"),
    (
        put("episodes", "arm", "human"),
        "episodes",
        "arm: does not have both arms of each pair; allowed: av",
    ),
    (
        put("episodes", "ending", "vanished"),
        "episodes",
        "ending: 'vanished'; allowed: crossed, crashed",
    ),
    (put("episodes", "steps", -1), "episodes", "steps: -1; allowed: 0 to"),
    (put("episodes", "pass_time_s", 0.0), "episodes", "pass_time_s: 0.0; allowed: 1e-18 to"),
    (put("episodes", "min_ttc_s", NAN), "episodes", "min_ttc_s: nan; allowed: -1e+18 to 1e+18"),
    (put("traces", "x_m", INF), "traces", "x_m: inf; allowed"),
    (put("pedestrians", "side", "left"), "pedestrians", "side: 'left'; allowed: near, far"),
    # Every reader needs it.
    (
        drop("episodes", "stops"),
        "episodes",
        "episodes.parquet: lacks stops … of this version",
    ),
    (put("summary", "mu", NAN, True), "summary", "mu: is damaged; allowed: a finite number"),
    (put("summary", "kappa_ci_high", INF, True), "summary", "kappa_ci_high: is damaged"),
    (put("summary", "pairs", None, True), "summary", "pairs: is damaged"),
    (
        put("summary", "cell", 3, True),
        "summary",
        "is damaged; allowed: a row for each of 1 cells",
    ),
    (lambda f: cut(f / "summary.parquet"), "summary", "is damaged"),
]


@pytest.mark.parametrize(("spoil", "table", "words"), SPOILT)
def test_what_is_spoilt_is_refused_in_one_line(
    single: Path, tmp_path: Path, spoil: Spoil, table: str, words: str
) -> None:
    folder = copy(single, tmp_path)
    spoil(folder)
    run = harness.load_run(folder) if table else None
    with pytest.raises(InputError) as caught:
        getattr(run, table) if table else harness.load_run(folder)
    said = str(caught.value)
    assert [part for part in [*words.split(" … "), str(folder)] if part not in said] == []
    assert "\n" not in said


def test_our_own_mistake_is_not_blamed_on_the_run(
    single: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def mistaken(*_: object) -> None:
        raise AttributeError("no such thing")

    monkeypatch.setattr(RunData, "results", property(mistaken))
    done = here("report", single)
    assert done.returncode == 1
    first, *_, error, last = done.stderr.splitlines()
    assert (first, error) == ("Traceback (most recent call last):", "AttributeError: no such thing")
    assert "bug in the harness, not an error in your files; please report" in last
    assert "damaged" not in done.stderr

    def too_large(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(RunData, "results", property(too_large))
    done = here("report", single)
    assert (done.returncode, done.stderr) == (1, "harness: there is not enough memory for this\n")


@pytest.mark.parametrize(
    "spoil", [lambda f: (f / "summary.parquet").unlink(), drop("summary", "kappa_front")]
)
def test_a_summary_that_lacks_anything_is_worked_out_anew(
    single: Path, tmp_path: Path, spoil: Spoil
) -> None:
    folder = copy(single, tmp_path)
    spoil(folder)
    expected = harness.load_run(single)
    assert harness.load_run(folder).results[0].findings == expected.results[0].findings


def test_a_flipped_bit_of_a_table_gives_no_other_numbers(single: Path, tmp_path: Path) -> None:
    """Without checksums in the file most flips give another number, or another word."""
    folder = copy(single, tmp_path)
    path, whole = folder / "episodes.parquet", harness.load_run(single).episodes
    content, refused = path.read_bytes(), 0
    # The data; the rest of the file is Parquet's own description of them.
    for place in range(100, len(content) // 4, 97):
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        try:
            assert_frame_equal(harness.load_run(folder).episodes, whole)
        except InputError:
            refused += 1
    assert refused > 5


def test_results_are_what_the_run_reported(swept: Path) -> None:
    """Read back from ``summary.parquet``, as the statistics had it when the run ended."""
    run = harness.load_run(swept)
    assert len(run.results) == 4
    for result in run.results:
        own = pq.read_table(swept / "episodes.parquet", filters=[("cell", "=", result.cell.number)])
        assert result.findings == summarise_cell(own, result.cell, 0.95).findings
    assert any(result.findings["kappa"].events for result in run.results)


def test_one_pair_has_a_mean_and_no_spread(tmp_path: Path) -> None:
    run = made_up(tmp_path / "run", one_cell("cctc", {"experiment.pairs": 1}), lambda *_: 9.0)
    findings = reported(harness.load_run(run)).cells[0].findings
    assert findings["mu"].value == pytest.approx(9 / 10)  # the reference takes 10 s
    assert "fewer than two pairs" in str(findings["cv"].reason)


def test_an_export_of_a_damaged_run_leaves_nothing_behind(single: Path, tmp_path: Path) -> None:
    run = copy(single, tmp_path / "run")
    table = run / "pedestrians.parquet"
    table.write_bytes(table.read_bytes()[:100])
    before = {path.name for path in run.iterdir()}
    refuses(r"pedestrians\.parquet: is damaged", lambda: export_csv(run))
    table.unlink()
    refuses(r"pedestrians\.parquet: is missing", lambda: export_csv(run))
    assert {path.name for path in run.iterdir()} == before - {table.name}
