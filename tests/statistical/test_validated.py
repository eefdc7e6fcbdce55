"""The intervals over vehicles cover the truth; ``validated.json`` is what its command writes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pytest

from benchmarks.references import time_ratios, validated
from harness.results.estimators import Sampling
from harness.results.references import known
from harness.studies.models.validation import RELIABLE_VEHICLES, scores_of
from tests.docs.conftest import ROOT

DUT = ROOT.parent / "shared" / "data" / "dut"


def drives(vehicles: int, rng: np.random.Generator) -> pd.DataFrame:
    """Skewed errors and shares whose passages are alike within a vehicle; crowds of 1 to 60."""
    passages = 1 + rng.poisson(0.3, vehicles)
    vehicle = np.repeat(np.arange(vehicles), passages)
    n, effect, share = len(vehicle), rng.normal(size=vehicles), rng.beta(3, 1, vehicles)
    people = 1 + rng.geometric(0.07, n)
    return pd.DataFrame(
        {
            "vehicle": vehicle,
            "passage": np.arange(n),
            "error_s": np.exp(1.4 + 0.6 * effect[vehicle] + 0.5 * rng.normal(size=n)),
            "right": rng.binomial(people, share[vehicle]).astype(float),
            "people": people.astype(float),
            **dict.fromkeys(("contacts", "timed_out", "uses", "clamped"), 0.0),
        }
    )


@pytest.mark.slow
def test_intervals_over_vehicles_cover_the_truth_as_often_as_they_say() -> None:
    """E|e| = exp(1.4 + (0.6² + 0.5²)/2); the mean of a Beta(3, 1) is 3/4."""
    truths = {"pass_time_score_s": float(np.exp(1.4 + 0.305)), "order_right": 0.75}
    covered = dict.fromkeys(truths, 0)
    repeats = 600
    for number in range(repeats):
        rng = np.random.default_rng(number)
        found = scores_of(drives(RELIABLE_VEHICLES, rng), Sampling(rng))
        for key, truth in truths.items():
            low, high = found[key].low, found[key].high
            assert low is not None
            assert high is not None
            assert found[key].reliable
            covered[key] += low <= truth <= high
    # Nominal ± 2 points; a share in 600 has a standard error of 0.9 points, of which two are added.
    assert all(0.912 <= count / repeats <= 0.988 for count in covered.values()), covered


def same(now: Sequence[Mapping[str, Any]], then: Sequence[Mapping[str, Any]]) -> None:
    for one, other in zip(now, then, strict=True):
        assert one.keys() == other.keys()
        for key, cell in other.items():
            stored = isinstance(cell, Mapping) and "value" in cell
            found, number = (each["value"] if stored else each for each in (one[key], cell))
            exact = number is None or isinstance(number, str | bool | Mapping)
            expected = number if exact else pytest.approx(number, rel=1e-6, abs=1e-9)
            assert found == expected, (other, key)


@pytest.mark.slow
def test_the_shipped_validation_is_fresh() -> None:
    if not DUT.is_dir():
        pytest.skip("needs the DUT set in ../shared/data/dut")
    now, then = validated(DUT), known()["validation"]
    assert now["facts"]["tracks"] == then["facts"]["tracks"]
    same(now["records"], then["records"])


@pytest.mark.slow
def test_the_shipped_ratios_of_times_are_fresh() -> None:
    runs = known()["runs"]
    same(time_ratios(runs[0]["pairs"]), runs)
