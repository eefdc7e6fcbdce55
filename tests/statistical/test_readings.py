"""The three readings of "v_p given (R, v, T_adv)": are their distributions the model's own?

Whole rows are drawn from the mixture; for ``curve`` L follows from them with a random sign of
R/v − L/v_p. The distribution function of each reading at the rows' v_p must then be uniform
(probability integral transform).
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import kstest

from harness.interaction import InteractionModel
from harness.mixture import TruncatedGaussianMixture

ROWS = 20_000


def mixture() -> TruncatedGaussianMixture:
    """Three components cut by the box on several sides, none of them narrow."""
    spreads = np.array([[0.06, 0.9, 0.2, 0.25], [0.1, 0.5, 0.3, 0.15], [0.05, 1.5, 0.25, 0.4]])
    correlations = np.eye(4) + 0.3 * (np.ones((4, 4)) - np.eye(4))
    correlations[0, 1:] *= -1
    correlations[1:, 0] *= -1
    return TruncatedGaussianMixture(
        weights=[0.4, 0.35, 0.25],
        locations=[[0.06, 4.5, 1.4, 0.2], [0.2, 1.5, 1.2, 0.3], [0.1, 3.0, 1.0, 0.6]],
        scale_matrices=[correlations * np.outer(s, s) for s in spreads],
        lower=[1 / 60, 0.3, 0.3, 0.0],
        upper=[0.5, 8.0, 3.0, 2.0],
    )


class Drawn:
    """Rows drawn from a model, with an L of random sign."""

    def __init__(self, model: InteractionModel, count: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        rows = model.mixture.sample(count, rng)
        self.range_m, self.speed_mps = 1 / rows[:, 0], rows[:, 1]
        self.walking_mps, self.inverse_time = rows[:, 2], rows[:, 3]
        arrival, advantage = self.range_m / self.speed_mps, 1 / rows[:, 3]
        # L = v_p (R/v − T) must be positive: T = +1/w only where that leaves time to walk.
        both = advantage < arrival
        sign = np.where(both & (rng.random(count) < 0.5), 1.0, -1.0)
        self.lateral_m = self.walking_mps * (arrival - sign * advantage)


@pytest.fixture(scope="module")
def own() -> InteractionModel:
    return InteractionModel(mixture(), "test", {}, "")


@pytest.fixture(scope="module", params=["own", "shipped"])
def drawn(request, own, model) -> tuple[InteractionModel, Drawn]:
    chosen = own if request.param == "own" else model
    return chosen, Drawn(chosen, ROWS, seed=11)


def test_marginal_reading_is_uniform(drawn):
    model, rows = drawn
    u = model.walking_speed_cdf(rows.walking_mps, rows.range_m, rows.speed_mps)
    assert kstest(u, "uniform").pvalue > 0.001


def test_reading_with_time_advantage_is_uniform(drawn):
    model, rows = drawn
    u = model.walking_speed_cdf(
        rows.walking_mps,
        rows.range_m,
        rows.speed_mps,
        inverse_time_advantage_per_s=rows.inverse_time,
    )
    assert kstest(u, "uniform").pvalue > 0.001


def test_curve_is_uniform(drawn):
    model, rows = drawn
    u = model.walking_speed_cdf(
        rows.walking_mps, rows.range_m, rows.speed_mps, lateral_m=rows.lateral_m
    )
    assert kstest(u, "uniform").pvalue > 0.001


class DenseGrid:
    """``curve`` at the first rows by brute force, from its definition: log f on many v_p."""

    def __init__(self, model: InteractionModel, rows: Drawn, count: int, cells: int) -> None:
        self.edges = np.linspace(model.mixture.lower[2], model.mixture.upper[2], cells + 1)
        self.x = 0.5 * (self.edges[1:] + self.edges[:-1])
        self.walking_mps = rows.walking_mps[:count]
        shape = (count, cells)
        arrival = (rows.range_m / rows.speed_mps)[:count, None]
        lateral = rows.lateral_m[:count, None]
        self.w = 1 / np.abs(arrival - lateral / self.x)
        columns = (1 / rows.range_m[:count, None], rows.speed_mps[:count, None], self.x, self.w)
        points = np.stack([np.broadcast_to(column, shape) for column in columns], axis=-1)
        self.density = np.exp(model.mixture.logpdf(points.reshape(-1, 4)).reshape(shape))
        self.jacobian = self.w**2 / self.x
        self.sign = np.where(self.x > lateral / (2 * arrival), 0.5, 1.0)

    def cdf(self, *, jacobian: bool = True, sign: bool = True) -> np.ndarray:
        """Distribution function at the rows' own v_p, (count,)."""
        density = self.density * (self.jacobian if jacobian else 1)
        density = density * (self.sign if sign else 1)
        reached = np.cumsum(density, axis=1)
        reached = np.hstack((np.zeros((len(reached), 1)), reached)) / reached[:, -1:]
        at = zip(self.walking_mps, reached, strict=True)
        return np.array([np.interp(x, self.edges, of) for x, of in at])


def test_curve_agrees_with_its_definition_on_a_dense_grid(drawn):
    model, rows = drawn
    count = 200
    u = model.walking_speed_cdf(
        rows.walking_mps[:count],
        rows.range_m[:count],
        rows.speed_mps[:count],
        lateral_m=rows.lateral_m[:count],
    )
    error = np.abs(u - DenseGrid(model, rows, count, 5_000).cdf())
    assert np.quantile(error, 0.9) < 2e-3
    assert error.max() < 0.02


def test_curve_is_not_uniform_without_its_jacobian_and_sign(own):
    grid = DenseGrid(own, Drawn(own, 2000, seed=11), 2000, 1_000)
    assert kstest(grid.cdf(), "uniform").pvalue > 0.001
    assert kstest(grid.cdf(jacobian=False), "uniform").pvalue < 1e-6
    assert kstest(grid.cdf(sign=False), "uniform").pvalue < 1e-2


@pytest.mark.parametrize("given", [{}, {"inverse_time_advantage_per_s": 0.3}, {"lateral_m": 4.0}])
def test_densities_integrate_to_one(drawn, given):
    model, _ = drawn
    low, high = model.mixture.lower[2], model.mixture.upper[2]
    # Gauss–Legendre on short panels; for the curve its hole and jump are ends of panels.
    range_m, speed = 20.0, 4.0
    marks = [low, high]
    if "lateral_m" in given:
        arrival, lateral = range_m / speed, given["lateral_m"]
        marks += [lateral / (arrival + 0.5), lateral / (arrival - 0.5), lateral / (2 * arrival)]
    marks = np.unique(np.clip(marks, low, high))
    edges = np.concatenate([np.linspace(a, b, 41)[:-1] for a, b in pairwise(marks)] + [[high]])
    nodes, weights = np.polynomial.legendre.leggauss(12)
    half = np.diff(edges)[:, None] / 2
    x = (edges[:-1, None] + half * (1 + nodes)).ravel()
    arrays = {key: np.array([value]) for key, value in given.items()}
    density = model.walking_speed_density(x, np.array([range_m]), np.array([speed]), **arrays)
    assert (density >= 0).all()
    assert ((half * weights).ravel() @ density) == pytest.approx(1.0, abs=1e-3)


def test_driver_densities_integrate_to_one(drawn):
    model, _ = drawn
    x = np.linspace(model.mixture.lower[1], model.mixture.upper[1], 4_001)
    for time_advantage in (None, np.array([0.2])):
        density = model.driver_speed_density(x, np.array([20.0]), np.array([1.2]), time_advantage)
        assert np.trapezoid(density, x) == pytest.approx(1.0, abs=1e-5)


def test_curve_samples_lie_in_the_box_and_outside_the_hole(drawn):
    model, rows = drawn
    u = np.random.default_rng(2).random(ROWS)
    x = model.walking_speed_on_curve(u, rows.range_m, rows.lateral_m, rows.speed_mps)
    assert (x >= model.mixture.lower[2]).all()
    assert (x <= model.mixture.upper[2]).all()
    advantage = np.abs(rows.range_m / rows.speed_mps - rows.lateral_m / x)
    assert advantage.min() >= 1 / model.mixture.upper[3] - 1e-9


def test_inverse_of_the_curve_returns_the_quantile(drawn):
    model, rows = drawn
    u = np.random.default_rng(3).random(ROWS)
    x = model.walking_speed_on_curve(u, rows.range_m, rows.lateral_m, rows.speed_mps)
    back = model.walking_speed_cdf(x, rows.range_m, rows.speed_mps, lateral_m=rows.lateral_m)
    np.testing.assert_allclose(back, u, atol=1e-9)


def test_curve_gives_the_same_bits_in_any_batch(drawn):
    model, rows = drawn
    u = np.random.default_rng(4).random(150)
    columns = (rows.range_m[:150], rows.lateral_m[:150], rows.speed_mps[:150])
    together = model.walking_speed_on_curve(u, *columns)
    for i in range(150):
        alone = model.walking_speed_on_curve(u[i : i + 1], *(of[i : i + 1] for of in columns))
        assert alone[0] == together[i]


def test_curve_is_undefined_where_the_hole_covers_the_box(own):
    # R/v = 2/8 = 0.25 s: faster than any T_adv of 0.5 s on that side; slower needs L/v_p above
    # 0.75 s, so v_p below 0.2/0.75 = 0.27 m/s, which the box does not have.
    speed = own.walking_speed_on_curve(
        np.array([0.5]), np.array([2.0]), np.array([0.2]), np.array([8.0])
    )
    assert np.isnan(speed).all()
