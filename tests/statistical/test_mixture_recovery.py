"""Does the method find a known truncated mixture again, and draw from what it says?"""

import numpy as np
import pytest

from harness.model.mixture.distribution import TruncatedGaussianMixture
from harness.model.mixture.fitting import fit_mixture
from tests.unit.test_mixture_fitting import truth

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
    ours = fit_mixture(rows, 3, known.lower, known.upper, seed=1, n_init=3).mixture
    divergence = (logs - ours.logpdf(held_out)).mean()
    assert divergence <= 2.0 * PARAMETERS / (2.0 * n)
    other = mixtures.GaussianMixture(3, tol=1e-6, max_iter=1000, random_state=1)
    assert (logs - other.fit(rows).score_samples(held_out)).mean() > 10.0 * divergence


@pytest.mark.slow
def test_bic_picks_the_true_number_of_components():
    known = truth()
    rows = known.sample(2_973, np.random.default_rng(12))
    scores = [
        fit_mixture(rows, k, known.lower, known.upper, seed=1, n_init=3).bic for k in range(1, 9)
    ]
    assert int(np.argmin(scores)) + 1 == 3


def height(known, target, given, y):
    """Log density, up to a constant, of the target at x (n, m) given y (n, g): the textbook's."""
    weights, means, spreads = [], [], []
    for k in range(known.weights.size):
        centre, scale = known.locations[k], known.scale_matrices[k]
        block = scale[np.ix_(given, given)]
        slopes = np.linalg.solve(block, scale[given, target])
        away = y - centre[given]
        square = (away @ np.linalg.inv(block) * away).sum(axis=1)
        mass = known.masses[k] * np.sqrt(np.linalg.det(block))
        weights.append(np.log(known.weights[k] / mass) - 0.5 * square)
        means.append(centre[target] + away @ slopes)
        spreads.append(np.sqrt(scale[target, target] - slopes @ scale[given, target]))
    largest = np.max(weights, axis=0)

    def at(x):
        total = np.zeros((y.shape[0], x.shape[-1]))
        for weight, mean, spread in zip(weights, means, spreads, strict=True):
            z = (x - mean[:, None]) / spread
            logs = (weight - largest - np.log(spread))[:, None] - 0.5 * z * z
            total += np.exp(np.maximum(logs, -600.0))
        return np.log(total)

    return at


@pytest.mark.slow
@pytest.mark.parametrize("target", [1, 2])
def test_modes_are_global(target):
    """200,000 points of random mixtures: under 0.01 % miss by 1e-3 in log density."""
    missed = 0
    grid = np.linspace(0.0, 1.0, 1001)
    around = np.linspace(-1e-3, 1e-3, 21)
    given = [i for i in range(4) if i != target]
    for seed in range(10):
        rng = np.random.default_rng(seed)
        factors = rng.normal(size=(10, 4, 4)) * 0.15 + 0.1 * np.eye(4)
        scales = factors @ np.swapaxes(factors, 1, 2) + 0.002 * np.eye(4)
        locations = rng.uniform(-0.2, 1.2, (10, 4))
        known = TruncatedGaussianMixture(
            rng.dirichlet(np.full(10, 3.0)), locations, scales, np.zeros(4), np.ones(4)
        )
        conditional = known.conditional(target, given)
        rows = known.sample(10_000, rng)[:, given]
        for y in np.split(rows, 10):
            log_density = height(known, target, given, y)
            heights = log_density(grid[None])
            fine = np.clip(grid[heights.argmax(axis=1), None] + around, 0.0, 1.0)
            best = np.maximum(heights.max(axis=1), log_density(fine).max(axis=1))
            missed += int((best > log_density(conditional.mode(y)[:, None])[:, 0] + 1e-3).sum())
    assert missed <= 1e-4 * 100_000
