"""Run folders read back: the same numbers, finished or not; bad folders refused in one line."""

import csv
import json
import re
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
from harness.scenario import Options
from harness.store.summaries import summarise_cell
from harness.store.tables import SCHEMA
from harness.studies.runs.reported import reported
from harness.studies.runs.run_data import RunData
from tests.batches import here, one_cell
from tests.made_up import made_up
from tests.report.conftest import simulate


def test_tables_are_what_the_files_hold(single: Path) -> None:
    run = harness.load_run(single)
    assert (run.finished, run.name, run.kept_traces) == (True, "cctc", True)
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


@pytest.mark.parametrize("name", ["measures", "conflicts"])
def test_statistics_are_what_the_files_hold(swept: Path, name: str) -> None:
    frame: pd.DataFrame = getattr(harness.load_run(swept), name)
    assert_frame_equal(frame, pd.read_csv(swept / f"{name}.csv"), check_dtype=False)


def test_one_pair_of_the_traces(single: Path) -> None:
    run = harness.load_run(single)
    expected = run.traces[run.traces["pair"] == 7].reset_index(drop=True)
    assert len(expected) > 100
    assert_frame_equal(run.traces_of(0, 7), expected)


def test_varied_keys_of_a_sweep(swept: Path) -> None:
    run = harness.load_run(swept)
    assert run.varied_keys == ["pedestrians.flow_per_hour", "arms.av"]
    assert list(run.summary["arms.av"]) == ["soft_yield", "constant_speed"] * 2
    assert list(run.summary["pedestrians.flow_per_hour"]) == [300, 300, 900, 900]
    assert list(run.summary["cell"]) == list(run.cells["cell"]) == [0, 1, 2, 3]
    assert run.scenario_of(3).arms.av == "constant_speed"
    with pytest.raises(InputError, match="kept no traces"):
        run.traces_of(0, 0)


def test_text_of_a_varied_key_stays_text(swept: Path, tmp_path: Path) -> None:
    folder = copy(swept, tmp_path)
    document = json.loads((folder / "manifest.json").read_text())
    for cell in document["cells"]:
        cell["model.name"] = "nan"
    (folder / "manifest.json").write_text(json.dumps(document))
    assert list(harness.load_run(folder).summary["model.name"]) == ["nan"] * 4


def test_an_unfinished_run_gives_what_is_finished(unfinished: Path, tmp_path: Path) -> None:
    """The same 8 pairs as a run of their own."""
    whole = simulate(
        one_cell("cctc", {"experiment.pairs": 8}), tmp_path / "eight", Options(traces=True)
    )
    run, expected = harness.load_run(unfinished), harness.load_run(whole)
    assert (run.finished, run.planned_pairs) == (False, 12)
    for name in ("episodes", "pedestrians", "pairs", "traces", "summary", "cells"):
        frame: pd.DataFrame = getattr(run, name)
        assert_frame_equal(frame, getattr(expected, name), check_dtype=False)
    assert_frame_equal(run.traces_of(0, 5), expected.traces_of(0, 5))


def test_an_unfinished_run_is_read_while_another_process_holds_it(unfinished: Path) -> None:
    from harness.store.run_folder import RunFolder

    folder = RunFolder(unfinished)
    try:
        assert len(harness.load_run(unfinished).pairs) == 8
    finally:
        folder.close()


def test_a_damaged_shard_does_not_count(unfinished: Path, tmp_path: Path) -> None:
    folder = copy(unfinished, tmp_path)
    shard = folder / "shards" / "0-4-4.arrows"
    content = bytearray(shard.read_bytes())
    content[len(content) // 2] ^= 1
    shard.write_bytes(bytes(content))
    assert list(harness.load_run(folder).pairs["pair"]) == [0, 1, 2, 3]


def test_a_run_that_was_finished_meanwhile_says_so(unfinished: Path, tmp_path: Path) -> None:
    folder = copy(unfinished, tmp_path)
    run = harness.load_run(folder)
    shutil.rmtree(folder / "shards")
    with pytest.raises(InputError, match="load it again"):
        _ = run.episodes


def test_an_unfinished_run_that_is_open_is_not_compared(unfinished: Path) -> None:
    run = harness.load_run(unfinished)
    for use in (harness.compare, harness.worst):
        with pytest.raises(InputError, match="is not finished; allowed: `harness resume"):
            use(run)


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


SPOILT = {
    "empty folder": (lambda f: [p.unlink() for p in f.iterdir()], "is not a run folder"),
    "file": (lambda f: (shutil.rmtree(f), f.write_text("x")), "is not a run folder"),
    "nothing": (shutil.rmtree, "is not a run folder"),
    "another program's manifest": (
        lambda f: (f / "manifest.json").write_text('{"name": "app"}'),
        "manifest.json: format version None",
    ),
    "no JSON": (lambda f: (f / "manifest.json").write_text("{"), "manifest.json: is damaged"),
    "a list": (
        lambda f: (f / "manifest.json").write_text("[]"),
        "manifest.json: format version None",
    ),
    "old": (
        lambda f: manifest(f, schema=0),
        f"manifest.json: format version 0; allowed: {SCHEMA}: run its scenario again",
    ),
    "counts": (lambda f: manifest(f, counts=[1]), "manifest.json: counts: [1] is not accepted"),
    "scenario": (lambda f: manifest(f, scenario={"ego": {"wheels": 4}}), "ego.wheels"),
    "table missing": (lambda f: (f / "pairs.parquet").unlink(), "pairs.parquet: is missing"),
    "table cut": (lambda f: cut(f / "episodes.parquet"), "episodes.parquet: is damaged"),
    "other table": (
        lambda f: shutil.copy(f / "cells.parquet", f / "pairs.parquet"),
        "pairs.parquet: 1 rows; allowed: 12, as the manifest says",
    ),
}


@pytest.mark.parametrize("case", SPOILT)
def test_what_is_no_run_is_refused(single: Path, tmp_path: Path, case: str) -> None:
    folder = copy(single, tmp_path)
    spoil, words = SPOILT[case]
    spoil(folder)
    with pytest.raises(InputError) as caught:
        harness.load_run(folder)
    assert words in str(caught.value)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("table", "column", "value", "words"),
    [
        ("episodes", "pair", None, "episodes.parquet: pair: is empty in a row"),
        ("episodes", "pair", 5, "pair: rows are not in order"),
        ("episodes", "arm", "human", "arm: does not have both arms of each pair; allowed: av"),
        ("episodes", "ending", "vanished", "ending: 'vanished'; allowed: crossed, crashed"),
        ("episodes", "steps", -1, "steps: -1; allowed: 0 to"),
        ("episodes", "pass_time_s", 0.0, "pass_time_s: 0.0; allowed: 1e-18 to"),
        ("episodes", "min_ttc_s", float("nan"), "min_ttc_s: nan; allowed: -1e+18 to 1e+18"),
        ("traces", "x_m", float("inf"), "x_m: inf; allowed"),
        ("pedestrians", "side", "left", "side: 'left'; allowed: near, far"),
    ],
)
def test_values_that_a_table_never_holds_are_refused(
    single: Path, tmp_path: Path, table: str, column: str, value: object, words: str
) -> None:
    folder = copy(single, tmp_path)
    path = folder / f"{table}.parquet"
    good = pq.read_table(path)
    values = good[column].to_pylist()
    values[0] = value
    number = good.column_names.index(column)
    spoilt = good.set_column(number, column, pa.array(values, good[column].type))
    pq.write_table(spoilt, path)
    with pytest.raises(InputError, match=re.escape(words)):
        getattr(harness.load_run(folder), table)


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


def lacking(table: pa.Table) -> pa.Table:
    return table.drop_columns(["kappa_front"])


def changed(name: str, value: object) -> Callable[[pa.Table], pa.Table]:
    def change(table: pa.Table) -> pa.Table:
        column = pa.array([value] * table.num_rows, table[name].type)
        return table.set_column(table.column_names.index(name), name, column)

    return change


@pytest.mark.parametrize("spoil", [None, lacking])
def test_a_summary_that_lacks_anything_is_worked_out_anew(
    single: Path, tmp_path: Path, spoil: Callable[[pa.Table], pa.Table] | None
) -> None:
    folder = copy(single, tmp_path)
    path = folder / "summary.parquet"
    table = pq.read_table(path)
    path.unlink()
    if spoil is not None:
        pq.write_table(spoil(table), path)
    expected = harness.load_run(single)
    assert harness.load_run(folder).results[0].findings == expected.results[0].findings


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (changed("mu", float("nan")), "mu: is damaged; allowed: a finite number"),
        (changed("kappa_ci_high", float("inf")), "kappa_ci_high: is damaged"),
        (changed("pairs", None), "pairs: is damaged"),
        (changed("cell", 3), "is damaged; allowed: a row for each of 1 cells"),
    ],
)
def test_a_damaged_summary_is_refused(
    single: Path, tmp_path: Path, spoil: Callable[[pa.Table], pa.Table], words: str
) -> None:
    folder = copy(single, tmp_path)
    path = folder / "summary.parquet"
    pq.write_table(spoil(pq.read_table(path)), path)
    with pytest.raises(InputError, match=words):
        _ = harness.load_run(folder).summary
    cut(path)
    with pytest.raises(InputError, match="is damaged"):
        _ = harness.load_run(folder).summary


def test_a_table_without_a_column_that_every_reader_needs_is_refused(
    single: Path, tmp_path: Path
) -> None:
    folder = copy(single, tmp_path)
    path = folder / "episodes.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["stops"]), path)
    with pytest.raises(InputError, match=r"episodes.parquet: lacks stops.*harness score"):
        _ = harness.load_run(folder).episodes


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


def test_results_are_what_the_run_reported(swept: Path, unfinished: Path) -> None:
    """Read back from ``summary.parquet``, as the statistics had it when the run ended."""
    run = harness.load_run(swept)
    assert len(run.results) == 4
    for result in run.results:
        own = pq.read_table(swept / "episodes.parquet", filters=[("cell", "=", result.cell.number)])
        assert result.findings == summarise_cell(own, result.cell, 0.95).findings
    assert any(result.findings["kappa"].events for result in run.results)
    assert harness.load_run(unfinished).results[0].findings["pairs"].value == 8


def test_one_pair_has_a_mean_and_no_spread(tmp_path: Path) -> None:
    run = made_up(tmp_path / "run", one_cell("cctc", {"experiment.pairs": 1}), lambda *_: 9.0)
    findings = reported(harness.load_run(run)).cells[0].findings
    assert findings["mu"].value == pytest.approx(9 / 10)  # the reference takes 10 s
    assert "fewer than two pairs" in str(findings["cv"].reason)
