"""The three readings of "v_p given (R, v, T_adv)": are their distributions the model's own?

Whole rows are drawn from the mixture; for ``curve`` L follows from them with a random sign of
R/v − L/v_p. The distribution function of each reading at the rows' v_p must then be uniform
(probability integral transform).
"""

import os
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import kstest

from harness.model.interaction import InteractionModel, load_model
from harness.model.mixture import TruncatedGaussianMixture

ROWS = 4_000


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


@pytest.mark.parametrize(
    "given", [{}, {"inverse_time_advantage_per_s": "inverse_time"}, {"lateral_m": "lateral_m"}]
)
def test_every_reading_is_uniform(drawn, given):
    model, rows = drawn
    columns = {key: getattr(rows, name) for key, name in given.items()}
    u = model.walking_speed_cdf(rows.walking_mps, rows.range_m, rows.speed_mps, **columns)
    assert kstest(u, "uniform").pvalue > 0.001


def test_driver_speeds_are_uniform(drawn):
    model, rows = drawn
    columns = (1 / rows.range_m, rows.walking_mps, rows.inverse_time)
    for given in ((0, 2), (0, 2, 3)):
        conditional = model.mixture.conditional(1, given)
        u = conditional.cdf(rows.speed_mps, np.column_stack(columns[: len(given)]))
        assert kstest(u, "uniform").pvalue > 0.001


class Curves:
    """``curve`` of the rows by brute force, from its definition in v_p."""

    def __init__(self, model: InteractionModel, rows: Drawn, count: int) -> None:
        self.mixture = model.mixture
        columns = (rows.range_m, rows.speed_mps, rows.lateral_m, rows.walking_mps)
        self.range_m, self.speed_mps, self.lateral_m, self.walking_mps = (
            column[:count, None] for column in columns
        )
        self.arrival_s = self.range_m / self.speed_mps
        self.nearest_s = 1 / model.mixture.upper[3]
        floor = model.mixture.lower[3]
        self.furthest_s = 1 / floor if floor > 0 else 1e9

    def density(self, x: np.ndarray, *, jacobian: bool = True, sign: bool = True) -> np.ndarray:
        """f · w²/v_p · s at walking speeds (n, m) outside the hole, unnormalised."""
        w = 1 / np.abs(self.arrival_s - self.lateral_m / x)
        total = np.zeros(x.shape)
        for weight, mass, centre, scale in zip(
            self.mixture.weights,
            self.mixture.masses,
            self.mixture.locations,
            self.mixture.scale_matrices,
            strict=True,
        ):
            p = np.linalg.inv(scale) / 2
            at = (1 / self.range_m, self.speed_mps, x, w)
            a, b, c, d = (value - m for value, m in zip(at, centre, strict=True))
            square = p[0, 0] * a**2 + 2 * p[0, 1] * a * b + p[1, 1] * b**2
            square = square + 2 * c * (p[2, 0] * a + p[2, 1] * b) + p[2, 2] * c**2
            square += d * (2 * (p[3, 0] * a + p[3, 1] * b) + 2 * p[3, 2] * c + p[3, 3] * d)
            total += weight / mass * np.sqrt(np.linalg.det(p)) * np.exp(-square)
        if jacobian:
            total *= w**2 / x
        if sign:
            total *= np.where(x > self.lateral_m / (2 * self.arrival_s), 0.5, 1.0)
        return total

    def marks(self) -> np.ndarray:
        """Walking speeds (n, 8) between which the density is smooth, and the rows' own."""
        bounds = np.broadcast_to(self.mixture.lower[2:3], self.arrival_s.shape)
        apart = np.array([[self.nearest_s, self.furthest_s]])
        slower, faster = self.arrival_s + apart, np.maximum(self.arrival_s - apart, 1e-9)
        ends = [self.lateral_m / time for time in (slower, faster, 2 * self.arrival_s)]
        upper = np.broadcast_to(self.mixture.upper[2:3], self.arrival_s.shape)
        return np.sort(self._clipped(np.hstack([bounds, upper, self.walking_mps, *ends])))

    def cdf(self, cells: int, **parts: bool) -> np.ndarray:
        """Distribution function (n,) at the rows' own v_p, by Gauss's rule of 8 points.

        Cells end at so many equal steps of v_p, at twice as many of w, and at the marks.
        """
        nodes, weights = np.polynomial.legendre.leggauss(8)
        lower, upper = self.mixture.lower, self.mixture.upper
        w = np.linspace(lower[3], upper[3], 2 * cells + 1)[1:]
        times = np.hstack((self.arrival_s + 1 / w, np.maximum(self.arrival_s - 1 / w, 1e-9)))
        even = np.linspace(lower[2], upper[2], cells + 1) + 0 * self.arrival_s
        ends = np.sort(self._clipped(np.hstack((self.marks(), self.lateral_m / times, even))))
        half, middle = 0.5 * np.diff(ends), 0.5 * (ends[:, 1:] + ends[:, :-1])
        apart = np.abs(self.arrival_s - self.lateral_m / middle)
        half = np.where((apart > self.nearest_s) & (apart < self.furthest_s), half, 0.0)
        masses = np.zeros(half.shape)
        for node, weight in zip(nodes, weights, strict=True):
            x = np.where(half > 0, middle + half * node, 1e3)
            masses += weight * half * self.density(x, **parts)
        return (masses * (middle < self.walking_mps)).sum(axis=1) / masses.sum(axis=1)

    def cdf_by_quad(self) -> float:
        """The same of a single row by scipy's adaptive quadrature, in log T_adv."""
        below = total = 0.0
        for low, high in pairwise(self.marks()[0]):
            advantage = (self.arrival_s - self.lateral_m / np.array([[low, high]]))[0]
            side = np.sign(advantage.sum())
            if low == high or np.abs(advantage).sum() < 2 * self.nearest_s * (1 + 1e-9):
                continue

            def along(log_t: float, side: float = side) -> float:
                t = np.exp(log_t)
                x = self.lateral_m / (self.arrival_s - side * t)
                return float((self.density(x) * x**2 / self.lateral_m * t)[0, 0])

            span = np.sort(np.log(np.abs(advantage)))
            breaks = np.linspace(*span, 12)[1:-1].tolist()
            mass = quad(along, *span, points=breaks, limit=200, epsabs=1e-9, epsrel=1e-7)[0]
            total += mass
            below += mass if high <= self.walking_mps[0, 0] else 0.0
        return below / total

    def _clipped(self, x: np.ndarray) -> np.ndarray:
        return np.clip(x, self.mixture.lower[2], self.mixture.upper[2])


class Some(Drawn):
    """Some of the rows drawn."""

    def __init__(self, rows: Drawn, some: slice) -> None:
        for name, column in vars(rows).items():
            setattr(self, name, column[some])


def curve_cdf(model: InteractionModel, rows: Drawn, count: int) -> np.ndarray:
    columns = (rows.walking_mps, rows.range_m, rows.speed_mps, rows.lateral_m)
    x, range_m, speed, lateral = (column[:count] for column in columns)
    return model.walking_speed_cdf(x, range_m, speed, lateral_m=lateral)


def test_curve_equals_quadrature_and_fine_sums_of_its_definition(drawn):
    model, rows = drawn
    wanted = [Curves(model, Some(rows, slice(i, i + 1)), 1).cdf_by_quad() for i in range(4)]
    np.testing.assert_allclose(curve_cdf(model, rows, 4), wanted, atol=1e-3)
    # The sums of the next test are as good.
    np.testing.assert_allclose(Curves(model, rows, 4).cdf(300), wanted, atol=1e-7)
    error = np.abs(curve_cdf(model, rows, 200) - Curves(model, rows, 200).cdf(300))
    assert np.quantile(error, 0.9) < 2e-4
    assert error.max() < 1e-3


def test_curve_in_a_narrower_box_of_inverse_time(own):
    parts = (own.mixture.weights, own.mixture.locations, own.mixture.scale_matrices)
    lower, upper = own.mixture.lower.copy(), own.mixture.upper.copy()
    lower[3], upper[3] = 0.1, 1.5
    narrow = InteractionModel(TruncatedGaussianMixture(*parts, lower, upper), "test", {}, "")
    rows = Drawn(narrow, 200, seed=11)
    found = curve_cdf(narrow, rows, 200)
    np.testing.assert_allclose(found, Curves(narrow, rows, 200).cdf(300), atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dut", "dut-k10"])
def test_curve_is_right_to_a_thousandth_also_far_away(name):
    model = load_model(name)
    rows = Drawn(model, ROWS, seed=11)
    found = curve_cdf(model, rows, ROWS)
    for at in range(0, ROWS, 500):
        some = Some(rows, slice(at, at + 500))
        error = np.abs(found[at : at + 500] - Curves(model, some, 500).cdf(400))
        assert error.max() < 1e-3


def test_curve_is_not_uniform_without_its_jacobian_and_sign(own):
    rows = Drawn(own, 2000, seed=11)
    curves = Curves(own, rows, 2000)
    whole = curves.cdf(30)
    np.testing.assert_allclose(curve_cdf(own, rows, 2000), whole, atol=1e-3)
    assert kstest(whole, "uniform").pvalue > 0.001
    assert kstest(curves.cdf(30, jacobian=False), "uniform").pvalue < 1e-6
    assert kstest(curves.cdf(30, sign=False), "uniform").pvalue < 1e-2


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
    assert ((half * weights).ravel() @ density) == pytest.approx(1.0, abs=1e-5)


def test_driver_densities_integrate_to_one(drawn):
    model, _ = drawn
    x = np.linspace(model.mixture.lower[1], model.mixture.upper[1], 4_001)
    for time_advantage in (None, np.array([0.2])):
        density = model.driver_speed_density(x, np.array([20.0]), np.array([1.2]), time_advantage)
        assert np.trapezoid(density, x) == pytest.approx(1.0, abs=1e-5)


def test_curve_samples_lie_outside_the_hole_at_their_quantile(drawn):
    model, rows = drawn
    u = np.random.default_rng(3).random(ROWS)
    x = model.walking_speed_on_curve(u, rows.range_m, rows.lateral_m, rows.speed_mps)
    advantage = np.abs(rows.range_m / rows.speed_mps - rows.lateral_m / x)
    assert advantage.min() >= 1 / model.mixture.upper[3] - 1e-9
    back = model.walking_speed_cdf(x, rows.range_m, rows.speed_mps, lateral_m=rows.lateral_m)
    np.testing.assert_allclose(back, u, atol=1e-9)


def test_curve_gives_the_same_bits_in_any_batch(drawn):
    model, rows = drawn
    rng = np.random.default_rng(4)
    n = 500
    state = np.stack((rows.range_m[:n], rows.lateral_m[:n], rows.speed_mps[:n]))
    # Some for whom the hole covers everything, between the others.
    state[:, rng.random(n) < 0.1] = np.array([[2.0], [0.2], [8.0]])
    columns = (rng.random(n), *state)
    together = model.walking_speed_on_curve(*columns)
    assert 0.05 < np.isnan(together).mean() < 0.15
    order = rng.permutation(n)
    cuts = np.sort(rng.integers(0, n, 10))
    pieces = [order[:40, None], np.split(order, cuts)]
    for parts in pieces:
        for part in parts:
            alone = model.walking_speed_on_curve(*(column[part] for column in columns))
            assert alone.tobytes() == together[part].tobytes()


DRAWS = """
import hashlib
import numpy as np
from harness.model.interaction import load_model
model, rng = load_model("dut-k10"), np.random.default_rng(7)
rows = model.mixture.sample(2_000, rng)
conditional = model.mixture.conditional(2, (0, 1, 3))
found = [rows, conditional.sample(rows[:, [0, 1, 3]], rng), conditional.mode(rows[:, [0, 1, 3]])]
u, range_m, speed = rng.random(500), 1 / rows[:500, 0], rows[:500, 1]
found.append(model.walking_speed(u, range_m, speed))
found.append(model.walking_speed_on_curve(u, range_m, 1 + 5 * u, speed))
print(hashlib.sha256(b"".join(part.tobytes() for part in found)).hexdigest())
"""


FITS = """
import hashlib
import numpy as np
from harness.model.mixture import fit_mixture
from tests.unit.test_mixture_fitting import truth
box = truth()
rows = box.sample(6_000, np.random.default_rng(1))
fit = fit_mixture(rows, 10, box.lower, box.upper, seed=1, n_init=1, max_iter=25).mixture
found = [rows, box.conditional(2, [0, 1]).sample(rows[:, [0, 1]], np.random.default_rng(2))]
found += [fit.weights, fit.locations, fit.scale_matrices]
print(hashlib.sha256(b"".join(part.tobytes() for part in found)).hexdigest())
"""


@pytest.mark.parametrize("script", [DRAWS, pytest.param(FITS, marks=pytest.mark.slow)])
def test_same_seed_same_numbers_at_any_number_of_threads(script):
    printed = []
    for count in ("1", "2"):
        names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
        environment = os.environ | dict.fromkeys(names, count)
        command = [sys.executable, "-c", script]
        printed.append(subprocess.check_output(command, env=environment, text=True))
    assert len(printed[0]) > 60
    assert len(set(printed)) == 1


def test_curve_is_undefined_where_the_hole_covers_the_box(own):
    # R/v = 2/8 = 0.25 s: faster than any T_adv of 0.5 s on that side; slower needs L/v_p above
    # 0.75 s, so v_p below 0.2/0.75 = 0.27 m/s, which the box does not have.
    speed = own.walking_speed_on_curve(
        np.array([0.5]), np.array([2.0]), np.array([0.2]), np.array([8.0])
    )
    assert np.isnan(speed).all()
    # Nor without a way to walk.
    speed = own.walking_speed_on_curve(
        np.array([0.5]), np.array([20.0]), np.array([0.0, -1.0]), np.array([4.0])
    )
    assert np.isnan(speed).all()
