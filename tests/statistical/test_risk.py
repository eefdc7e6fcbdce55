"""The interval of a risk holds the truth as often as it says, where the truth is known."""

import numpy as np
import pytest
from scipy import stats

from harness.risk.estimation import estimate_probability
from harness.risk.layout import Layout
from tests.risks import CROWD, LAYOUT, crowd, half_space, union

REPETITIONS = 400


@pytest.mark.slow
@pytest.mark.parametrize("p", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize(
    ("case", "layout"), [(half_space, LAYOUT), (union, LAYOUT), (crowd, CROWD)]
)
def test_the_interval_covers(case, layout: Layout, p: float) -> None:
    score, truth = case(p)
    held, estimates = 0, []
    for seed in range(REPETITIONS):
        estimate = estimate_probability(score, layout, np.random.default_rng((11, seed))).estimate
        held += estimate.ci_low <= truth <= estimate.ci_high
        estimates.append(estimate.probability)
    # The 95 % interval, less what chance takes once in a thousand.
    assert held >= stats.binom.ppf(0.001, REPETITIONS, 0.95)
    error = np.std(estimates) / np.sqrt(REPETITIONS)
    assert abs(np.mean(estimates) - truth) < 3 * error
