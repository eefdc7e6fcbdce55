"""Readers: what the formats mean, and everything awkward in a file."""

import math
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.model.trajectories.extraction import extract, read_clips
from harness.model.trajectories.rules import Tally
from tests.scenes import refuses

DATA = Path(__file__).parents[1] / "data"
MADE_UP = DATA / "vci_made_up"
RATE = 4.0
STEM = "straight_01"
HEAD = "Device,Trip,Time,ObstacleId,Range,Transversal,Speed,GpsHeading,Longitude,Latitude\n"


@pytest.fixture
def clip(tmp_path):
    """A writable copy of the made-up clip."""
    return Path(shutil.copytree(MADE_UP, tmp_path / "vci_made_up"))


def filtered(folder, kind):
    return folder / "trajectories_filtered" / f"{STEM}_traj_{kind}_filtered.csv"


def rows_of(folder, **options):
    return extract(folder, "vci", frame_rate_hz=RATE, **options)


def test_vci_lengths_come_from_corner_points_and_ratio():
    # Corners 2 m before and behind the centre, 20 pixels per metre: 4 m; the centre is recorded.
    track = read_clips(MADE_UP, "vci", Tally(), frame_rate_hz=RATE)[0].vehicles["0"]
    assert track.length_m == pytest.approx(4.0, abs=1e-12)
    assert track.front_offset_m == pytest.approx(2.0, abs=1e-12)
    np.testing.assert_allclose(track.time_s, np.arange(33) / 4)


@pytest.mark.parametrize("folder", ["trajectories", "ratios"])
def test_vci_without_corners_or_ratio_takes_the_length_from_the_options(clip, folder):
    shutil.rmtree(clip / folder)
    found = rows_of(clip, vehicle_length_m=5.0)
    assert any("5 m for 2 without corners" in note for note in found.counts.notes)
    first = found.rows[found.rows["pedestrian"] == "0"].iloc[0]
    assert first["range_m"] == pytest.approx(20 - 2.5)  # centre at −20, half of 5 m
    assert read_clips(clip, "vci", Tally())[0].vehicles["0"].length_m == 4.5


def test_vci_unfiltered_pedestrians_in_pixels_stand_in_for_filtered_ones(clip):
    table = pd.read_csv(filtered(clip, "ped"))
    pixels = pd.DataFrame(
        {"id": table["id"], "x": table["x_est"] * 20, "y": table["y_est"] * 20,
         "frame": table["frame"], "label": "ped"}
    )  # fmt: skip
    pixels.to_csv(clip / "trajectories" / f"{STEM}_traj_ped.csv", index=False)
    filtered(clip, "ped").unlink()
    found = rows_of(clip)
    number = list(found.rows.select_dtypes("float").columns)
    np.testing.assert_allclose(found.rows[number], rows_of(MADE_UP).rows[number], atol=1e-9)
    assert any("unfiltered" in note for note in found.counts.notes)


def test_vci_clip_without_pedestrians_is_skipped_with_its_reason(clip):
    for path in list(clip.rglob(f"{STEM}*")):
        shutil.copy(path, path.with_name(path.name.replace("01", "02")))
    filtered(clip, "ped").with_name("straight_02_traj_ped_filtered.csv").unlink()
    found = rows_of(clip)
    assert found.counts.clips == 1
    assert list(found.counts.skipped) == ["straight_02"]
    assert "missing" in found.counts.skipped["straight_02"]
    pd.testing.assert_frame_equal(found.rows, rows_of(MADE_UP).rows)


@pytest.mark.parametrize("text", ["", "many", "0", "-3", "nan"])
def test_vci_bad_ratio_is_refused(clip, text):
    (clip / "ratios" / f"{STEM}_ratio_pixel2meter.txt").write_text(text)
    refuses("pixels per metre", lambda: rows_of(clip))


def test_mobileye_leaves_out_buses_of_the_other_way_and_short_sequences():
    found = extract(DATA / "mobileye_made_up.csv", "mobileye")
    names = found.rows[["source", "clip", "vehicle", "pedestrian"]].drop_duplicates()
    assert names.to_numpy().tolist() == [["mobileye_made_up", "17101-4", "17101", "7-1"]]
    # 4 s of records of a pedestrian whose line the bus has not reached then.
    assert len(found.rows) == 21
    assert found.rows["passed_first"].isna().all()
    assert found.counts.dropped["records"]["bus_heading_other_way"] == 6
    assert found.counts.dropped["tracks"]["sequence_too_short"] == 1


def sensor_lines(times, obstacle=1):
    # Bus standing 10 m before the origin, pedestrian 10 m ahead at 1 m/s from 5 m on the left.
    half = 10 / (6_371_000 * math.pi / 180)
    lat = 42.278414 - half * math.cos(math.radians(316.5))
    lon = -83.735580 - half * math.sin(math.radians(316.5)) / math.cos(math.radians(42.278414))
    return [
        f"1,1,{round(100 * t)},{obstacle},10,{5 - (t - times[0])},3,316.5,{lon!r},{lat!r}"
        for t in times
    ]


SECOND = np.arange(0, 1.01, 0.1)


@pytest.mark.parametrize(
    ("times", "sequences"),
    # Cut at a pause of more than 2 s, left out below 0.5 s.
    [([*SECOND, *(SECOND + 3.0)], 1), ([*SECOND, *(SECOND + 3.1)], 2), (SECOND[:5], 0),
     (SECOND[:6], 1)],
)  # fmt: skip
def test_mobileye_sequences_end_at_pauses_and_last_half_a_second(tmp_path, times, sequences):
    path = tmp_path / "pause.csv"
    path.write_text(HEAD + "\n".join(sensor_lines(times)) + "\n")
    found = extract(path, "mobileye").rows["pedestrian"].unique()
    assert list(found) == [f"1-{k + 1}" for k in range(sequences)]


def test_mobileye_awkward_records_are_counted(tmp_path):
    lines = sensor_lines(np.arange(0, 2.01, 0.1))
    lines = [*lines[10:], *lines[:10], lines[3], sensor_lines([9.0], obstacle=2)[0]]
    lines += ["1,1,20,1,,1,3,316.5,-83.7,42.2", "1,1,30,1,near,1,3,316.5,-83.7,42.2"]
    path = tmp_path / "awkward.csv"
    path.write_text(HEAD + "\n".join(lines) + "\n")
    counts = extract(path, "mobileye").counts
    records = {reason: n for reason, n in counts.dropped["records"].items() if n}
    assert records == {"missing_value": 1, "not_a_number": 1, "duplicated": 1}
    assert counts.dropped["tracks"]["one_record"] == 1


def test_mobileye_without_a_bus_towards_the_crossing_is_refused(tmp_path):
    path = tmp_path / "bus.csv"
    path.write_text(HEAD + "1,1,1,1,1,1,1,90,1,1\n")
    refuses("no file can be used", lambda: extract(path, "mobileye"))


def test_table_rows_are_taken_bounded_and_counted():
    # Row 1: |20/5 − 3/1.5| = 2; row 2: |3.8 − 1.8| = 2; row 3: |3.8 − 5| = 1.2. Row 4 has neither
    # L nor T_adv, row 5 has R = 80 m, row 6 L = 0.1 m.
    found = extract(DATA / "rows_made_up.csv", "table")
    np.testing.assert_allclose(found.rows["time_advantage_s"], [2, 2, 1.2], atol=1e-12)
    np.testing.assert_allclose(found.rows["arrival_time_s"], [4, 3.8, 3.8], atol=1e-12)
    assert (found.counts.rows, found.counts.pairs, found.counts.vehicles) == (3, 2, 1)
    dropped = {k: n for k, n in found.counts.dropped["candidates"].items() if n}
    assert dropped == {"min_time_advantage_s": 1, "max_range_m": 1, "min_lateral_m": 1}
    assert found.counts.candidates == 6
    assert found.counts.clips == 0
    assert any("weather" in note for note in found.counts.notes)
    assert set(found.rows["source"]) == {"rows_made_up"}


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_table_reads_what_an_extraction_wrote(tmp_path, kind):
    rows = rows_of(MADE_UP).rows
    path = tmp_path / f"rows.{kind}"
    if kind == "csv":
        rows.to_csv(path, index=False)
    else:
        rows.to_parquet(path)
    pd.testing.assert_frame_equal(extract(path, "table").rows, rows, rtol=1e-12)
    pd.testing.assert_frame_equal(extract(tmp_path, "table").rows, rows, rtol=1e-12)


def test_table_refusals(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_text("range_m,vehicle_speed_mps,pedestrian_speed_mps\n1,1,1\n")
    refuses("time_advantage_s", lambda: extract(path, "table"))
    path.write_text("range_m,vehicle_speed_mps,pedestrian_speed_mps,lateral_m\nfar,1,1,1\n")
    refuses(r"range_m.*far", lambda: extract(path, "table"))
    bad = tmp_path / "bad.parquet"
    bad.write_bytes(b"not parquet")
    refuses(r"bad\.parquet", lambda: extract(bad, "table"))
    pd.read_csv(path).assign(range_m=1, source=b"\xff").to_parquet(bad)
    refuses(r"bad\.parquet: column 'source' contains bytes", lambda: extract(bad, "table"))
