"""The interval over pairs and refits holds as often as it says, for a known truth."""

import numpy as np
import pytest
from scipy import stats

from harness.old.statistics import Finding, over_model

REFITS, VEHICLES, EXPERIMENTS = 20, 20, 600


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.0, 1.0, 10.0, 100.0])
def test_it_holds_with_20_vehicles_and_20_refits(ratio: float) -> None:
    """The variance of the fit is ``ratio`` times that of the pairs; both errors are normal."""
    rng = np.random.default_rng(4)
    reach, held = stats.norm.ppf(0.975), 0
    for _ in range(EXPERIMENTS):
        # The fit is off, and its data show its variance with V − 1 degrees of freedom.
        off = rng.normal(0.0, np.sqrt(ratio))
        seen = ratio * rng.chisquare(VEHICLES - 1) / (VEHICLES - 1)
        values = off + rng.normal(0.0, np.sqrt(seen + REFITS), REFITS)
        theta = float(values.mean())
        found = over_model(
            Finding(theta, theta - reach, theta + reach, 500), [*values], float(VEHICLES)
        )
        assert found.low is not None
        assert found.high is not None
        held += found.low <= 0.0 <= found.high
    # Three standard errors of 600 experiments below 95 %.
    assert held / EXPERIMENTS > 0.95 - 3 * np.sqrt(0.95 * 0.05 / EXPERIMENTS)
