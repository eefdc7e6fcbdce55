"""What every trajectory format of ``FORMATS`` must keep to, whichever it is.

``tests/data/encounter/<format>/`` shows the same encounter in each format, in its own units, axes
and clock: s seconds after its first record one vehicle's front bumper is 41 m − 5 m/s · s before
the line of one pedestrian's way, they are 6 m − 1.2 m/s · s before the line of its way, at a right
angle, seen at least until s = 4.6.
"""

import math
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st

from harness.core.errors import InputError
from harness.model.trajectories.extraction import Extraction, extract, read_clips
from harness.model.trajectories.formats import FORMATS
from harness.model.trajectories.rules import ROW_COLUMNS, Tally
from tests.fuzz.hostile import accepted_or_refused_in_one_line, cut_and_flipped
from tests.scenes import refusal_of

ENCOUNTER = Path(__file__).parents[1] / "data" / "encounter"
DOCS = Path(__file__).parents[2] / "docs" / "model.md"
# Records have at most nine decimals, degrees of longitude 1e-14 of one: about 1e-9 m.
EXACT = 5e-8

every_format = pytest.mark.parametrize("form", FORMATS)
with_tracks = pytest.mark.parametrize("form", [name for name in FORMATS if FORMATS[name].clips])


def files_of(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


@pytest.fixture
def folder(form: str, tmp_path: Path) -> Path:
    """A copy of the format's example, to be spoilt."""
    return Path(shutil.copytree(ENCOUNTER / form, tmp_path / form))


def is_the_encounter(rows: pd.DataFrame) -> None:
    """Whether every row lies on the two lines; v, v_p and T_adv do not change on them."""
    seconds = (41 - rows["range_m"]) / 5
    expected: dict = {
        "lateral_m": 6 - 1.2 * seconds,
        "vehicle_speed_mps": 5.0,
        "pedestrian_speed_mps": 1.2,
        "arrival_time_s": 8.2 - seconds,
        "time_advantage_s": 8.2 - 5.0,
    }
    for name, values in expected.items():
        np.testing.assert_allclose(rows[name], values, rtol=0, atol=EXACT, err_msg=name)


def test_every_format_shows_the_encounter_and_nothing_else_does() -> None:
    assert {path.name for path in ENCOUNTER.iterdir()} == set(FORMATS)


@every_format
def test_is_documented(form: str) -> None:
    assert f"--format {form}`" in DOCS.read_text(encoding="utf-8")


@every_format
def test_the_encounter_comes_out_as_it_was_and_counts_add_up(form) -> None:
    found = extract(ENCOUNTER / form, form)
    rows = found.rows
    assert tuple(rows.columns) == ROW_COLUMNS
    is_the_encounter(rows)
    seconds = rows["time_s"] - rows["time_s"].iloc[0]
    np.testing.assert_allclose(rows["range_m"], 41 - 5 * seconds, rtol=0, atol=EXACT)
    # Five rows a second from the first record on, as long as L is at least 0.3 m.
    np.testing.assert_allclose(seconds, np.arange(24) / 5, rtol=0, atol=1e-9)
    np.testing.assert_allclose(rows["crossing_angle_deg"].dropna(), 90.0, atol=1e-6)
    assert set(rows["passed_first"].dropna()) <= {"pedestrian"}
    assert (found.counts.vehicles, found.counts.pairs) == (1, 1)
    dropped = found.counts.dropped["candidates"]
    assert found.counts.rows + sum(dropped.values()) == found.counts.candidates
    assert found.counts.rows == len(found.rows)


@every_format
def test_the_order_of_records_means_nothing(form: str, folder: Path) -> None:
    for file in folder.rglob("*.csv"):
        heading, *records = file.read_text(encoding="utf-8").splitlines()
        file.write_text("\n".join([heading, *reversed(records)]) + "\n", encoding="utf-8")
    turned, rows = extract(folder, form).rows, extract(ENCOUNTER / form, form).rows
    turned = turned.sort_values("time_s", ignore_index=True)
    pd.testing.assert_frame_equal(turned, rows, rtol=0, atol=EXACT)


@every_format
def test_options_are_checked(form: str) -> None:
    options = FORMATS[form].options
    assert options() == options()
    for name, field in options.model_fields.items():
        with pytest.raises(InputError, match=name):
            extract(ENCOUNTER / form, form, **{f"{name}x": 1.0})
        for value in (math.nan, math.inf, "far") if field.annotation is float else ():
            with pytest.raises(InputError, match=name):
                extract(ENCOUNTER / form, form, **{name: value})


@every_format
def test_what_is_not_there_is_refused(form: str, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "nothing").mkdir()
    for path in (tmp_path / "nothing", tmp_path / "nowhere"):
        refusal_of(lambda path=path: extract(path, form), str(path))
    for file in files_of(folder):
        file.write_bytes(b"")
    assert not accepted_or_refused_in_one_line(lambda: extract(folder, form))


def columns_of(folder: Path) -> Iterator[tuple[Path, str]]:
    for file in sorted(folder.rglob("*.csv")):
        for column in file.read_text(encoding="utf-8").splitlines()[0].split(","):
            yield file, column


def extracted_or_refused(folder: Path, form: str) -> Extraction | str:
    """An extraction, or the one line with which it is refused."""
    try:
        return extract(folder, form)
    except InputError as error:
        line = str(error)
        return line if "\n" not in line else pytest.fail(line)


def edited(file: Path, edit: Callable[[pd.DataFrame], pd.DataFrame]) -> str:
    """Edit a CSV file as text; its text before."""
    before = file.read_text(encoding="utf-8")
    edit(pd.read_csv(file, dtype=str)).to_csv(file, index=False)
    return before


@every_format
def test_a_missing_column_is_named_or_not_needed(form: str, folder: Path) -> None:
    refused = 0
    for file, column in columns_of(folder):
        before = edited(file, lambda table, column=column: table.drop(columns=column))
        found = extracted_or_refused(folder, form)
        if isinstance(found, Extraction):
            is_the_encounter(found.rows)
        else:
            refused += 1
            assert file.name in found
            assert column in found
        file.write_text(before, encoding="utf-8")
    assert refused > 0 or not list(folder.rglob("*.csv"))


@every_format
@pytest.mark.parametrize("cell", ["", "nan", "inf", "fast", "1e200", "1" + "0" * 400])
def test_an_unusable_cell_spoils_nothing_but_its_record(form: str, folder: Path, cell: str) -> None:
    clean = extract(folder, form).counts
    for file, column in columns_of(folder):
        before = edited(file, lambda table, column=column: spoilt(table, column, cell))
        found = extracted_or_refused(folder, form)
        if isinstance(found, Extraction):
            is_the_encounter(found.rows)
        # Of a file with a line for each object or recording, that may have been the one needed.
        if len(before.splitlines()) > 3:
            assert isinstance(found, Extraction), found
            assert found.counts.rows >= clean.rows - 2
        file.write_text(before, encoding="utf-8")


def spoilt(table: pd.DataFrame, column: str, cell: str) -> pd.DataFrame:
    table.loc[len(table) // 2, column] = cell
    return table


@every_format
@settings(max_examples=60)
@given(data=st.data())
def test_whatever_bytes_are_in_a_file(form, tmp_path_factory, data) -> None:
    file = data.draw(st.sampled_from(files_of(ENCOUNTER / form)))
    content = data.draw(cut_and_flipped(file.read_bytes()))
    folder = Path(shutil.copytree(ENCOUNTER / form, tmp_path_factory.mktemp("spoilt") / form))
    (folder / file.relative_to(ENCOUNTER / form)).write_bytes(content)
    accepted_or_refused_in_one_line(lambda: extract(folder, form))


@with_tracks
def test_tracks_are_whole(form: str) -> None:
    (clip,) = read_clips(ENCOUNTER / form, form, Tally())
    assert clip.source
    assert clip.name
    for track in (*clip.vehicles.values(), *clip.pedestrians.values()):
        assert track.position_m.shape == (len(track.time_s), 2)
        assert (np.diff(track.time_s) > 0).all()
    for vehicle in clip.vehicles.values():
        assert 0 <= vehicle.front_offset_m <= vehicle.length_m
        assert vehicle.length_m > 0


@pytest.mark.parametrize("form", [name for name in FORMATS if not FORMATS[name].clips])
def test_rows_have_no_tracks(form: str) -> None:
    with pytest.raises(InputError, match="has rows, not tracks"):
        read_clips(ENCOUNTER / form, form, Tally())
