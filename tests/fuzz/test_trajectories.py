"""Trajectories and tables of rows: whatever is in them, they are read or refused in one line."""

import shutil
from pathlib import Path

import pytest
from hypothesis import example, given, strategies as st

from harness.calibration import make_sample, read_rows
from harness.trajectories import extract
from tests.fuzz.hostile import NAMES, NUMBERS, accepted_or_refused_in_one_line, cut_and_flipped

DATA = Path(__file__).resolve().parents[1] / "data"
ROWS = (DATA / "rows_made_up.csv").read_bytes()
MOBILEYE = (DATA / "mobileye_made_up.csv").read_bytes()
WALKS = Path("trajectories_filtered") / "straight_01_traj_ped_filtered.csv"
VCI = (DATA / "vci_made_up" / WALKS).read_bytes()

CELLS = st.one_of(NUMBERS.map(str), NAMES, st.just(""))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set in DUT's form, of which one file is replaced again and again."""
    folder = tmp_path_factory.mktemp("trajectories")
    shutil.copytree(DATA / "vci_made_up", folder / "set")
    return folder


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


def used(path: Path, form: str) -> None:
    """What `harness extract` and, after it, `harness fit` do with a file before any fit."""
    extraction = extract([path], form)
    if len(extraction.rows):
        make_sample(extraction.rows, weigh="row")


@given(hostile(ROWS))
def test_tables(folder: Path, content: bytes) -> None:
    path = folder / "rows.csv"
    path.write_bytes(content)
    accepted_or_refused_in_one_line(lambda: used(path, "table"))
    accepted_or_refused_in_one_line(lambda: read_rows(path))


@given(hostile(MOBILEYE))
@example(MOBILEYE.replace(b"41.0", b"1" + b"0" * 400))
def test_mobileye(folder: Path, content: bytes) -> None:
    path = folder / "mobileye.csv"
    path.write_bytes(content)
    accepted_or_refused_in_one_line(lambda: used(path, "mobileye"))


@given(hostile(VCI))
def test_vci(folder: Path, content: bytes) -> None:
    (folder / "set" / WALKS).write_bytes(content)
    accepted_or_refused_in_one_line(lambda: used(folder / "set", "vci"))


@given(st.binary(max_size=200), st.sampled_from(["rows.parquet", "rows.csv", "rows.txt"]))
def test_any_bytes(folder: Path, content: bytes, name: str) -> None:
    path = folder / name
    path.write_bytes(content)
    for form in ("table", "mobileye", "vci"):
        accepted_or_refused_in_one_line(lambda form=form: used(path, form))
    accepted_or_refused_in_one_line(lambda: read_rows(path))


@given(NAMES)
def test_any_path(folder: Path, name: str) -> None:
    for form in ("table", "mobileye", "vci"):
        accepted_or_refused_in_one_line(lambda form=form: used(folder / name, form))
