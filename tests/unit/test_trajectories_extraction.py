"""Extraction from made-up clips whose R, L, v, v_p and T_adv are known by construction."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st

from harness.model.trajectories.extraction import extract
from harness.model.trajectories.rules import ROW_COLUMNS

MADE_UP = Path(__file__).parents[1] / "data" / "vci_made_up"
RATE = 4.0  # frames per second of the made-up clip, frames 0–32


@pytest.fixture(scope="module")
def made_up():
    return extract(MADE_UP, "vci", frame_rate_hz=RATE)


def write_clip(folder, vehicles, pedestrians, name="clip"):
    """A clip of id → (frames, x, y) in the format's files; returns the folder."""
    target = folder / "trajectories_filtered"
    target.mkdir(exist_ok=True)
    for kind, tracks in (("veh", vehicles), ("ped", pedestrians)):
        lines = ["id,frame,label,x_est,y_est"]
        for key, (frames, x, y) in tracks.items():
            lines += [
                f"{key},{f},{kind},{a!r},{b!r}"
                for f, a, b in zip(frames, map(float, x), map(float, y), strict=True)
            ]
        (target / f"{name}_traj_{kind}_filtered.csv").write_text("\n".join(lines) + "\n")
    return folder


def made_of(folder, vehicles, pedestrians, **options):
    """The extraction from a clip at 10 Hz."""
    return extract(write_clip(folder, vehicles, pedestrians), "vci", frame_rate_hz=10.0, **options)


def test_straight_constant_speed_pair_comes_out_exactly(made_up):
    # Vehicle centre at x = −20 + 4 t on y = 0, 4 m long: front bumper at −18 + 4 t. Pedestrian 0 at
    # x = 0, y = −8 + 1.25 t. They cross at (0, 0): R = 18 − 4 t, L = 8 − 1.25 t, v = 4, v_p = 1.25,
    # R/v = 4.5 − t, L/v_p = 6.4 − t, T_adv = 1.9. R ≥ 0.5 up to t = 4.375: 22 instants 0 … 4.2.
    rows = made_up.rows[made_up.rows["pedestrian"] == "0"]
    t = np.arange(22) * 0.2
    expected: dict = {
        "time_s": t,
        "range_m": 18 - 4 * t,
        "lateral_m": 8 - 1.25 * t,
        "vehicle_speed_mps": 4.0,
        "pedestrian_speed_mps": 1.25,
        "arrival_time_s": 4.5 - t,
        "time_advantage_s": 1.9,
        "crossing_angle_deg": 90.0,
        # Front at 4.5 s, rear at 5.5 s, pedestrian at 6.4 s: 0.9 s between the two.
        "pet_s": 0.9,
    }
    assert len(rows) == 22
    for name, values in expected.items():
        np.testing.assert_allclose(rows[name], values, rtol=0, atol=1e-9, err_msg=name)
    assert set(rows["passed_first"]) == {"vehicle"}


def test_oblique_pedestrian_has_distance_from_the_line_not_along_their_way(made_up):
    # Pedestrian 1 walks 1.5 m/s along (−1/2, −√3/2) and reaches (4, 0) at t = 2: the angle to the
    # vehicle's (1, 0) is acos(−1/2) = 120°, L = 1.5 · √3/2 · (2 − t), R = 22 − 4 t. L ≥ 0.3 needs
    # t ≤ 2 − 0.3/1.299 = 1.769: instants 0 … 1.6. They pass at 2 s, the front bumper at 5.5 s.
    rows = made_up.rows[made_up.rows["pedestrian"] == "1"]
    t = np.arange(9) * 0.2
    across = 1.5 * math.sqrt(3) / 2
    assert len(rows) == 9
    np.testing.assert_allclose(rows["range_m"], 22 - 4 * t, atol=1e-9)
    np.testing.assert_allclose(rows["lateral_m"], across * (2 - t), atol=1e-9)
    np.testing.assert_allclose(rows["pedestrian_speed_mps"], across, atol=1e-9)
    np.testing.assert_allclose(rows["time_advantage_s"], 3.5, atol=1e-9)
    np.testing.assert_allclose(rows["crossing_angle_deg"], 120.0, atol=1e-9)
    np.testing.assert_allclose(rows["pet_s"], 3.5, atol=1e-9)
    assert set(rows["passed_first"]) == {"pedestrian"}


def test_the_same_input_gives_the_documented_columns_and_order(made_up):
    assert tuple(made_up.rows.columns) == ROW_COLUMNS
    assert set(made_up.rows["source"]) == {"vci_made_up"}
    key = made_up.rows[["clip", "vehicle", "pedestrian", "time_s"]]
    pd.testing.assert_frame_equal(key, key.sort_values(list(key.columns)))


def test_range_is_path_length_on_a_bend(tmp_path):
    # Vehicle on a circle of radius 12 m about the origin, 3 m/s from angle −60°; pedestrian walks
    # outwards along the x axis, 1 m/s from x = 4: conflict at (12, 0), angle 90°. Path length of
    # the centre to it: 12 · π/3 − 3 t; half of 4 m less to the bumper. Corners 0.5 m apart shorten
    # an arc by (0.5/12)²/24 = 7e-5 of its length; the chord to the next corner adds a few mm.
    frames = np.arange(0, 100)
    t = frames / 10
    angle = -math.pi / 3 + 3 * t / 12
    car = {1: (frames, 12 * np.cos(angle), 12 * np.sin(angle))}
    walker = {1: (frames, 4 + t, 0 * t)}
    rows = made_of(tmp_path, car, walker, vehicle_length_m=4.0).rows
    expected = 12 * math.pi / 3 - 3 * rows["time_s"] - 2
    assert len(rows) == 17  # R ≥ 0.5 up to t = (12.566 − 2.5) / 3 = 3.355
    np.testing.assert_allclose(rows["range_m"], expected, atol=0.02)
    np.testing.assert_allclose(rows["lateral_m"], 8 - rows["time_s"], atol=0.02)
    np.testing.assert_allclose(rows["vehicle_speed_mps"], 3.0, atol=0.05)
    np.testing.assert_allclose(rows["crossing_angle_deg"], 90.0, atol=2.0)


@settings(max_examples=20)
@given(st.floats(-math.pi, math.pi), st.floats(-900, 900), st.floats(-900, 900))
def test_rows_are_the_same_on_other_axes(tmp_path_factory, angle, east_m, north_m):
    frames = np.arange(81)
    places = np.array([-30 + (0.45 + 0.02j) * frames, 0.1 - 8j + 0.14j * frames])

    def rows(places):
        car, walker = ({1: (frames, of.real, of.imag)} for of in places)
        return made_of(tmp_path_factory.mktemp("axes"), car, walker).rows.select_dtypes(float)

    plain, moved = rows(places), rows(np.exp(1j * angle) * places + complex(east_m, north_m))
    pd.testing.assert_frame_equal(plain, moved, rtol=1e-6)
    assert len(plain) > 20


@pytest.mark.parametrize(
    ("last_x", "last_y", "pairs"),
    # The paths cross at (0, 0): a vehicle's goes on for 12 m, a pedestrian's for 3 m.
    [(-13.9, 5, 0), (-12.1, 5, 0), (-11.9, 5, 1), (-6.0, 5, 1), (5, -3.1, 0), (5, -2.9, 1)],
)
def test_paths_go_on_for_twelve_and_for_three_metres(tmp_path, last_x, last_y, pairs):
    frames = np.arange(0, 81)
    x, y = np.linspace(-30, last_x, 81), np.linspace(-12, last_y, 81)
    found = made_of(tmp_path, {1: (frames, x, 0 * x)}, {1: (frames, 0 * x, y)})
    assert found.counts.pairs == pairs


@pytest.mark.parametrize(
    ("option", "reason"),
    [
        ({"min_range_m": 10}, "min_range_m"),
        ({"max_range_m": 10}, "max_range_m"),
        ({"min_lateral_m": 5}, "min_lateral_m"),
        ({"max_lateral_m": 5}, "max_lateral_m"),
        ({"min_vehicle_speed_mps": 4.01}, "min_vehicle_speed_mps"),
        ({"min_pedestrian_speed_mps": 1.26}, "min_pedestrian_speed_mps"),
        ({"min_time_advantage_s": 2.0}, "min_time_advantage_s"),
    ],
)
def test_each_row_rule_drops_and_counts(made_up, option, reason):
    strict = extract(MADE_UP, "vci", frame_rate_hz=RATE, **option)
    dropped, before = (found.counts.dropped["candidates"] for found in (strict, made_up))
    assert dropped[reason] > before[reason]
    assert strict.counts.rows < made_up.counts.rows
    assert strict.counts.rows + sum(dropped.values()) == strict.counts.candidates
