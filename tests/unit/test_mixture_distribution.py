"""The truncated mixture itself: density, draws, moments, refusals."""

import pickle

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from harness.core.errors import InputError
from harness.model.mixture.distribution import TruncatedGaussianMixture

PARTS: dict = {
    "weights": [0.4, 0.6],
    "locations": [[0.2, -0.5], [1.0, 1.5]],
    "scale_matrices": [[[1.0, 0.3], [0.3, 0.5]], [[0.4, -0.2], [-0.2, 0.8]]],
    "lower": [0.0, 0.0],
    "upper": [2.0, 3.0],
}


def mixture(**changes):
    return TruncatedGaussianMixture(**{**PARTS, **changes})


def grid(nodes=150):
    z, w = np.polynomial.legendre.leggauss(nodes)
    x, y = 1.0 + z, 1.5 + 1.5 * z
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    return points, np.outer(w, 1.5 * w).ravel()


def test_density_integrates_to_one_within_the_bounds_and_moments_follow():
    found = mixture()
    points, weights = grid()
    density = np.exp(found.logpdf(points)) * weights
    assert density.sum() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(density @ points, found.mean(), atol=1e-10)
    away = points - density @ points
    covariance = np.einsum("n,ni,nj->ij", density, away, away)
    np.testing.assert_allclose(covariance, found.covariance(), atol=1e-10)
    logs = mixture().logpdf([[0.0, 0.0], [2.0, 3.0], [2.0 + 1e-9, 1.0], [1.0, -1e-9]])
    assert np.isfinite(logs).tolist() == [True, True, False, False]
    assert (logs[2:] == -np.inf).all()


def test_nothing_of_it_can_be_changed_in_another_process_either():
    for found in (mixture(), pickle.loads(pickle.dumps(mixture()))):
        with pytest.raises(AttributeError, match="immutable"):
            found.weights = np.ones(2)
        with pytest.raises(ValueError, match="read-only"):
            found.weights[0] = 1.0


def test_weights_are_of_the_truncated_components():
    """Σ π_k N_k / α_k with scipy's densities and masses by quadrature."""
    points, weights = grid()
    wanted = np.zeros(len(points))
    for pi, m, s in zip(PARTS["weights"], PARTS["locations"], PARTS["scale_matrices"], strict=True):
        density = multivariate_normal(m, s).pdf(points)
        wanted += pi * density / (density @ weights)
    np.testing.assert_allclose(np.exp(mixture().logpdf(points)), wanted, rtol=1e-10)


def test_draws_lie_in_the_box_and_have_the_moments():
    # Of the second one in forty normal vectors lies in the box.
    far = [1.0], [[-1.5, -1.0]], [[[1.0, 0.3], [0.3, 1.0]]], [0.0, 0.0], [5.0, 5.0]
    for found, count in ((mixture(), 100_000), (TruncatedGaussianMixture(*far), 20_000)):
        rows = found.sample(count, np.random.default_rng(3))
        assert ((rows >= found.lower) & (rows <= found.upper)).all()
        # Five standard errors of the mean.
        error = np.sqrt(np.diag(found.covariance()) / count)
        assert (np.abs(rows.mean(axis=0) - found.mean()) < 5 * error).all()
        np.testing.assert_allclose(np.cov(rows.T), found.covariance(), atol=0.01)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"weights": [0.4, 0.5]}, "sum to 1"),
        ({"weights": [1.0, 0.0]}, "positive"),
        ({"weights": [1.0]}, r"shape \(1,\)"),
        ({"weights": "many"}, "not an array"),
        ({"locations": [[0.2, np.nan], [1.0, 1.5]]}, "not finite"),
        ({"scale_matrices": [[[1, 2], [2, 1]], [[1, 0], [0, 1]]]}, "number 0 is not positive"),
        ({"scale_matrices": [[[1, 0.5], [0, 1]], [[1, 0], [0, 1]]]}, "not symmetric"),
        ({"lower": [0.0, 3.0]}, "variable 1 has bounds 3 and 3"),
        ({"lower": [0.0, np.nan]}, "lower < upper"),
        ({"locations": [[0.2, -500.0], [1.0, 1.5]]}, "component 0 has no mass"),
        ({"lower": [0.0]}, r"shape \(1,\)"),
        ({"locations": [[0.0] * 5] * 2}, "1 to 4"),
    ],
)
def test_refusals(changes, text):
    with pytest.raises(InputError, match=text) as caught:
        mixture(**changes)
    assert "\n" not in str(caught.value)
