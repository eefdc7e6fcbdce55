"""Rows to a model: what is refused, what is dropped, weights, folds, scores, choice of K."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm, sem

from harness.model.sample import RowFile, make_sample
from harness.studies.models.card import card, near_state
from harness.studies.models.fits import (
    FitSettings,
    HeldOut,
    by_held_out,
    by_rule,
    fit,
    log_scores,
    processes,
    relative_gain,
    vehicle_folds,
)
from tests.scenes import refusal_of, refuses


def made_up(count: int = 240, seed: int = 3) -> pd.DataFrame:
    """Two kinds of encounters, 12 vehicles with 5 encounters of 4 rows each, all in the box."""
    rng = np.random.default_rng(seed)
    fast = rng.random(count) < 0.4
    group = np.arange(count) // 4
    inverse_m = np.where(fast, rng.uniform(0.02, 0.06, count), rng.uniform(0.1, 0.4, count))
    speed_mps = np.where(fast, rng.normal(5.5, 0.5, count), rng.normal(1.5, 0.2, count))
    return pd.DataFrame(
        {
            "source": "made-up",
            "clip": "a",
            "vehicle": [f"v{code // 5}" for code in group],
            "pedestrian": [f"p{code}" for code in group],
            "range_m": 1 / inverse_m,
            "vehicle_speed_mps": speed_mps,
            "pedestrian_speed_mps": rng.normal(1.3, 0.15, count),
            "time_advantage_s": rng.uniform(1.5, 6.0, count),
        }
    )


def test_rows_outside_the_box_are_dropped_and_counted_by_column():
    rows = made_up(40)
    rows.loc[0, "range_m"] = 1.0  # 1/R = 1 > 0.5
    rows.loc[1, "range_m"] = 61.0  # 1/R < 1/60
    rows.loc[1, "vehicle_speed_mps"] = 9.0
    rows.loc[2, "time_advantage_s"] = 0.4  # 1/T = 2.5 > 2
    rows.loc[3, "pedestrian_speed_mps"] = 3.0  # on the bound: inside
    sample = make_sample(rows)
    with pytest.raises(ValueError, match="read-only"):
        sample.data[0] = 0.0
    columns = ["range_m", "vehicle_speed_mps", "pedestrian_speed_mps", "time_advantage_s"]
    assert sample.outside == dict(zip(columns, (2, 1, 0, 1), strict=True))
    assert sample.data.shape == (37, 4)
    assert sample.rows_read == 40
    rows = made_up(4)
    rows.loc[0, columns] = [20.0, 4.0, 1.25, 2.5]
    np.testing.assert_allclose(make_sample(rows).data[0], [0.05, 4.0, 1.25, 0.4], rtol=1e-15)


@pytest.mark.parametrize("weigh", ["row", "encounter", "vehicle"])
def test_weights_sum_to_the_encounters_in_the_box(weigh):
    rows = made_up()
    rows.loc[:3, "range_m"] = 1.0  # the whole first encounter is outside
    sample = make_sample(rows, weigh=weigh)
    assert (len(set(sample.encounter)), sample.vehicles) == (59, 12)
    assert sample.weights.sum() == pytest.approx(59, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"range_m": np.nan}, ["range_m", "2 rows", "NaN"]),
        ({"pedestrian_speed_mps": np.inf}, ["pedestrian_speed_mps", "2 rows"]),
        ({"range_m": -3.0}, ["range_m", "2 rows", "above 0"]),
        ({"time_advantage_s": 0.0}, ["time_advantage_s", "2 rows", "above 0"]),
    ],
)
def test_bad_values_name_the_column_and_the_number_of_rows(change, words):
    rows = made_up(40)
    rows.loc[[5, 9], [*change]] = [*change.values()]
    refusal_of(lambda: make_sample(rows), *words)


def test_rows_without_identifiers_count_one_each_and_have_no_held_out_score():
    rows = made_up(40).drop(columns=["source", "clip", "vehicle", "pedestrian"])
    sample = make_sample(rows, weigh="row")
    assert (sample.weights.sum(), sample.vehicles) == (40, None)
    refuses("no missing value in source", lambda: make_sample(rows, weigh="encounter"))
    refuses("no held-out scores", lambda: fit(sample, FitSettings((1, 2), choose="held-out")))


def test_standard_error_over_vehicles():
    scores = np.array([-0.4, -0.1, 0.3, -0.9, 0.2])
    held_out = HeldOut(totals=2.0 * scores, weights=np.full(5, 2.0))
    assert held_out.mean == pytest.approx(scores.mean())
    assert held_out.standard_error == pytest.approx(sem(scores))
    assert HeldOut(scores[:1], np.ones(1)).standard_error is None
    # Two vehicles at +1 and −1; with weights 9 and 1 the mean is 0.8, e = (1.8, −1.8), and the
    # formula gives sqrt(2/1 · 2 · 1.8²)/10.
    held_out = HeldOut(np.array([9.0, -1.0]), np.array([9.0, 1.0]))
    assert held_out.mean == pytest.approx(0.8)
    assert held_out.standard_error == pytest.approx(np.sqrt(2 * 2 * 1.8**2) / 10)


def test_folds_keep_vehicles_whole_and_weights_even():
    vehicle = np.repeat(np.arange(9), [40, 30, 20, 10, 10, 5, 5, 5, 5])
    weights = np.ones(vehicle.size)
    fold = vehicle_folds(vehicle, weights, 3, seed=7)
    assert all(len(set(fold[vehicle == of])) == 1 for of in range(9))
    # 130 in three folds; the largest vehicle alone holds 40.
    assert sorted(np.bincount(fold)) == pytest.approx([43, 43, 43], abs=3)
    np.testing.assert_array_equal(fold, vehicle_folds(vehicle, weights, 3, seed=7))


def test_near_state_by_hand():
    rows = made_up(8)
    rows["range_m"] = [30, 26, 34.9, 24.9, 30, 30, 35.1, 30]
    rows["vehicle_speed_mps"] = [5, 5.9, 4.1, 5, 6.1, 3.9, 5, 5]
    rows["vehicle"] = ["a", "a", "b", "b", "b", "b", "b", "b"]
    rows["pedestrian"] = ["1", "2", "3", "4", "4", "4", "4", "4"]
    near = near_state(make_sample(rows, weigh="encounter"))
    # Rows 0, 1, 2 and 7 with weights 1, 1, 1 and 1/5.
    assert (near["rows"], near["encounters"], near["vehicles"]) == (4, 4, 2)
    assert near["effective_rows"] == pytest.approx(3.2**2 / 3.04)
    assert near["effective_vehicles"] == pytest.approx(3.2**2 / (2**2 + 1.2**2))


BIC = {1: 1000.0, 2: 600.0, 3: 450.0, 4: 405.0, 5: 370.0, 6: 372.0}


def test_choices_by_rule_and_of_equals():
    # Gains 400, 150, 45, 35: the first under 40 is that of K = 5.  Other units of the data add one
    # constant to the log-likelihood of every K.
    for shift in (-700.0, 0.0, 1e5):
        assert by_rule({k: value + shift for k, value in BIC.items()}) == 4
    assert relative_gain(BIC) == pytest.approx({2: 1, 3: 0.375, 4: 0.1125, 5: 0.0875, 6: -0.005})
    assert by_rule({1: 100.0, 2: 50.0, 3: 10.0}) is None
    assert relative_gain({1: 1.0, 2: 3.0, 3: 0.0}) == {}
    refuses("every K", lambda: by_rule({1: 1.0, 3: 0.5, 4: 0.2}))
    score = {k: HeldOut(np.array([x]), np.ones(1)) for k, x in {4: -1.0, 2: -1.0, 3: -2.0}.items()}
    assert by_held_out(score) == 2


@pytest.fixture(scope="module")
def fitted():
    sample = make_sample(made_up())
    return sample, fit(sample, FitSettings((1, 2), starts=2, folds=3))


def test_more_workers_change_no_bit(fitted):
    sample, serial = fitted
    with processes(2) as executor:
        parallel = fit(sample, FitSettings((1, 2), starts=2, folds=3), executor)
    assert parallel.chosen.components == serial.chosen.components
    for one, other in zip(serial.candidates, parallel.candidates, strict=True):
        assert one.fit.bic == other.fit.bic
        np.testing.assert_array_equal(one.scores["held_out"], other.scores["held_out"])
        a, b = one.fit.mixture, other.fit.mixture
        np.testing.assert_array_equal(a.locations, b.locations)
        np.testing.assert_array_equal(a.scale_matrices, b.scale_matrices)


def test_held_out_scores_are_near_the_truth_and_cover_every_vehicle(fitted):
    _, calibration = fitted
    # v_p is drawn from N(1.3, 0.15²) whatever the vehicle does: no model can expect more than
    # minus its entropy, and a fit to 160 rows should lose little.
    best = -norm(1.3, 0.15).entropy()
    for candidate in calibration.candidates:
        assert candidate.scores["held_out"].weights == pytest.approx(np.full(12, 5.0))
        assert candidate.scores["held_out"].mean == pytest.approx(best, abs=0.25)
    assert calibration.folds == 3


def test_held_out_scores_come_from_fits_without_the_vehicle():
    rows = made_up()
    # One vehicle whose walkers are unlike all others, over a range that no other fit expects.
    odd = rows["vehicle"] == "v3"
    noise = np.random.default_rng(0).normal(size=int(odd.sum()))
    rows.loc[odd, "pedestrian_speed_mps"] = 2.6 + 0.05 * noise
    sample = make_sample(rows)
    calibration = fit(sample, FitSettings((2,), starts=2, folds=4))
    scores = np.divide(*calibration.chosen.scores["held_out"])
    number = sample.vehicle[np.flatnonzero(odd)[0]]
    logs = log_scores(calibration.chosen.fit.mixture, sample.data, "held_out")
    assert scores[number] < -20
    assert logs[sample.vehicle == number].mean() > scores[number] + 10


def test_copies_are_counted_warned_of_and_kept_in_one_fold():
    """60 rows of 3 vehicles, 20 times under other names: what the 60 say, and no more."""
    once = made_up(60)
    again = [once.assign(vehicle=once["vehicle"] + f"-{of}", clip=str(of)) for of in range(20)]
    one, copied = make_sample(once), make_sample(pd.concat(again, ignore_index=True))
    assert (copied.vehicles, copied.named_vehicles, len(set(copied.row))) == (3, 60, 60)
    settings = FitSettings((1, 2), starts=2, folds=3, seed=4)
    fits, twenty = fit(one, settings), fit(copied, settings)
    for alone, of in zip(fits.candidates, twenty.candidates, strict=True):
        own, other = of.scores["held_out"], alone.scores["held_out"]
        assert of.fit.bic == pytest.approx(alone.fit.bic, rel=1e-6)
        assert own.mean == pytest.approx(other.mean, abs=1e-3)
        assert own.standard_error == pytest.approx(other.standard_error, abs=1e-3)
    told = card(copied, settings, twenty, RowFile(again[0], "", {}), "fit")
    assert (told["effective_rows"], told["copied_rows"]) == (pytest.approx(60), 1140)
    assert "1140 of 1200 rows are copies of another row" in told["warnings"][0]
    assert "BIC's n is 15" in told["warnings"][0]
    assert "60 vehicle names count as 3 vehicles" in told["warnings"][1]


def test_vehicles_of_one_track_are_one():
    rows = made_up(80).assign(track=["a"] * 20 + ["b"] * 20 + ["a"] * 20 + ["c"] * 20)
    sample = make_sample(rows)
    assert (sample.vehicles, sample.named_vehicles, len(set(sample.row))) == (3, 4, 80)
    assert sample.vehicle.tolist() == [0] * 20 + [1] * 20 + [0] * 20 + [2] * 20
    assert sample.tracks == ("a", "b", "c")
