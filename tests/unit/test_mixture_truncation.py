"""Masses and moments of truncated normals against closed forms and quadrature."""

import numpy as np
import pytest
from scipy.stats import norm, truncnorm

from harness.model.mixture.boxes import moments

INF = np.inf


def by_quadrature(location, matrix, lower, upper, nodes=64):
    """Mass, mean and covariance by a product of Gauss-Legendre rules over a finite box."""
    z, w = np.polynomial.legendre.leggauss(nodes)
    axes = [0.5 * (lo + hi) + 0.5 * (hi - lo) * z for lo, hi in zip(lower, upper, strict=True)]
    halves = [0.5 * (hi - lo) * w for lo, hi in zip(lower, upper, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(lower))
    weights = np.prod(np.meshgrid(*halves, indexing="ij"), axis=0).ravel()
    away = points - location
    quadratic = np.einsum("ni,ij,nj->n", away, np.linalg.inv(matrix), away)
    density = np.exp(-0.5 * quadratic) / np.sqrt(np.linalg.det(2.0 * np.pi * matrix)) * weights
    total = density.sum()
    mean = density @ points / total
    return total, mean, np.einsum("n,ni,nj->ij", density, points - mean, points - mean) / total


def random_matrix(rng, dimension, condition):
    """A matrix with eigenvalues from 1 to the condition number, randomly turned."""
    turn = np.linalg.qr(rng.normal(size=(dimension, dimension)))[0]
    values = np.geomspace(1.0, condition, dimension) / condition
    return (turn * values) @ turn.T


@pytest.mark.parametrize(
    ("a", "b"), [(-1.0, 2.0), (0.5, INF), (-INF, -3.0), (5.0, 6.0), (9.0, INF)]
)
def test_one_variable_equals_scipy(a, b):
    got, mean, covariance = moments(
        np.array([[0.3]]), np.array([[[4.0]]]), np.array([0.3 + 2 * a]), np.array([0.3 + 2 * b])
    )
    reference = truncnorm(a, b)
    # scipy's truncnorm is the reference for the moments, its norm tail for the mass.
    wanted = norm.sf(a) - norm.sf(b) if a > 0 else norm.cdf(b) - norm.cdf(a)
    assert got[0] == pytest.approx(wanted, rel=1e-12)
    assert mean[0, 0] == pytest.approx(0.3 + 2.0 * reference.mean(), abs=1e-8)
    assert covariance[0, 0, 0] == pytest.approx(4.0 * reference.var(), abs=1e-7)


@pytest.mark.parametrize(
    ("dimension", "condition", "nodes"), [(2, 100, 200), (3, 30, 90), (4, 4, 30)]
)
def test_two_sided_boxes_by_quadrature(dimension, condition, nodes):
    rng = np.random.default_rng(dimension)
    for _ in range(4):
        matrix = random_matrix(rng, dimension, condition)
        location = rng.normal(scale=0.4, size=dimension)
        lower, upper = -rng.uniform(0.2, 1.0, dimension), rng.uniform(0.2, 1.0, dimension)
        total, mean, covariance = by_quadrature(location, matrix, lower, upper, nodes)
        got = moments(location[None], matrix[None], lower, upper)
        assert got[0][0] == pytest.approx(total, abs=1e-8)
        np.testing.assert_allclose(got[1][0], mean, atol=1e-7)
        np.testing.assert_allclose(got[2][0], covariance, atol=1e-7)


def test_infinite_bounds_change_nothing():
    matrix = random_matrix(np.random.default_rng(1), 4, 50)[None]
    location = np.array([[1.0, -2.0, 3.0, 0.0]])
    total, mean, covariance = moments(location, matrix, np.full(4, -INF), np.full(4, INF))
    assert total[0] == 1.0
    np.testing.assert_allclose(mean, location, atol=1e-14)
    np.testing.assert_allclose(covariance, matrix, atol=1e-14)
