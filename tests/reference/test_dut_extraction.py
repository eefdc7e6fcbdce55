"""Extraction of the DUT set against the figures of the project's data page.

The page's figures come from a first extraction made independently of this code: 532 pairs and
9,600 rows from 35 vehicles, quartiles as below. The set is not part of the project.
"""

from pathlib import Path

import numpy as np
import pytest

from harness.model.sample import make_sample
from harness.model.trajectories.extraction import extract

DUT = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "dut"
pytestmark = pytest.mark.skipif(
    not (DUT / "data" / "trajectories_filtered").is_dir(),
    reason="needs the DUT set in ../shared/data/dut beside the repository",
)


@pytest.fixture(scope="module")
def dut():
    return extract(DUT, "vci")


def test_counts_agree_with_the_data_page(dut):
    assert dut.counts.pairs == pytest.approx(532, rel=0.03)
    assert dut.counts.rows == pytest.approx(9600, rel=0.03)
    assert dut.counts.vehicles == 35


@pytest.mark.parametrize(
    ("column", "quartiles"),
    [
        ("range_m", (4.1, 8.1, 22.0)),
        ("vehicle_speed_mps", (1.2, 1.8, 3.9)),
        ("pedestrian_speed_mps", (1.05, 1.23, 1.39)),
        ("time_advantage_s", (2.2, 3.8, 6.2)),
    ],
)
def test_quartiles_agree_with_the_data_page(dut, column, quartiles):
    # The page gives two digits; 3.5 % covers their rounding and a few per cent.
    np.testing.assert_allclose(dut.rows[column].quantile([0.25, 0.5, 0.75]), quartiles, rtol=0.035)


def test_rows_outside_the_models_box_are_as_many_as_on_the_data_page(dut):
    # The page: about 16 % lie outside 1/R 1/60–0.5, v 0.3–8, v_p 0.3–3, 1/T_adv 0–2.
    box = np.array([1 / 60, 0.3, 0.3, 0]), np.array([0.5, 8, 3, 2])
    sample = make_sample(dut.rows, lower=box[0], upper=box[1])
    assert 1 - len(sample.data) / sample.rows_read == pytest.approx(0.16, abs=0.02)


def test_clips_missing_pedestrians_are_named(dut):
    # 28 clips; roundabout_03 has no pedestrians, roundabout_05 only unfiltered ones.
    assert dut.counts.clips == 27
    assert list(dut.counts.skipped) == ["roundabout_03"]
    assert any(note.startswith("roundabout_05: unfiltered") for note in dut.counts.notes)
