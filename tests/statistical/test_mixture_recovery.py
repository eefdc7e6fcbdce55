"""Does the method find a known truncated mixture again, and draw from what it says?"""

import numpy as np
import pytest

from harness.model.mixture.fitting import Search, fit_mixture
from tests.densities import truth

PARAMETERS = 44  # 2 weights, 12 locations, 30 of the scale matrices


@pytest.mark.parametrize("n", [2_973, pytest.param(30_000, marks=pytest.mark.slow)])
def test_held_out_divergence(n):
    """KL per point at most twice the theory's p/2n, and scikit-learn's over ten times ours."""
    mixtures = pytest.importorskip("sklearn.mixture")
    known = truth()
    assert (known.masses < 2 / 3).all()
    rng = np.random.default_rng(n)
    rows, held_out = known.sample(n, rng), known.sample(50_000, rng)
    logs = known.logpdf(held_out)
    ours = fit_mixture(rows, 3, known.lower, known.upper, Search(1, starts=3)).mixture
    divergence = (logs - ours.logpdf(held_out)).mean()
    assert divergence <= 2.0 * PARAMETERS / (2.0 * n)
    other = mixtures.GaussianMixture(3, tol=1e-6, max_iter=1000, random_state=1)
    assert (logs - other.fit(rows).score_samples(held_out)).mean() > 10.0 * divergence


@pytest.mark.slow
def test_bic_picks_the_true_number_of_components():
    known = truth()
    rows = known.sample(2_973, np.random.default_rng(12))
    scores = [
        fit_mixture(rows, k, known.lower, known.upper, Search(1, starts=3)).bic for k in range(1, 9)
    ]
    assert int(np.argmin(scores)) + 1 == 3
