"""Trajectories and tables of rows: whatever is in them, they are read or refused in one line."""

import os
import shutil
from collections.abc import Iterator
from datetime import timedelta
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given, strategies as st

from harness.trajectories import FORMATS
from tests.fuzz.command import done_or_refused, in_this_process
from tests.fuzz.hostile import NAMES, NUMBERS, cases, cut_and_flipped
from tests.fuzz.tables import hostile_table, written

DATA = Path(__file__).resolve().parents[1] / "data"
ROWS = (DATA / "rows_made_up.csv").read_bytes()
MOBILEYE = (DATA / "mobileye_made_up.csv").read_bytes()
WALKS = Path("trajectories_filtered") / "straight_01_traj_ped_filtered.csv"
CARS = Path("trajectories_filtered") / "straight_01_traj_veh_filtered.csv"
PIXELS = Path("trajectories") / "straight_01_traj_veh.csv"
RATIO = Path("ratios") / "straight_01_ratio_pixel2meter.txt"
VCI = {name: (DATA / "vci_made_up" / name).read_bytes() for name in (WALKS, CARS, PIXELS, RATIO)}


def fittable() -> pa.Table:
    """As few rows as one component can be fitted to."""
    rng, count = np.random.default_rng(1), 24
    columns = {
        "source": ["made up"] * count,
        "clip": ["one"] * count,
        "vehicle": [str(row // 6) for row in range(count)],
        "pedestrian": [str(row // 3) for row in range(count)],
        "time_s": np.arange(count) / 10,
        "range_m": rng.uniform(5, 50, count),
        "vehicle_speed_mps": rng.uniform(1, 7, count),
        "pedestrian_speed_mps": rng.uniform(0.8, 2, count),
        "time_advantage_s": rng.uniform(1, 9, count),
        "weight": rng.uniform(1, 2, count),
        "passed_first": ["vehicle", "pedestrian"] * (count // 2),
    }
    return pa.table(columns)


TABLE = fittable()
FITTABLE = TABLE.to_pandas().to_csv(index=False).encode()

FORMS = list(FORMATS)
ENCOUNTER = {
    path.relative_to(DATA / "encounter"): path.read_bytes()
    for path in sorted((DATA / "encounter").rglob("*"))
    if path.is_file()
}
"""What every format has to show (tests/conformance/test_readers.py), by format and file."""

QUICK_FIT = ("--components", "1", "--starts", "1", "--folds", "0", "--workers", "1")

CELLS = st.one_of(NUMBERS.map(str), NAMES, st.just(""))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where the commands are given; ``set`` is a set in DUT's form, to be spoilt file by file."""
    folder = tmp_path_factory.mktemp("trajectories")
    shutil.copytree(DATA / "vci_made_up", folder / "set")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        in_this_process(patch)
        yield folder


def changed_cells(content: bytes) -> st.SearchStrategy[bytes]:
    """A CSV file with some of its cells replaced."""
    lines = [line.split(",") for line in content.decode().splitlines()]

    def change(places: list[tuple[int, int, str]]) -> bytes:
        changed = [list(line) for line in lines]
        for row, column, text in places:
            line = changed[row % len(changed)]
            line[column % len(line)] = text
        return "\n".join(",".join(line) for line in changed).encode("utf-8", "replace")

    place = st.tuples(st.integers(0, 10_000), st.integers(0, 50), CELLS)
    return st.builds(change, st.lists(place, min_size=1, max_size=5))


def hostile(content: bytes) -> st.SearchStrategy[bytes]:
    return st.one_of(cut_and_flipped(content), changed_cells(content))


def emptied(folder: Path) -> Path:
    """A folder without anything in it."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    return folder


def used(folder: Path, path: Path, form: str, *more: str) -> None:
    """Extract the rows of a file, and fit one component to what came of it."""
    out = emptied(folder / "out")
    rows = out / "rows.parquet"
    if done_or_refused("extract", path, "--format", form, "--out", rows, *more, inside=out):
        fitted(rows)
    else:
        assert not any(out.iterdir())


def fitted(rows: Path) -> None:
    """Fit one component to a file of rows, as they are read by `harness fit`."""
    model = emptied(rows.parent / "fitted") / "model.json"
    if done_or_refused("fit", rows, "--out", model, *QUICK_FIT, inside=model.parent):
        assert done_or_refused("model", "show", model, inside=model.parent)


@cases("trajectories", 2_000)
@given(hostile(ROWS))
def test_tables(folder: Path, content: bytes) -> None:
    path = folder / "rows.csv"
    path.write_bytes(content)
    used(folder, path, "table")


@cases("trajectories", 1_000)
@given(hostile(FITTABLE))
def test_rows_to_be_fitted(folder: Path, content: bytes) -> None:
    (folder / "rows.csv").write_bytes(content)
    fitted(folder / "rows.csv")


@cases("trajectories", 2_000)
@given(hostile_table(TABLE), st.booleans())
def test_parquet_tables(folder: Path, table: pa.Table, extracted: bool) -> None:
    path = folder / "rows.parquet"
    if not written(table, path):
        return
    if extracted:
        used(folder, path, "table")
    else:
        fitted(path)


@cases("trajectories", 1_200)
@given(hostile(MOBILEYE))
@example(MOBILEYE.replace(b"41.0", b"1" + b"0" * 400))
def test_mobileye(folder: Path, content: bytes) -> None:
    path = folder / "mobileye.csv"
    path.write_bytes(content)
    used(folder, path, "mobileye")


@cases("trajectories", 1_200)
@given(
    st.one_of([st.tuples(st.just(name), hostile(content)) for name, content in VCI.items()]),
)
def test_vci(folder: Path, spoilt: tuple[Path, bytes]) -> None:
    name, content = spoilt
    (folder / "set" / name).write_bytes(content)
    used(folder, folder / "set", "vci")
    (folder / "set" / name).write_bytes(VCI[name])


@cases("trajectories", 1_200)
@given(
    st.one_of([st.tuples(st.just(name), hostile(content)) for name, content in ENCOUNTER.items()]),
)
def test_every_format(folder: Path, spoilt: tuple[Path, bytes]) -> None:
    name, content = spoilt
    form = name.parts[0]
    shutil.copytree(DATA / "encounter" / form, emptied(folder / "shown") / form)
    (folder / "shown" / name).write_bytes(content)
    used(folder, folder / "shown" / form, form)


@cases("trajectories", 30)
@given(hostile(VCI[CARS]), hostile(MOBILEYE))
def test_figures(folder: Path, cars: bytes, mobileye: bytes) -> None:
    (folder / "set" / CARS).write_bytes(cars)
    (folder / "mobileye.csv").write_bytes(mobileye)
    used(folder, folder / "set", "vci", "--plots", str(folder / "out" / "figures"))
    used(folder, folder / "mobileye.csv", "mobileye", "--plots", str(folder / "out" / "figures"))
    (folder / "set" / CARS).write_bytes(VCI[CARS])


@cases("trajectories", 30)
@given(NAMES.filter(lambda name: "/" not in name))
@example("$\\frac{$")
@example("../../x")
def test_any_name_of_a_clip(folder: Path, name: str) -> None:
    """It is in titles and file names of figures, and in the rows."""
    named = folder / "named"
    try:
        for path, content in VCI.items():
            part = named / path.parent / "inner" / path.name.replace("straight", name or "x")
            part.parent.mkdir(parents=True, exist_ok=True)
            part.write_bytes(content)
    except (OSError, ValueError):
        pass  # no file can have that name
    else:
        used(folder, named, "vci", "--plots", str(folder / "out" / "figures"))
    shutil.rmtree(named, ignore_errors=True)


@cases("trajectories", 2_500)
@given(
    st.one_of(st.binary(max_size=200), st.text(max_size=200).map(str.encode)),
    st.sampled_from(["rows.parquet", "rows.csv", "rows.txt", "x_traj_veh_filtered.csv"]),
    st.sampled_from(FORMS),
)
def test_any_bytes(folder: Path, content: bytes, name: str, form: str) -> None:
    (folder / name).write_bytes(content)
    used(folder, folder / name, form)
    fitted(folder / name)


@cases("trajectories", 300)
@given(NAMES, st.sampled_from(FORMS))
def test_any_path(folder: Path, name: str, form: str) -> None:
    used(folder, folder / name, form)


UNUSUAL: dict[str, bytes] = {
    "empty": b"",
    "heading alone": ROWS.splitlines(keepends=True)[0],
    "NUL": ROWS.replace(b",", b"\x00", 3),
    "UTF-16": ROWS.decode().encode("utf-16"),
    "latin-1": ROWS + "\u00e9".encode("latin-1"),
    "column twice": ROWS.replace(b"vehicle_speed_mps", b"range_m", 1),
    "one quote": b'"' + ROWS,
    "long line": ROWS + b"1," * 100_000,
    "huge numbers": ROWS.replace(b"1", b"1" + b"0" * 400),
    "a number in words": ROWS.replace(b"1", b"one"),
}


@pytest.mark.parametrize("name", UNUSUAL)
@pytest.mark.parametrize("form", FORMS)
def test_unusual_files(folder: Path, name: str, form: str) -> None:
    (folder / "rows.csv").write_bytes(UNUSUAL[name])
    used(folder, folder / "rows.csv", form)
    fitted(folder / "rows.csv")


ODD_COLUMNS: dict[str, Any] = {
    "nested": [[1.0]],
    "struct": [{"a": 1.0}],
    "binary": [b"\xff"],
    "decimal": [Decimal("1.5")],
    "duration": [timedelta(seconds=1)],
    "bool": [True],
    "text": ["1e400"],
    "huge": [2**63 - 1],
    "null": [None],
    "infinite": [np.inf],
}


@pytest.mark.parametrize("kind", ODD_COLUMNS)
@pytest.mark.parametrize("column", ["range_m", "vehicle", "source", "weight", "passed_first"])
def test_columns_of_odd_types(folder: Path, kind: str, column: str) -> None:
    values = pa.array(ODD_COLUMNS[kind] * TABLE.num_rows)
    table = TABLE.drop_columns([column] if column in TABLE.column_names else [])
    assert written(table.append_column(column, values), folder / "rows.parquet")
    used(folder, folder / "rows.parquet", "table")
    fitted(folder / "rows.parquet")


def test_what_an_extraction_left_in_a_file_may_be_anything(folder: Path) -> None:
    """Its words go into the model's card."""
    for text in (
        "[" * 50_000,
        '{"command": "\\u001b[2J"}',
        '{"counts": ' + "[" * 300 + "]" * 300 + "}",
    ):
        metadata = {b"harness.extraction": text.encode()}
        pq.write_table(TABLE.replace_schema_metadata(metadata), folder / "rows.parquet")
        fitted(folder / "rows.parquet")


def test_the_rows_to_be_spoilt_are_good(folder: Path) -> None:
    (folder / "rows.csv").write_bytes(FITTABLE)
    out = emptied(folder / "out")
    assert done_or_refused(
        "fit", "rows.csv", "--out", out / "model.json", *QUICK_FIT, inside=out, codes=(0,)
    )


def test_what_is_no_regular_file_is_refused(folder: Path) -> None:
    out = emptied(folder / "out")
    (folder / "folder.csv").mkdir()
    (folder / "loop.csv").symlink_to("loop.csv")
    os.mkfifo(folder / "pipe.csv")
    for name in ("folder.csv", "loop.csv", "pipe.csv", "/dev/zero", "x" * 5000 + ".csv"):
        assert not done_or_refused("fit", name, "--out", out / "model.json", inside=out)
