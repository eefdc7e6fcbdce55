"""Fitting: against scikit-learn without bounds, calculus with them, and refusals."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal, truncnorm

from harness.core.errors import InputError
from harness.model.mixture.distribution import TruncatedGaussianMixture
from harness.model.mixture.fitting import Search, fit_mixture
from harness.model.mixture.likelihood import SCALE_FLOOR, Coordinates, Likelihood
from harness.model.mixture.normals import Normals
from tests.densities import truth

INF = np.inf


@pytest.fixture(scope="module")
def rows():
    return truth().sample(1500, np.random.default_rng(21))


def test_without_bounds_it_ends_where_scikit_learn_ends(rows):
    mixtures = pytest.importorskip("sklearn.mixture")
    standard = (rows - rows.mean(axis=0)) / rows.std(axis=0)
    tight = {"reg_covar": 0.0, "tol": 1e-10, "n_init": 10, "max_iter": 5000, "random_state": 1}
    other = mixtures.GaussianMixture(3, **tight).fit(standard)
    free = np.full(4, INF)
    found = fit_mixture(standard, 3, -free, free, Search(1))
    assert found.log_likelihood >= other.score(standard) * len(rows) - 1e-4
    likelihood = Likelihood(standard, np.ones(len(rows)), -free, free)
    at = likelihood.at(Normals(other.weights_, other.means_, other.covariances_))
    assert at.log_likelihood == pytest.approx(other.score(standard) * len(rows), rel=1e-10)
    assert Coordinates(likelihood, at).gradient()[1] < 1e-4


def test_likelihood_ends_at_the_reported_one(rows):
    fitted = fit_mixture(rows, 3, truth().lower, truth().upper, Search(1, starts=1, tol=1e-9))
    assert fitted.converged
    plain = fitted.mixture.logpdf(rows).sum()
    assert fitted.log_likelihood == pytest.approx(plain, rel=1e-10)
    # p = 2 + 12 + 30 for three components in four variables.
    assert fitted.bic == pytest.approx(-2.0 * plain + 44 * np.log(1500), rel=1e-10)


def test_gradient_the_steps_follow_is_the_slope_of_the_density(rows):
    """Away from the optimum and the reference, against differences of log f and log α."""
    box = truth()
    likelihood = Likelihood(rows, np.ones(len(rows)), box.lower, box.upper)
    at = likelihood.at(Normals(box.weights, box.locations, box.scale_matrices))
    assert not any(part.flags.writeable for part in (at.counts, *at.slopes))
    coordinates = Coordinates(likelihood, at)
    z = np.random.default_rng(4).normal(size=coordinates.size)

    def objective(z):
        mixture = TruncatedGaussianMixture(*coordinates.normals(z), box.lower, box.upper)
        return mixture.logpdf(rows).sum() + np.log(mixture.masses).sum()

    gradient = -coordinates.below(z)[1]
    for i, step in enumerate(1e-5 * np.eye(z.size)):
        slope = (objective(z + step) - objective(z - step)) / 2e-5
        assert gradient[i] == pytest.approx(slope, abs=2e-4 * np.abs(gradient).max()), i
    np.testing.assert_allclose(coordinates.normals(0 * z).scales, box.scale_matrices, atol=1e-9)


def test_the_end_of_every_fit_has_next_to_no_gradient(rows):
    for k in (1, 2, 4):
        found = fit_mixture(rows, k, truth().lower, truth().upper, Search(1, starts=1))
        assert found.converged
        assert found.gradient_norm < 1e-7, k
    short = fit_mixture(rows, 4, truth().lower, truth().upper, Search(1, starts=1, max_iter=20))
    assert not short.converged
    assert short.gradient_norm >= 1e-7


def test_a_scale_at_its_floor_that_would_grow_is_no_maximum():
    """Rows of unit spread, one component as flat as is allowed: d log f/d log s = (z² − 1)/2."""
    x = np.random.default_rng(3).normal(size=(200, 1))
    free, floor = np.array([INF]), SCALE_FLOOR
    likelihood = Likelihood(x, np.ones(200), -free, free)
    at = likelihood.at(Normals(np.ones(1), np.zeros((1, 1)), np.full((1, 1, 1), floor)))
    wanted = ((x**2 / floor - 1.0) / 2.0).sum() / np.sqrt(200) / 200
    assert Coordinates(likelihood, at).gradient()[1] == pytest.approx(wanted, rel=1e-9)


def test_weights_count_as_repeated_rows(rows):
    box, chosen = truth(), rows[:400]
    counts = np.random.default_rng(0).integers(0, 4, 400)
    found = fit_mixture(chosen, 1, box.lower, box.upper, Search(1, starts=1), sample_weight=counts)
    plain = counts @ found.mixture.logpdf(chosen)
    assert found.bic == pytest.approx(-2.0 * plain + 14 * np.log(counts.sum()), rel=1e-10)


def test_one_truncated_variable_against_direct_maximisation():
    """K = 1, d = 1: scipy maximises the same penalised likelihood from its own formulas."""
    rng = np.random.default_rng(6)
    x = truncnorm.rvs(-0.5, 1.5, loc=1.0, scale=2.0, size=800, random_state=rng)

    def negative(theta):
        m, s = theta[0], np.exp(theta[1])
        a, b = (0.0 - m) / s, (4.0 - m) / s
        mass = multivariate_normal.cdf(b) - multivariate_normal.cdf(a)
        return -(truncnorm.logpdf(x, a, b, loc=m, scale=s).sum() + np.log(mass))

    tight: dict = {"options": {"xatol": 1e-9, "fatol": 1e-10, "maxiter": 4000}}
    best = minimize(negative, [1.0, 0.5], method="Nelder-Mead", **tight)
    found = fit_mixture(x[:, None], 1, [0.0], [4.0], Search(1, starts=1, tol=1e-10))
    penalised = found.log_likelihood + np.log(found.mixture.masses).sum()
    assert penalised == pytest.approx(-best.fun, abs=1e-6)
    assert found.mixture.locations[0, 0] == pytest.approx(best.x[0], abs=2e-3)


def test_the_prior_stops_a_location_from_running_away():
    """Exponential rows: without a prior the best normal has its location at minus infinity."""
    x = np.random.default_rng(1).exponential(size=(500, 1))
    found = fit_mixture(x, 1, [0.0], [INF], Search(1, starts=1))
    assert found.converged
    assert found.mixture.masses[0] > 1e-6


@pytest.mark.parametrize(
    ("gap", "k", "text"),
    [
        (lambda _: 0.5, 2, "gap: constant: all 50 rows are 0.5"),
        (lambda x: 0.5 * x[:, 0], 2, "gap: collinear with range"),
        (lambda x: x[:, 2], 51, "50 rows for 51 components"),
    ],
)
def test_bad_rows_are_refused(gap, k, text):
    x = np.random.default_rng(0).random((50, 3))
    x[:, 2] = gap(x)
    with pytest.raises(InputError, match=text) as caught:
        fit_mixture(x, k, [0] * 3, [2] * 3, Search(1), names=["range", "speed", "gap"])
    assert "\n" not in str(caught.value)
