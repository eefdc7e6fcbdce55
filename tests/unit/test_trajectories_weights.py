"""Weights of rows, by hand on a small frame."""

import numpy as np
import pandas as pd
import pytest

from harness.model.sample import WEIGHINGS, row_weights

# Vehicle a: encounters 1 (2 rows), 2 (1 row), 3 (1 row); vehicle b of the same clip: encounter 1
# (4 rows); a vehicle also called a in another clip: 1 encounter, 2 rows. 5 encounters, 10 rows.
KEYS = [("x", "a", "1")] * 2 + [("x", "a", "2"), ("x", "a", "3")]
KEYS += [("x", "b", "1")] * 4 + [("y", "a", "1")] * 2


@pytest.fixture
def rows():
    frame = pd.DataFrame(KEYS, columns=["clip", "vehicle", "pedestrian"])
    return frame.assign(source="s")


def test_weighings_by_row_encounter_and_vehicle(rows):
    np.testing.assert_allclose(row_weights(rows, "row"), np.full(10, 0.5))
    expected = [0.5, 0.5, 1, 1, 0.25, 0.25, 0.25, 0.25, 0.5, 0.5]
    np.testing.assert_allclose(row_weights(rows, "encounter"), expected)
    # Encounters per vehicle 3, 1, 1: median 1, so all three weigh the same, 5/3 each.
    weights = row_weights(rows, "vehicle")
    np.testing.assert_allclose(
        [weights[:4].sum(), weights[4:8].sum(), weights[8:].sum()], [5 / 3] * 3
    )
    np.testing.assert_allclose(weights[:4], np.array([0.5, 0.5, 1, 1]) * 5 / 9)


@pytest.mark.parametrize("weigh", WEIGHINGS)
def test_weights_sum_to_the_encounters_in_any_order(rows, weigh):
    weights = row_weights(rows, weigh)
    assert weights.sum() == pytest.approx(5)
    assert (weights > 0).all()
    order = np.random.default_rng(3).permutation(len(rows))
    np.testing.assert_allclose(row_weights(rows.iloc[order], weigh), weights[order])
