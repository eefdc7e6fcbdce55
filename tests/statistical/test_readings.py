"""The readings of "v_p given (R, v, T_adv)": are their distributions the model's own?

Whole rows are drawn from the mixture.  The distribution function of each reading at the rows' v_p
must then be uniform (probability integral transform).
"""

import os
import subprocess
import sys

import numpy as np
import pytest
from scipy.stats import kstest

from harness.model.interaction import InteractionModel
from harness.model.mixture.distribution import TruncatedGaussianMixture

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
    """Rows drawn from a model."""

    def __init__(self, model: InteractionModel, count: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        rows = model.mixture.sample(count, rng)
        self.range_m, self.speed_mps = 1 / rows[:, 0], rows[:, 1]
        self.walking_mps, self.inverse_time = rows[:, 2], rows[:, 3]


@pytest.fixture(scope="module")
def own() -> InteractionModel:
    return InteractionModel(mixture(), "test", {}, "")


@pytest.fixture(scope="module", params=["own", "shipped"])
def drawn(request, own, model) -> tuple[InteractionModel, Drawn]:
    chosen = own if request.param == "own" else model
    return chosen, Drawn(chosen, ROWS, seed=11)


@pytest.mark.parametrize("given", [{}, {"inverse_time_advantage_per_s": "inverse_time"}])
def test_every_reading_is_uniform(drawn, given):
    model, rows = drawn
    columns = {key: getattr(rows, name) for key, name in given.items()}
    u = model.walking_speed_cdf(rows.walking_mps, rows.range_m, rows.speed_mps, **columns)
    assert kstest(u, "uniform").pvalue > 0.001


@pytest.mark.parametrize("given", [{}, {"inverse_time_advantage_per_s": 0.3}])
def test_densities_integrate_to_one(drawn, given):
    model, _ = drawn
    low, high = model.mixture.lower[2], model.mixture.upper[2]
    # Gauss–Legendre on short panels.
    range_m, speed = 20.0, 4.0
    edges = np.linspace(low, high, 41)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    half = np.diff(edges)[:, None] / 2
    x = (edges[:-1, None] + half * (1 + nodes)).ravel()
    arrays = {key: np.array([value]) for key, value in given.items()}
    density = model.walking_speed_density(x, np.array([range_m]), np.array([speed]), **arrays)
    assert (density >= 0).all()
    assert ((half * weights).ravel() @ density) == pytest.approx(1.0, abs=1e-5)


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
print(hashlib.sha256(b"".join(part.tobytes() for part in found)).hexdigest())
"""


FITS = """
import hashlib
import numpy as np
from harness.model.mixture.fitting import fit_mixture
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
