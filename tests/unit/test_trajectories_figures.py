"""Figures of the made-up clip: what is drawn, in which units, with which numbers."""

from pathlib import Path

import numpy as np
import pytest

from harness.model.trajectories import read_clips

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")

from matplotlib.figure import Figure  # noqa: E402

from harness.old.report.drawing.trajectory_figures import draw_map, draw_passing_event  # noqa: E402

DATA = Path(__file__).parents[1] / "data"


@pytest.fixture
def axes():
    return Figure(figsize=(6, 5)).add_subplot()


@pytest.fixture(scope="module")
def clip():
    return read_clips(DATA / "vci_made_up", "vci", frame_rate_hz=4.0)[0]


def test_map_shows_all_tracks_with_units_and_numbers(axes, clip):
    draw_map(axes, [clip])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (m)", "y (m)")
    assert axes.get_aspect() == 1.0
    # 8 s at 0.2 s are 41 positions for each of 4 pedestrians.
    title, numbers = axes.get_title(loc="left").splitlines()
    assert title == "Vehicle routes and pedestrian positions"
    assert numbers == "n = 2 vehicles, 4 pedestrians, 164 positions, 1 clip"
    assert axes.yaxis_inverted()  # image axes
    low, high = axes.get_xlim()
    assert low < -20
    assert high > 12  # the whole route
    axes.figure.draw_without_rendering()


def test_map_of_nothing_is_an_empty_map(axes):
    draw_map(axes, [])
    assert "n = 0 vehicles, 0 pedestrians, 0 positions, 0 clips" in axes.get_title(loc="left")


def test_passing_event_is_coloured_by_the_time_in_common(axes, clip):
    marks = draw_passing_event(axes, clip, "0", "1")
    assert marks.get_clim() == (0.0, 8.0)
    np.testing.assert_allclose(marks.get_array(), np.arange(41) * 0.2, atol=1e-9)
    # Vehicle 0 is at x = −20 + 4 t.
    np.testing.assert_allclose(marks.get_offsets()[:, 0], -20 + 0.8 * np.arange(41), atol=1e-9)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["vehicle (centre), n = 41", "pedestrian, n = 41", "conflict point"]
    cross = next(line for line in axes.lines if line.get_marker() == "x")
    np.testing.assert_allclose(cross.get_xydata(), [[4, 0]], atol=1e-9)
    assert axes.figure.axes[-1].get_ylabel() == "time since both were in view (s)"
    axes.figure.draw_without_rendering()


def test_sensor_events_can_be_drawn_too(axes):
    trip = read_clips(DATA / "mobileye_made_up.csv", "mobileye")[0]
    draw_passing_event(axes, trip, "17101", "7-1")
    assert not axes.yaxis_inverted()
