"""Conditionals against textbook formulas, another library, quadrature and dense grids."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.stats import multivariate_normal, norm

from harness.model.mixture.conditional import Conditional
from harness.model.mixture.distribution import TruncatedGaussianMixture
from tests.scenes import refuses

LOWER, UPPER = np.array([0.0, 0.3, 0.2, 0.0]), np.array([1.0, 8.0, 3.0, 2.0])
CASES = [(2, (0, 1, 3)), (1, (0, 2, 3)), (2, (0, 1)), (1, (0, 2)), (2, (0,)), (2, ())]
CLOSED = [case for case in CASES if len(case[1]) >= 2]


def random_parts(seed=0, count=5):
    """Components spread over the box and beyond, with real correlations."""
    rng = np.random.default_rng(seed)
    width = UPPER - LOWER
    locations = LOWER + width * rng.uniform(-0.2, 1.1, (count, 4))
    factors = rng.normal(size=(count, 4, 4)) * 0.15 + 0.15 * np.eye(4)
    scales = factors @ np.swapaxes(factors, 1, 2) + 0.003 * np.eye(4)
    weights = rng.dirichlet(np.full(count, 3.0))
    return weights, locations, scales * width[:, None] * width


@pytest.fixture(scope="module")
def bounded():
    return TruncatedGaussianMixture(*random_parts(), lower=LOWER, upper=UPPER)


@pytest.fixture(scope="module")
def free():
    far = np.full(4, 60.0)
    return TruncatedGaussianMixture(*random_parts(), lower=-far, upper=far)


@pytest.fixture(scope="module")
def rows(bounded):
    return bounded.sample(300, np.random.default_rng(9))


def textbook(parts, target, given, y):
    """Weights, means and spreads of the conditional mixture, the paper's (a1) and (a2)."""
    weights, locations, scales = parts
    given = list(given)
    new, means, spreads = [], [], []
    for pi, m, s in zip(weights, locations, scales, strict=True):
        inverse = np.linalg.inv(s[np.ix_(given, given)])
        cross = s[target, given]
        means.append(m[target] + cross @ inverse @ (y - m[given]))
        spreads.append(np.sqrt(s[target, target] - cross @ inverse @ cross))
        new.append(pi * multivariate_normal(m[given], s[np.ix_(given, given)]).pdf(y))
    return np.array(new) / np.sum(new), np.array(means), np.array(spreads)


@pytest.mark.parametrize(("target", "given"), [(2, (0, 1, 3)), (2, (0, 1)), (3, (2,)), (0, (3, 1))])
def test_without_bounds_equals_the_textbook(free, target, given):
    conditional = Conditional(free, target, given)
    for y in LOWER[list(given)] + np.array([[0.3], [0.6]]) * (UPPER - LOWER)[list(given)]:
        weights, means, spreads = textbook(random_parts(), target, given, y)
        x = np.linspace(-1.0, 5.0, 7)
        density = (weights * norm.pdf(x[:, None], means, spreads)).sum(axis=1)
        reached = (weights * norm.cdf(x[:, None], means, spreads)).sum(axis=1)
        np.testing.assert_allclose(conditional.pdf(x, y[None]), density, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(conditional.cdf(x, y[None]), reached, atol=1e-9)


@pytest.mark.parametrize(("target", "given"), CASES)
def test_density_is_the_joint_density_integrated(bounded, rows, target, given):
    """Ratios of the density by a product rule over the variables not named, within the box."""
    conditional = Conditional(bounded, target, given)
    rest = [i for i in range(4) if i != target and i not in given]
    z, w = np.polynomial.legendre.leggauss({0: 1, 1: 200, 2: 80, 3: 40}[len(rest)])
    shares, weights = np.zeros((1, 0)), np.ones(1)
    if rest:
        shares = np.stack(np.meshgrid(*[0.5 * (z + 1.0)] * len(rest), indexing="ij"), axis=-1)
        weights = np.prod(np.meshgrid(*[w] * len(rest), indexing="ij"), axis=0).ravel()
    points = np.tile(rows[0], (weights.size, 1))
    points[:, rest] = LOWER[rest] + (UPPER - LOWER)[rest] * shares.reshape(weights.size, -1)
    positions = LOWER[target] + (UPPER - LOWER)[target] * np.array([0.2, 0.45, 0.7])
    wanted = []
    for x in positions:
        points[:, target] = x
        wanted.append(weights @ np.exp(bounded.logpdf(points)))
    y = np.repeat(rows[:1, list(given)], 3, axis=0)
    got = conditional.pdf(positions, y)
    np.testing.assert_allclose(got / got[0], np.array(wanted) / wanted[0], rtol=2e-6)


@pytest.mark.parametrize(("target", "given"), CASES)
def test_density_integrates_to_the_distribution_function(bounded, rows, target, given):
    conditional = Conditional(bounded, target, given)
    z, w = np.polynomial.legendre.leggauss(20)
    edges = np.linspace(LOWER[target], UPPER[target], 61)
    half = 0.5 * (edges[1] - edges[0])
    x = (0.5 * (edges[1:] + edges[:-1])[:, None] + half * z).ravel()
    for row in rows[:3] if given else rows[:1]:
        y = row[None, list(given)]
        panels = (conditional.pdf(x, y).reshape(60, 20) * w).sum(axis=1) * half
        np.testing.assert_allclose(np.cumsum(panels), conditional.cdf(edges[1:], y), atol=1e-9)
        assert conditional.cdf(edges[[0, -1]], y).tolist() == [0.0, 1.0]


@pytest.mark.parametrize(("target", "known"), CASES)
@settings(max_examples=5)
@given(seed=st.integers(0, 10**6))
def test_ppf_inverts_cdf(model, target, known, seed):
    n, rng = 8 if len(known) == 1 else 60, np.random.default_rng(seed)
    u = np.append([0.0, 1.0, 1e-12, 1.0 - 1e-12, 1e-4, 1.0 - 1e-4], rng.random(n - 6))
    made = TruncatedGaussianMixture(*random_parts(seed), lower=LOWER, upper=UPPER)
    for mixture in (made, model.mixture):
        lower, upper = mixture.lower[target], mixture.upper[target]
        y = rng.uniform(mixture.lower, mixture.upper, (n, 4))[:, list(known)]
        conditional = Conditional(mixture, target, known)
        x = conditional.ppf(u, y)
        assert (x[0], x[1]) == (lower, upper)
        assert ((x >= lower) & (x <= upper)).all()
        np.testing.assert_allclose(conditional.cdf(x, y), u, atol=1e-9)


@pytest.mark.parametrize(("target", "given"), CLOSED)
def test_mode_is_the_highest_point_of_a_dense_grid(bounded, rows, target, given):
    conditional = Conditional(bounded, target, given)
    y = rows[:60, list(given)]
    modes = conditional.mode(y)
    grid = np.linspace(LOWER[target], UPPER[target], 4001)
    for mode, point in zip(modes, y, strict=True):
        heights = conditional.logpdf(grid, point[None])
        assert conditional.logpdf([mode], point[None])[0] >= heights.max() - 1e-9
        assert abs(mode - grid[heights.argmax()]) <= 2 * (grid[1] - grid[0])


@pytest.mark.parametrize(("target", "given"), CASES)
def test_a_point_does_not_depend_on_its_batch(bounded, rows, target, given):
    """What episodes ask for, to the last bit; states that were asked before are kept."""
    conditional = Conditional(bounded, target, given)
    n = 4 if len(given) == 1 else (40 if not given else 100)
    rng = np.random.default_rng(11)
    y, u = rows[:n, list(given)], rng.random(n)
    functions = {
        "ppf": lambda i: conditional.ppf(u[i], y[i]),
        "mode": lambda i: conditional.mode(y[i]),
    }
    for name, function in functions.items():
        whole = function(np.arange(n))
        order = rng.permutation(n)
        singles = np.concatenate([function(np.array([i])) for i in order])
        assert whole[order].tobytes() == singles.tobytes(), name


def test_far_from_every_component(bounded):
    """Where the closed form has lost its digits the table takes over, and stays a density."""
    conditional = Conditional(bounded, 2, (0, 1))
    y = np.array([[30.0, -150.0]])
    x = np.linspace(LOWER[2], UPPER[2], 401)
    reached = conditional.cdf(x, y)
    assert (np.diff(reached) >= -1e-12).all()
    got = conditional.ppf([0.3], y)
    assert conditional.cdf(got, y)[0] == pytest.approx(0.3, abs=1e-9)


def test_bad_arguments_are_refused(bounded):
    conditional = Conditional(bounded, 2, (0, 1))
    for u in (-0.1, 1.1, np.nan):
        refuses("0 to 1", partial(conditional.ppf, [u], [[0.1, 1.0]]))
    refuses("not finite", lambda: conditional.mode([[0.1, np.nan]]))
